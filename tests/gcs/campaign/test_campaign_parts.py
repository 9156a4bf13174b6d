"""What a campaign is made of: which logs are one flight, which flights go together, what is given of them, tables."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np
import pyarrow.parquet
import pytest
from flying import TWO_CHIRPS, flown

from gcs import documents
from gcs.campaign.dataset import TABLES, write_dataset
from gcs.campaign.findings import found
from gcs.campaign.given import Given, load
from gcs.campaign.groups import copies, grouped, placed
from gcs.campaign.identity import sketch
from gcs.campaign.summary import means, reasons
from gcs.campaign.work import Flown, Number, Numbers, Outcome, Reason, Settings, Verdict, worked_on

RUN = Flown(
    id="x#1",
    maneuver="chirp",
    axis="roll",
    start_s=0.0,
    duration_s=20.0,
    usable=True,
    reasons=(),
    rate_hz=400.0,
    gaps=0,
    gaps_s=0.0,
    jitter=0.01,
    saturated_share=0.0,
    follows={},
)


def gyro(seed: int, samples: int = 4000) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 0.3, samples)


def outcome(
    path: str,
    p: np.ndarray | None = None,
    value: float = 150.0,
    vehicle: dict[str, str] | None = None,
    reason: Reason | None = None,
    words: str = "",
) -> Outcome:
    fit = Numbers(
        structure="TPP",
        base="tpp",
        effects=(),
        parameters={"L_b": Number(value=value, unit="1/s^2", standard_error=1.0, model_error=0.0)},
        covariance=((1.0,),),
        nrmse_percent={"p": 90.0, "q": 91.0},
        validation_nrmse_percent=None,
        band_hz=(0.0, 15.0),
        warnings=(),
        model={},
    )
    return Outcome(
        key=f"{abs(hash(path)):064x}",
        path=path,
        sha256=path,
        version="1",
        settings=Settings(),
        reason=reason,
        words=words,
        airframe="helicopter",
        vehicle=vehicle or {},
        runs=(RUN,),
        sketch=() if p is None else sketch([p]),
        fit=None if reason else fit,
    )


def test_a_cut_copy_with_a_gap_is_the_same_flight_and_another_flight_is_none() -> None:
    p = gyro(1)
    cut = np.delete(p[2500:3300], slice(400, 420))
    found = copies([outcome("cut", cut), outcome("whole", p), outcome("other", gyro(2))])
    assert found in ({"cut": "whole"}, {"whole": "cut"})


def test_a_gyro_at_rest_makes_no_two_flights_one() -> None:
    rest = np.zeros(3000)
    found = copies([outcome(name, np.concatenate([rest, gyro(seed)])) for seed, name in enumerate("ab")])
    assert found == {}


def test_flights_are_grouped_by_vehicle_and_by_what_a_model_stands_on() -> None:
    logs = [
        outcome("a", vehicle={"SYSID_THISMAV": "1", "INS_GYRO_FILTER": "20", "ATC_RAT_RLL_P": "0.1"}),
        outcome("b", vehicle={"MAV_SYSID": "1", "INS_GYRO_FILTER": "80", "ATC_RAT_RLL_P": "0.2"}),
        outcome("c", vehicle={"SYSID_THISMAV": "2", "INS_GYRO_FILTER": "20", "ATC_RAT_RLL_P": "0.3"}),
        outcome("d", vehicle={"SYSID_THISMAV": "1", "INS_GYRO_FILTER": "20", "ATC_RAT_RLL_P": "0.4"}),
    ]
    groups = grouped(logs, Given())
    assert {name: [one.path for one in each] for name, each in groups.items()} == {
        "helicopter, system 1/INS_GYRO_FILTER 20": ["a", "d"],
        "helicopter, system 1/INS_GYRO_FILTER 80": ["b"],
        "helicopter, system 2": ["c"],
    }


def test_what_is_given_goes_before_what_logs_tell(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(
        '[[logs]]\nfiles = ["a/**"]\nvehicle = "heli A"\n'
        '[[logs]]\nfiles = ["a/2*", "misspelt*"]\nconfiguration = "new blades"\ndate = 2026-05-03\n'
    )
    given = load(tmp_path / "campaign.toml")
    paths = [tmp_path / "a" / name for name in ("1.BIN", "2.BIN", "deep/3.BIN")]
    assert given.unmatched(paths) == ["misspelt*"]
    logs = placed([outcome(str(path)) for path in paths], given)
    assert logs[1].when is not None
    assert (logs[1].when.time, logs[1].when.told_by) == (datetime(2026, 5, 3, 12, tzinfo=UTC), "campaign.toml")
    groups = grouped(logs, given)
    assert {name: len(each) for name, each in groups.items()} == {"heli A": 2, "heli A/new blades": 1}


@pytest.mark.parametrize(
    ("text", "says"),
    [("[[logs]]\nfile = []\n", "file"), ('[[logs]]\nfiles = ["a"]\nvehicle = "a/b"\n', "vehicle"), ("x = 1", "x")],
)
def test_a_campaign_toml_that_is_wrong_is_refused_by_name(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    with pytest.raises(documents.DocumentError, match=says):
        load(path)


def test_reasons_that_differ_in_numbers_are_counted_together() -> None:
    logs = [
        outcome(f"/x/{rate}.BIN", reason="no usable run", words=f"{rate}.BIN#1: at {rate} Hz: too slow")
        for rate in (25, 50)
    ]
    found = reasons([*logs, outcome("good"), outcome("/x/none.BIN", reason="no run", words="nothing")])
    assert [(why.reason, len(why.logs)) for why in found] == [("no usable run", 2), ("no run", 1)]


def test_the_tables_are_read_back_as_they_were_written(tmp_path: Path) -> None:
    logs = [outcome("a", gyro(1), 149.0), outcome("b", reason="no run", words="nothing")]
    written = write_dataset(logs, grouped(logs, Given()), {}, tmp_path)
    assert {path.stem for path in written} == set(TABLES)
    tables = {path.stem: pyarrow.parquet.read_table(path).to_pylist() for path in written}
    assert [(row["key"], row["group"], row["reason"]) for row in tables["logs"]] == [
        (logs[0].key, "helicopter", None),
        (logs[1].key, None, "no run"),
    ]
    (row,) = tables["parameters"]
    assert (row["parameter"], row["value"], row["standard_error"], row["covariance"]) == ("L_b", 149.0, 1.0, [1.0])
    assert {row["output"]: row["nrmse_percent"] for row in tables["fits"]} == {"p": 90.0, "q": 91.0}
    assert len(tables["runs"]) == len(tables["health"]) == 2
    assert tables["verdicts"] == []


@pytest.mark.usefixtures("few_effects")
def test_what_a_fit_lacks_stands_in_the_table_of_verdicts(tmp_path: Path) -> None:
    log = tmp_path / "2026-05-05.BIN"
    log.write_bytes(flown("hover-ideal", TWO_CHIRPS))
    one = worked_on(log, Settings(diagnose=True))
    assert one.fit is not None
    assert one.verdict is not None
    write_dataset([one], {"A": (one,)}, {}, tmp_path)
    (row,) = pyarrow.parquet.read_table(tmp_path / "dataset" / "verdicts.parquet").to_pylist()
    assert (row["group"], row["verdict"], row["effect"]) == ("A", "complete", None)
    assert row["indistinguishable_pairs"] == []
    assert one.key != worked_on(log, Settings()).key, "asked without, it is another outcome"


def test_two_effects_that_may_stand_for_the_one_named_are_in_the_table_of_verdicts(tmp_path: Path) -> None:
    said = Verdict(
        verdict="missing",
        effect="servo_second_order",
        stands_in=False,
        indistinguishable=(),
        indistinguishable_pairs=("transport_delay + dynamic_inflow",),
        confidence=0.95,
        explained_share=1.0,
    )
    one = msgspec.structs.replace(outcome("2026-05-05.BIN"), verdict=said)
    write_dataset([one], {"A": (one,)}, {}, tmp_path)
    (row,) = pyarrow.parquet.read_table(tmp_path / "dataset" / "verdicts.parquet").to_pylist()
    assert row["indistinguishable_pairs"] == ["transport_delay + dynamic_inflow"]


def test_the_mean_of_a_group_has_its_error_and_the_spread_between_days() -> None:
    given = Given()
    logs = placed([outcome(f"2026-05-{day:02}.BIN", value=150 + 10 * (-1) ** day) for day in range(1, 11)], given)
    mean = means("A", logs, found({"A": logs}).courses)["L_b"]
    assert mean.value == pytest.approx(150)
    assert mean.between == pytest.approx(np.std([10, -10] * 5, ddof=1), rel=0.02)
    assert (mean.flights, mean.days) == (10, 10)
    assert mean.within_days is None

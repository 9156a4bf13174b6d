"""Two sets of flights: what changed, beyond what nothing did, or how many flights could tell."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path

import pytest
from campaign_flights import outcomes
from flying import TWO_CHIRPS, flown

from gcs.campaign.check_change import read_set
from gcs.campaign.sentences import EPOCH
from gcs.campaign.work import Outcome, Settings
from gcs.cli import main


def saved(folder: Path, flights: tuple[Outcome, ...], structure: str = "tpp") -> str:
    """Each as `tippath fit` writes it, with what is read of it."""
    folder.mkdir()
    for number, one in enumerate(flights):
        fit = one.fit
        assert fit is not None
        document = {
            "format": "tippath.fit/1",
            "structure": {"base": structure, "effects": list(fit.effects)},
            "parameters": {
                name: {"value": each.value, "unit": each.unit, "at_bound": False, "fixed": False}
                for name, each in fit.parameters.items()
            },
            "covariance": fit.covariance,
            "nrmse_percent": {"p": 90.0, "q": 90.0},
            "validation_nrmse_percent": None,
            "records": [
                {"id": f"{number}", "path": f"{one.when.utc[:10] if one.when else ''}.BIN", "sha256": one.key,
                 "maneuver": "chirp", "duration_s": 10.0, "samples": 10, "rate_hz": 1.0, "gaps": []}
            ],
            "lineage": [], "band_hz": [0.0, 15.0], "warnings": [], "profile": None,
        }  # fmt: skip
        (folder / f"{number}.json").write_text(json.dumps(document))
    return str(folder)


def asked(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, object]]:
    status = main(["check-change", *words, "--json"])
    return status, json.loads(capsys.readouterr().out)


def test_a_change_is_told_with_its_size_and_no_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = saved(tmp_path / "a", outcomes(12, days=60))
    after = saved(tmp_path / "b", outcomes(12, seed=7, days=60, step=None, drift={"M_a": -6e3}))
    status, found = asked(capsys, before, after)
    assert (status, found["verdict"]) == (0, "changed")
    assert str(found["sentence"]).startswith("Changed: M_a fell by ")
    assert [one["parameter"] for one in found["parameters"] if one["changed"]] == ["M_a"]  # type: ignore[index,attr-defined]


def test_nothing_changed_beyond_what_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = saved(tmp_path / "a", outcomes(15)), saved(tmp_path / "b", outcomes(15, seed=7))
    status, found = asked(capsys, before, f"{after}/*.json")
    assert (status, found["verdict"]) == (0, "nothing changed")
    assert str(found["sentence"]).startswith("Nothing changed beyond ")


def test_too_few_flights_cannot_tell_and_how_many_could(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = saved(tmp_path / "a", outcomes(1)), saved(tmp_path / "b", outcomes(1, seed=7))
    assert main(["check-change", before, after]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("Cannot tell: 1 and 1 flights are too few; about 3 flights in each set would show 10 %")


def test_what_cannot_be_compared_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = saved(tmp_path / "a", outcomes(3)), saved(tmp_path / "b", outcomes(3, seed=7), "cd")
    assert main(["check-change", before, after]) == 1
    assert "one structure" in capsys.readouterr().err
    assert main(["check-change", before, str(tmp_path / "nowhere*")]) == 2
    assert "no logs and no fits" in capsys.readouterr().err


def test_logs_are_fitted_and_bad_ones_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = flown("hover-ideal", TWO_CHIRPS)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "hover.BIN").write_bytes(log)
    (tmp_path / "b" / "bad.BIN").write_bytes(b"no log at all")
    assert main(["check-change", str(tmp_path / "a"), str(tmp_path / "b")]) == 1
    out = capsys.readouterr()
    assert "left out" in out.err
    assert "Cannot tell" in out.out


def test_a_log_has_the_day_that_its_name_tells(tmp_path: Path) -> None:
    path = tmp_path / "2026-05-03.BIN"
    path.write_bytes(flown("hover-ideal", TWO_CHIRPS))
    found = read_set(str(path), Settings())
    assert {one.day for each in found.estimates.values() for one in each} == {date(2026, 5, 3).toordinal() - EPOCH}

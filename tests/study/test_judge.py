"""What the judge counts, on answers made up here; intervals against published ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from intervals import area_under, reliability, threshold_at, wilson
from judge import report
from judged import Flight, load
from must_show import WHOLE, base_errors, by_detectability, must_show, seconds


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_s_interval_is_the_published_one(count: int, of: int, low: float, high: float) -> None:
    """Newcombe 1998, table I, method 3."""
    assert wilson(count, of) == (pytest.approx(low, abs=5e-5), pytest.approx(high, abs=5e-5))


def test_no_flight_has_no_share() -> None:
    with pytest.raises(ValueError, match="0 of 0"):
        wilson(0, 0)


def test_bins_are_of_equal_counts_and_none_is_lost() -> None:
    found = reliability([(i / 1000, i % 2 == 0) for i in range(1000)])
    assert [one.answers for one in found] == [200] * 5
    assert found[0].confidence < found[-1].confidence
    assert [one.kept for one in found] == [False, False, True, False, False]


def test_a_curve_s_area_and_its_thresholds() -> None:
    assert area_under([2.0, 3.0], [0.0, 1.0]) == 1.0
    assert area_under([1.0], [0.0, 2.0]) == 0.5
    clean = [float(i) for i in range(100)]
    assert sum(one > threshold_at(0.05, clean) for one in clean) == 5


def answered(level: str, verdict: str, effect: str | None = None, **more: Any) -> Flight:
    answer = effect if level == "catalogue" and "hidden" not in more else more.pop("hidden", None)
    hidden: dict[str, Any] = {"id": "x", "level": level, "answer": answer, "accepts": [], "sizes": {}, "expect": {}}
    nrmse = {"p": 90.0, "q": 90.0}
    said: dict[str, Any] = {
        "case": {"plant": "stranger", "names": ["x"], "seed": 1, "scale": 1.0, "gusts": 1.0},
        "hidden": [hidden | more.pop("also", {})],
        "detectability": None if level == "none" else 5.0,
        "verdict": verdict, "reason": None, "effect": effect, "stands_in": False, "chain": [effect] if effect else [],
        "indistinguishable": [], "confidence": 0.95, "candidates": [], "pairs": [], "seconds": 1.0,
        "noise_floor_percent": nrmse, "nrmse_percent": nrmse, "log10_chance": -3.0, "E0": 0.01, "N": 0.01,
    }  # fmt: skip
    flight: dict[str, Any] = {
        "excitation_logged": True, "size": "small", "loop": "weak", "gust_kind": "white", "loop_told": True,
        "log_hz": 50.0, "loop_hz": 500, "chirp_noise": 0.2, "table": {"L_b": 1.0, "M_a": 1.0, "tau_f": 1.0},
    }  # fmt: skip
    return Flight(said | {"flight": flight | more.pop("flight", {})} | more)


def line_of(flights: list[Flight], words: str) -> str:
    return next(line for line in must_show(flights) if words in line)


def test_one_alarm_fails_the_first_line_and_feedback_is_none() -> None:
    clean = [answered("none", "complete") for _ in range(9)]
    feedback = answered("none", "unexplained", reason="feedback")
    assert "0 of 10" in line_of([*clean, feedback], "alarms, nothing hidden")
    assert "pass" in line_of([*clean, feedback], "alarms, nothing hidden")
    assert "FAIL" in line_of([*clean, answered("none", "unexplained")], "alarms, nothing hidden")


def test_thinned_commands_are_no_alarm_where_nobody_told_of_the_loop() -> None:
    said = {"clocks": "CommandsThinned"}
    unknown, told = ({"loop_told": known} for known in (False, True))
    assert not answered("none", "missing", "gyro_lag", flight=unknown, **said).alarm
    assert answered("none", "missing", "gyro_lag", flight=told, **said).alarm
    assert answered("none", "missing", "gyro_lag", flight=unknown).alarm


def test_what_matters_little_is_counted_as_it_was_told_before_that_was_asked_too() -> None:
    whole = {"verdict": "unexplained", "reason": None, "effect": None, "indistinguishable": [], "chain": []}
    foreign = answered("beyond", "complete", unweighed=whole)
    assert not foreign.right
    assert foreign.unweighed.right
    lines = [line for line in must_show([foreign, answered("none", "complete", unweighed=whole)]) if WHOLE in line]
    assert ["1 of 1" in line for line in lines] == [True, False, True]
    named = answered("catalogue", "complete", hidden="servo_lag", unweighed=whole | {"effect": "servo_lag"})
    assert not named.right_in_class
    assert named.unweighed.right_in_class
    same = answered("catalogue", "missing", "servo_lag", unweighed=None)
    assert same.unweighed.right_in_class


def test_a_class_counts_and_a_large_one_does_not() -> None:
    right = answered("catalogue", "missing", "servo_lag")
    alike = ["transport_delay", "servo_lag"]
    in_class = answered("catalogue", "missing", "gyro_lag", hidden="servo_lag", indistinguishable=alike)
    wide = answered("catalogue", "missing", "gyro_lag", hidden="servo_lag", indistinguishable=[*alike, "flapping"])
    assert "2 of 3" in line_of([right, in_class, wide], "right or in class")
    assert "1 of 3" in line_of([right, in_class, wide], "0.9 or more and wrong")


def test_entries_that_predict_the_same_are_one_answer() -> None:
    same = {"equivalent": {"gyro_lag": ["servo_lag"], "transport_delay": ["gyro_filter"]}}
    assert answered("catalogue", "missing", "gyro_lag", hidden="servo_lag", **same).right
    alike = {"indistinguishable": ["transport_delay"], **same}
    other = answered("catalogue", "missing", "gyro_lag", hidden="gyro_filter", **alike)
    assert other.right_in_class
    assert not other.right
    assert not answered("catalogue", "missing", "servo_lag", hidden="gyro_lag", **same).right


def test_what_an_entry_is_at_a_certain_value_may_be_named_by_it() -> None:
    also = {"resembles": {"quadratic_damping": {"exponent": 3.0}}}

    def said(exponent: float | None, error: float = 0.1) -> Flight:
        values = [
            {
                "effect": "quadratic_damping",
                "parameters": {"L_pp": -1.0, "exponent": exponent},
                "standard_errors": {"exponent": error},
            }
        ]
        return answered("beyond", "missing", "quadratic_damping", also=also, candidates=values)

    assert said(2.9).right
    assert not said(2.0).right
    assert said(2.0, error=0.6).right  # as near as the flight tells it
    assert not said(2.0, error=0.4).right
    assert not said(None).right


def test_what_is_called_nothing_that_matters_is_counted_apart_and_only_where_it_matters_little() -> None:
    little: dict[str, Any] = {"noise_floor_percent": {"p": 90.3, "q": 90.0}, "parent": {"L_b": 1.04}}
    spared = answered("beyond", "complete", **little)
    costly = answered("beyond", "complete", **little | {"noise_floor_percent": {"p": 90.0, "q": 91.0}})
    harmful = answered("beyond", "complete", **little | {"parent": {"L_b": 1.06}})
    named = answered("beyond", "missing", "servo_lag", **little)
    flights = [spared, costly, harmful, named, answered("beyond", "unexplained")]
    assert "1 of 5" in line_of(flights, "not in the catalogue, and so said")
    assert "2 of 5" in line_of(flights, "or complete, and mattering little")
    two = [Flight(one.said | {"hidden": 2 * one.hidden}) for one in flights]
    assert "0 of 5" in line_of(two, "two at once, both found")
    assert "1 of 5" in line_of(two, "or complete, and both mattering little")


def test_a_tether_that_stands_in_for_itself_is_an_answer_and_another_that_does_is_none() -> None:
    tether = answered("catalogue", "unexplained", "attitude_stiffness", stands_in=True)
    assert tether.answer_right
    assert not answered("catalogue", "unexplained", "attitude_stiffness").answer_right
    assert not answered("catalogue", "unexplained", "dynamic_inflow", stands_in=True).answer_right
    assert not answered("none", "unexplained", "attitude_stiffness", stands_in=True).answer_right
    other = {"hidden": "servo_lag"}
    assert not answered("catalogue", "unexplained", "attitude_stiffness", stands_in=True, **other).answer_right


def test_two_are_both_found_by_names_that_predict_the_same() -> None:
    hidden: list[dict[str, Any]] = [
        {"level": "catalogue", "answer": name, "accepts": []} for name in ("servo_lag", "angular_damping")
    ]
    first = {"effect": "gyro_lag", "chain": ["gyro_lag", "angular_damping"], "indistinguishable": []}
    assert Flight({"hidden": hidden, **first, "equivalent": {"gyro_lag": ["servo_lag"]}}).both_found
    assert not Flight({"hidden": hidden, **first, "equivalent": {"angular_damping": ["hub_gyroscopics"]}}).both_found
    second = {"effect": "angular_damping", "chain": ["angular_damping"], "indistinguishable": []}
    alone = {
        "effect": "gyro_lag",
        "chain": ["gyro_lag"],
        "indistinguishable": [],
        "equivalent": {"gyro_lag": ["servo_lag"]},
    }
    assert not Flight({"hidden": hidden, **alone}).both_found
    assert Flight({"hidden": hidden, **alone, "second": second}).both_found


def test_two_are_both_found_as_a_pair_that_a_single_one_is_not_told_from() -> None:
    hidden: list[dict[str, Any]] = [
        {"level": "catalogue", "answer": name, "accepts": []} for name in ("transport_delay", "dynamic_inflow")
    ]
    alone = {"effect": "gyro_filter", "chain": ["gyro_filter"], "indistinguishable": []}
    assert not Flight({"hidden": hidden, **alone}).both_found
    pair = {"indistinguishable_pairs": [["transport_delay", "dynamic_inflow"]]}
    assert Flight({"hidden": hidden, **alone, **pair}).both_found
    other = [{"level": "catalogue", "answer": "gyro_filter", "accepts": []}, hidden[1]]
    assert not Flight({"hidden": other, **alone, **pair}).both_found, "one of either is no answer that was told"
    known = {"level": "catalogue", "answer": "gyro_lag", "accepts": []}
    two = {"effect": "gyro_filter", "indistinguishable": ["servo_lag", "gyro_lag"]}
    assert Flight({"hidden": [known], **two}).right_in_class
    assert not Flight({"hidden": [known], **two, **pair}).right_in_class, "a class of four"


def test_what_is_right_is_counted_by_how_well_the_flight_shows_it() -> None:
    flights = [answered("catalogue", "missing", "servo_lag", detectability=size) for size in (0.5, 5.0, 6.0)]
    flights.append(answered("catalogue", "complete", hidden="servo_lag", detectability=7.0))
    lines = by_detectability(flights)
    assert [line.split()[-8:-5] for line in lines[1:]] == [["1", "of", "1"], ["2", "of", "3"]]
    assert [" ".join(line.split("logged")[1].split()[:3]) for line in lines[1:]] == ["0.3 to 1", "3 to 10"]


def test_a_flight_of_several_files_counts_once_and_a_cut_line_not_at_all(tmp_path: Path) -> None:
    first, second = tmp_path / "a.jsonl", tmp_path / "b.jsonl"
    first.write_text('{"key": "1", "failed": "x"}\n{"key": "2"}\n')
    second.write_text('{"key": "1", "failed": null}\n{"key": "3", "ver')
    assert [one.failed for one in load([first, second])] == [None, None]


def test_errors_of_the_base_are_counted_where_nothing_is_hidden() -> None:
    case = {"plant": "stranger", "names": ["none"], "seed": 1, "scale": 1.0, "gusts": 1.0}
    numbers: dict[str, Any] = {
        "parent": {"L_b": 1.4, "M_a": 0.5, "tau_s": 9.0},
        "parent_errors": {"L_b": 0.1, "M_a": 0.5, "tau_s": 1.0},
    }
    clean = answered("none", "complete", case=case, **numbers)
    hiding = answered("none", "complete", case=case | {"names": ["swashplate_phase"]}, **numbers)
    assert clean.base_off() == {"L_b": pytest.approx(4.0), "M_a": pytest.approx(-1.0)}
    assert hiding.base_off() == {}
    lines = base_errors([clean, hiding])
    assert lines[1].split()[-5:] == ["+1.50", "2.92", "1", "of", "2"]
    assert len(lines) == 4


def test_a_flight_that_failed_is_listed_with_its_reason_and_counts_as_none() -> None:
    failed = Flight(
        {"case": {"plant": "stranger", "names": [], "seed": 7}, "key": "7", "failed": "took longer than 9 s"}
    )
    text = report([answered("none", "complete"), failed])
    assert "1 flights, 1 failed" in text
    assert "took longer than 9 s" in text


def test_the_report_of_a_few_flights_holds_every_block() -> None:
    text = report([answered("none", "complete"), answered("catalogue", "missing", "servo_lag")], by_size=True)
    for words in ("must show", "reliability", "CPU seconds", "alarms on clean strangers", "by size", "confidence of a"):
        assert words in text


def test_seconds_are_told_of_runs_as_long_as_their_limit_is_meant_for() -> None:
    flights = [answered("none", "complete", seconds=taken) for taken in (1.0, 1.0, 9.0)]
    assert [line.split(", longest")[0] for line in seconds(flights)] == [
        "CPU seconds of a diagnosis: median 1.0, 95th percentile 9.0"
    ]
    for one, samples in zip(flights, (20_000, 60_000, 60_001), strict=True):
        one.said["flight"] = {"samples": samples}
    lines = seconds(flights)
    assert "FAIL" in lines[0]
    assert lines[1].startswith("CPU seconds of those of 60,000 samples at most: median 1.0, 95th percentile 1.0")
    assert lines[1].endswith("pass), 2 flights")

"""Logs that have every k-th sample of the vehicle's loop, and clocks that differ: flights made without the package."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import planted
import pytest

from sysid.data.dataset import prepared
from sysid.data.record import BY_THE_RUNS, Record
from sysid.diagnose.clocks import clocks
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import candidate
from sysid.diagnose.thinned import as_held, by_a_usual_loop
from sysid.errors import FitError
from sysid.fit.check_kinds import CommandsLate, CommandsThinned
from sysid.fit.checks import fit_checks
from sysid.fit.clocks import early_commands, found_hold, hold_beside, untold_sample_s
from sysid.fit.estimate import estimate
from sysid.fit.identify import _Climb, identify
from sysid.fit.result import Fit
from sysid.model.acting import divided, in_time
from sysid.model.compose import compose
from sysid.model.effect import at_null
from sysid.model.predict import respond
from sysid.model.structure import Model

LOOP_S = planted.DT
BAND = (0.0, 15.0)
CHANNELS = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y")
TPP = compose("tpp")


@cache
def flown(effect: str | None = None, size: float = 0.0, parameter: str = "") -> list[planted.Run]:
    return planted.fly(effect, {parameter: size} if parameter else {}, seed=1)


def logged(
    runs: Sequence[Mapping[str, np.ndarray]], every: int, loop_s: float | None, *, late: int = 0
) -> list[Record]:
    """Every so many samples of the loop; commands stamped `late` samples after they acted."""
    records = []
    for number, run in enumerate(runs):
        channels = {}
        for name in CHANNELS:
            values = run[name]
            if late:
                values = values[:-late] if name.startswith(("delta", "excitation")) else values[late:]
            channels[name] = values[::every]
        records.append(
            Record(
                f"#{number}",
                channels,
                maneuver="chirp",
                axis=planted.axes(False)[number],
                swept_band_hz=(0.5, 10.0),
                loop_dt_s=loop_s,
            )
        )
    return records


def off(fit: Fit) -> tuple[float, float]:
    """How far M_a is off, percent, and the errors of all parameters in standard errors, root of the mean square."""
    truth = np.array([planted.TABLE_4[name] for name in fit.model.structure.names])
    z = (fit.model.values - truth) / fit.standard_errors
    return 100 * (fit.model["M_a"] / planted.TABLE_4["M_a"] - 1), float(np.sqrt(np.mean(z**2)))


@pytest.mark.parametrize("every", [2, 4, 5, 6])
def test_a_slow_log_of_a_known_loop_gives_the_vehicle(every: int) -> None:
    percent, z = off(identify(TPP, logged(flown(), every, LOOP_S)))
    assert abs(percent) < 0.5
    assert z < 1.2
    bins = prepared(logged(flown(), every, None), BAND).viewed(TPP.inputs)
    as_logged = estimate(TPP, bins).model["M_a"]
    assert as_logged > 1.007 * planted.TABLE_4["M_a"], "taken as held from sample to sample of the log it is not"


@pytest.mark.parametrize("every", [2, 4, 5, 6])
def test_a_slow_log_of_an_unknown_loop_gives_the_vehicle_and_the_loop(every: int, tmp_path: Path) -> None:
    records = logged(flown(), every, None)
    fit = identify(TPP, records, records[:1])
    percent, z = off(fit)
    assert abs(percent) < 0.5
    assert z < 1.2
    assert fit.found_loop_s == pytest.approx(LOOP_S, abs=4e-4)
    assert any("no log tells the rate of the vehicle's loop" in text for text in fit.warnings)
    assert {one.loop_told_by for one in (*fit.records, *fit.validation)} == {BY_THE_RUNS}
    (tmp_path / "fit.json").write_text(json.dumps(fit.to_json(tmp_path)))
    assert Fit.load(tmp_path / "fit.json").found_loop_s == pytest.approx(fit.found_loop_s)


def test_a_loop_that_was_found_is_less_sure_than_one_that_was_told() -> None:
    told, found = (identify(TPP, logged(flown(), 5, loop_s)) for loop_s in (LOOP_S, None))
    place = TPP.names.index("M_a")
    assert found.model["M_a"] == pytest.approx(told.model["M_a"], abs=3 * found.standard_errors[place])
    assert np.all(found.standard_errors > 0.99 * told.standard_errors)
    assert found.standard_errors[place] > 1.05 * told.standard_errors[place]


def test_a_found_loop_stays_with_what_is_made_of_the_fit() -> None:
    records = logged(flown(), 5, None)
    bare = identify(TPP, records)
    grown = identify(TPP, records, effects=["angular_damping"], grown=bare)
    assert grown.found_loop_s == pytest.approx(bare.found_loop_s)
    again = identify(TPP, [one.held(bare.found_loop_s) for one in records])
    assert again.found_loop_s == pytest.approx(bare.found_loop_s)
    assert np.allclose(again.model.values, bare.model.values, rtol=1e-4)
    assert np.allclose(again.covariance, bare.covariance, rtol=1e-2, atol=1e-12)


def test_runs_that_are_held_otherwise_than_their_model_shows_show_it() -> None:
    runs = prepared(logged(flown(), 5, None), BAND)
    truth = TPP.vector(dict(planted.TABLE_4))
    for loop_s in (0.0065, 0.01, None):
        found = hold_beside(Model(TPP, truth), runs.held(loop_s), {})
        assert found is not None
        assert found.loop_s == pytest.approx(LOOP_S, abs=4e-4)
        assert found.what.early_s == pytest.approx(2 * LOOP_S, abs=2e-4)
        assert found.what.sample_s == 5 * LOOP_S
    assert hold_beside(Model(TPP, truth), runs.held(LOOP_S), {}) is None, "they are held so"


@pytest.mark.parametrize(("every", "loop_s"), [(5, LOOP_S), (1, None)])
def test_a_loop_that_is_told_or_logged_whole_shows_no_other_hold(every: int, loop_s: float | None) -> None:
    runs = prepared(logged(flown(), every, loop_s), BAND)
    late = Model(TPP, TPP.vector({**planted.TABLE_4, "tau_f": 0.08}))
    assert (untold_sample_s(runs) is None) == (loop_s is not None)
    assert hold_beside(late, runs, {}) is None


@pytest.mark.parametrize("every", [1, 5])
def test_a_loop_that_was_told_or_is_logged_whole_is_not_looked_for(every: int) -> None:
    fit = identify(TPP, logged(flown(), every, LOOP_S if every > 1 else None))
    assert fit.found_loop_s is None
    assert not any("no log tells" in text for text in fit.warnings)


def test_what_a_vehicle_lacks_is_not_taken_for_its_loop() -> None:
    late = identify(TPP, logged(flown("servo_lag", 0.02, "tau_s"), 1, None))
    assert late.found_loop_s is None


def test_a_record_forgets_only_what_was_found() -> None:
    (found, *_), (told, *_) = (logged(flown(), 5, loop_s) for loop_s in (None, LOOP_S))
    assert found.held(0.003).loop_dt_s == 0.003
    assert found.held(0.003).held(None).loop_dt_s is None
    assert told.held(0.003) is told
    assert told.held(None) is told


def test_a_loop_that_is_logged_whole_changes_nothing() -> None:
    one, other = (identify(TPP, logged(flown(), 1, loop_s)) for loop_s in (None, LOOP_S))
    assert np.array_equal(one.model.values, other.model.values)
    assert np.array_equal(one.covariance, other.covariance)


def test_a_lag_comes_out_as_long_from_a_slow_log() -> None:
    fit = identify(TPP, logged(flown("servo_lag", 0.02, "tau_s"), 5, LOOP_S), effects=["servo_lag"])
    assert fit.model["tau_s"] == pytest.approx(0.020, abs=0.0005)


def test_limits_act_on_the_loops_commands() -> None:
    fit = identify(TPP, logged(flown("servo_saturation", 0.08, "limit"), 5, LOOP_S), effects=["servo_saturation"])
    assert fit.model["limit"] == pytest.approx(0.08, rel=0.02)
    assert fit.model["M_a"] == pytest.approx(planted.TABLE_4["M_a"], rel=0.005)


@pytest.mark.parametrize("effects", [["servo_rate_limit"], ["servo_lag", "servo_backlash"]])
def test_what_acts_on_samples_sees_those_of_the_loop(effects: list[str]) -> None:
    t = np.arange(0, 8, LOOP_S)
    x, y = 0.1 * np.sin(2 * np.pi * (0.3 + 0.4 * t) * t), 0.08 * np.sin(2 * np.pi * 2.0 * t)
    channels = dict.fromkeys(("p", "q"), 0 * t) | {"t": t, "delta_x": x, "delta_y": y}
    structure = compose("tpp", effects)
    sizes = {"rate": 1.0, "tau_s": 0.02, "half_width": 0.01}
    named = {**planted.TABLE_4, **{name: sizes[name] for name in structure.names if name in sizes}}
    front, _ = divided(structure)
    acting = []
    for every in (1, 5):
        record = Record("#0", {name: values[::every] for name, values in channels.items()}, loop_dt_s=LOOP_S)
        segment = prepared([record], BAND).viewed(TPP.inputs).stacks[0].spectra[0].segment
        acting.append(in_time(structure, front, segment, named))
    assert acting[0].shape == acting[1].shape
    assert np.max(np.abs(acting[1] - acting[0])[:, 10:-10]) < 0.002


def test_what_is_not_linear_is_driven_by_the_loops_commands() -> None:
    stack = prepared(logged(flown(), 5, LOOP_S)[:2], BAND).viewed(TPP.inputs).stacks[0]
    bent = compose("tpp", ["quadratic_damping"])
    values = bent.vector({**planted.TABLE_4, **at_null(bent.composed[0])})
    straight = respond(TPP, TPP.vector(dict(planted.TABLE_4)), stack, False)
    relaxed = respond(bent, values, stack, False)
    low = stack.frequency_hz < 8.0
    size = float(np.max(np.abs(straight.Y[:, low])))
    assert np.max(np.abs(relaxed.Y[:, low] - straight.Y[:, low])) < 0.02 * size


def test_sensitivities_are_those_of_the_thinned_response_with_its_free_motion() -> None:
    stack = prepared(logged(flown(), 5, LOOP_S)[:2], BAND).viewed(TPP.inputs).stacks[0]
    values = TPP.vector(dict(planted.TABLE_4))
    ends = np.random.default_rng(1).normal(size=(2, len(TPP.states)))

    def answer(at: np.ndarray) -> np.ndarray:
        found = respond(TPP, at, stack, False)
        free = [np.einsum("e,ekf->kf", end, found.E[..., part]) for end, part in zip(ends, stack.slices, strict=True)]
        return np.asarray(found.Y + np.concatenate(free, axis=1))

    slopes = respond(TPP, values, stack, True, ends=ends).slopes
    for i, value in enumerate(values):
        step = np.zeros(values.size)
        step[i] = 1e-5 * abs(value)
        difference = (answer(values + step) - answer(values - step)) / (2 * step[i])
        assert np.max(np.abs(slopes[i] - difference)) < 1e-5 * np.max(np.abs(difference)), TPP.names[i]


def test_runs_that_were_held_differently_are_not_one_stack() -> None:
    known, unknown = (logged(flown(), 5, loop_s)[0] for loop_s in (LOOP_S, None))
    bins = prepared([known, unknown, known], BAND).viewed(TPP.inputs)
    assert [len(group.spectra) for group in bins.stacks] == [2, 1]
    assert [group.held_s for group in bins.stacks] == pytest.approx([0.002, 0.01])


def test_runs_of_two_rates_fit_together() -> None:
    slow, fast = logged(flown(), 5, LOOP_S), logged(flown(), 1, LOOP_S)
    percent, z = off(identify(TPP, [slow[0], fast[1], slow[2], fast[3]]))
    assert abs(percent) < 0.5
    assert z < 1.2


@pytest.mark.usefixtures("few_effects")
def test_nothing_is_missing_in_a_slow_log_of_a_known_loop() -> None:
    assert diagnose(TPP, logged(flown(), 6, LOOP_S)).verdict == "complete"


@pytest.mark.usefixtures("few_effects")
def test_half_a_sample_of_a_slow_log_of_an_unknown_loop_is_no_evidence() -> None:
    found = diagnose(TPP, logged(flown(), 5, None), chains=False)
    assert found.verdict == "complete"
    assert found.thinned is not None
    assert found.thinned.early_s == pytest.approx(0.004, abs=4 * found.thinned.error_s)
    assert found.parent.model["M_a"] == pytest.approx(planted.TABLE_4["M_a"], rel=0.01)
    (held_s,) = {record.loop_dt_s for record in found.parent.dataset.records}
    assert held_s == pytest.approx(LOOP_S, abs=0.0008)
    assert clocks(found) is None, "it is taken as such already"


@pytest.mark.parametrize(("every", "early_s"), [(4, 0.003), (5, 0.004)])
def test_a_slow_log_of_an_unknown_loop_is_told(every: int, early_s: float) -> None:
    records = logged(flown(), every, None)
    fit = identify(TPP, records)
    checks, _ = fit_checks(fit.model, records, BAND)
    (finding,) = [check.finding for check in checks if check.name == "time of commands"]
    assert isinstance(finding, CommandsThinned)
    assert finding.early_s == pytest.approx(early_s, abs=3 * finding.error_s)
    assert 0 < finding.error_s < 0.0003
    assert finding.sample_s == pytest.approx(every * LOOP_S)


def test_of_a_known_loop_or_a_full_log_there_is_nothing_to_tell() -> None:
    for every, loop_s in ((1, None), (5, LOOP_S)):
        records = logged(flown(), every, loop_s)
        assert early_commands(identify(TPP, records).model, prepared(records, BAND)) is None


@pytest.mark.parametrize("only_effects", [["servo_lag", "hub_gyroscopics"]], indirect=True)
@pytest.mark.usefixtures("only_effects")
def test_commands_that_are_stamped_late_are_told_in_the_diagnosis() -> None:
    found = diagnose(TPP, logged(flown(), 1, None, late=3), chains=False)
    assert found.verdict == "unexplained"
    late = clocks(found)
    assert isinstance(late, CommandsLate)
    assert late.early_s == pytest.approx(0.006, abs=3 * late.error_s)


@pytest.mark.parametrize("only_effects", [["servo_lag", "hub_gyroscopics"]], indirect=True)
@pytest.mark.usefixtures("only_effects")
def test_an_effect_that_is_no_clock_is_not_called_one() -> None:
    found = diagnose(TPP, logged(flown("servo_lag", 0.02, "tau_s"), 1, None), chains=False)
    assert found.verdict == "missing"
    assert clocks(found) is None


def test_a_record_keeps_its_loop(tmp_path: Path) -> None:
    record = replace(logged(flown(), 5, LOOP_S)[0], loop_told_by="profile")
    path = tmp_path / "one.npz"
    record.save(path)
    again = Record.load(path)
    assert (again.loop_dt_s, again.loop_told_by) == (LOOP_S, "profile")
    assert again.window(2.0, 5.0).loop_dt_s == LOOP_S


def test_runs_that_another_hold_does_not_determine_stay_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = prepared(logged(flown(), 5, None), BAND)
    bins = runs.viewed(TPP.inputs, TPP.outputs)
    fit = estimate(TPP, bins)
    assert found_hold(fit.model, runs, None, lambda *_: fit.model) is not None

    def refused(*_: object) -> Any:
        raise FitError("the data do not determine the model")

    assert found_hold(fit.model, runs, None, refused) is None
    parent = candidate(fit, (), runs)
    assert as_held(parent, {}, refused) == (parent, None, None)
    assert by_a_usual_loop(parent, refused) is None
    climb, asked = _Climb.to_the_top, 0

    def once(*args: Any) -> Any:
        nonlocal asked
        asked += 1
        return climb(*args) if asked == 1 else refused()

    before = identify(TPP, runs, band_hz=BAND)
    monkeypatch.setattr(_Climb, "to_the_top", once)
    after = identify(TPP, runs, band_hz=BAND)
    assert asked == 2
    assert before.found_loop_s is not None
    assert after.found_loop_s is None

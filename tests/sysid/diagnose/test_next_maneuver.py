"""A proposed maneuver, flown by the independent integrator, tells what it was said to tell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from planted import DT, PLANTED, REST_S, TABLE_4, Run, _Air, _air_of_run, _fly, fly, fly_many, respond
from planted_fits import records

from gcs.analysis.text.documents import next_maneuver_document
from gcs.analysis.text.maneuvers import proposal_text, why_text
from gcs.cards.maneuver import parse_card
from sysid.data.airframe import Airframe
from sysid.data.chirp import Chirp
from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose.evidence import Candidate, candidate, gain, instrumental_step, refit
from sysid.diagnose.flown_already import flown_already
from sysid.diagnose.maneuver_plans import Flown, Plan, flew, possible_plans
from sysid.diagnose.next_maneuver import NextManeuver, linear_or_not, next_maneuver
from sysid.diagnose.proposals import FitRuns, MeasuredNotGuessed
from sysid.fit.estimate import estimate
from sysid.fit.noise import Division, divide
from sysid.fit.output_error import output_error
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose
from sysid.model.structure import FloatArray, Model

SEEDS = (3, 4, 5)
ROUGH = {"gusts": 6.0, "noise": 0.03}
LAG = {"tau_s": 0.012}
OMEGA_0 = 171.2


def chirp(size: float, start_hz: float, stop_hz: float, n: int, dt: float) -> FloatArray:
    """As a plan flies it."""
    law = Chirp(axis="roll", law="tischler", f_start_hz=start_hz, f_stop_hz=stop_hz, duration_s=n * dt)
    return size * law.wave(np.asarray(dt * np.arange(n), float))


def rivals(
    flight: Sequence[Run], names: Sequence[str], base: Sequence[str] = ()
) -> tuple[list[Candidate], Division, Whitening]:
    """Refits on a flight, and the noise of the first."""
    on = dataset(records(flight), (0.0, 15.0))
    constants = {"Omega_0": OMEGA_0, "V_0": 18.2}
    structure = compose("tpp", base, on.available, constants)
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    found = [refit(compose("tpp", [*base, name], on.available, constants), parent, [name]) for name in names]
    division = divide(found[0].estimate.error, on.stacks, on.causes)
    return found, division, noise_whitening(found[0].model, on.stacks, division)


def likelier(flight: Sequence[Run], names: Sequence[str], base: Sequence[str] = ()) -> float:
    """Chi squared by which the first rival is likelier than the second."""
    found, _, whitening = rivals(flight, names, base)
    first, second = (instrumental_step(one, whitening) for one in found)
    return gain(first, second)[0]


def fly_card(effect: str, size: Mapping[str, float], card: Mapping[str, Any], seed: int) -> list[Run]:
    """A card's maneuvers in the planted flights' air, by the chirp's law."""
    flown = []
    for number, table in enumerate(card["maneuver"]):
        for repeat in range(table["repeat"]):
            duration = table["duration_s"]
            values = _air_of_run(table["axis"], (seed, 100 + 10 * number + repeat), duration, 6.0, 0.03)
            row, rest = ("roll", "pitch", "elevator").index(table["axis"]), round(REST_S / DT)
            n = round(duration / DT)
            whole = np.zeros_like(values[0])
            if table["kind"] == "chirp":
                whole[rest : rest + n, row] = chirp(table["amplitude"], table["f_start_hz"], table["f_stop_hz"], n, DT)
            else:
                phase = np.floor(DT * np.arange(n) / table["pulse_s"]) % 6
                whole[rest : rest + n, row] = table["amplitude"] * ((phase == 0).astype(float) - (phase == 1))
            values[0] = whole
            air = _Air(*(np.asarray(each)[..., None] for each in values))
            found = _fly(effect, size, air, False)
            run = {name: found[name][:, 0] for name in ("p", "q", "delta_x", "delta_y", "delta_e", "omega")}
            run |= {f"excitation_{letter}": whole[:, i] for i, letter in enumerate("xye")}
            run |= {"t": np.arange(whole.shape[0]) * DT, "r": values[4], "delta_c": values[7], "delta_r": values[8]}
            flown.append({**run, "phi": found["state phi"][:, 0], "theta": found["state theta"][:, 0]})
    return flown


@cache
def rough() -> list[list[Run]]:
    return fly_many("servo_lag", LAG, seeds=SEEDS, duration_s=10.0, **ROUGH)


@cache
def lag_or_delay() -> NextManeuver:
    found = next_maneuver(*rivals(rough()[1], ["servo_lag", "transport_delay"]))
    assert found is not None
    return found


def test_lag_or_delay_the_proposed_card_separates() -> None:
    """Over some flights the likelihood grows by what was foretold, its square in standard errors."""
    proposed = lag_or_delay()
    assert proposed.separates == ("servo_lag", "transport_delay")
    assert proposed.sigma is not None
    assert proposed.sigma >= 3
    assert proposed.card is not None
    grown = []
    for flight, seed in zip(rough(), SEEDS, strict=True):
        names = ["servo_lag", "transport_delay"]
        more = [*flight, *fly_card("servo_lag", LAG, proposed.card, seed)]
        grown.append(likelier(more, names) - likelier(flight, names))
    # the mean of three has a standard deviation of 1.2 sigma; the controller, left out of the forecast, costs a part
    assert float(np.mean(grown)) == pytest.approx(proposed.sigma**2, rel=0.6)


def test_a_proposed_card_is_one_that_can_be_flown() -> None:
    proposed = lag_or_delay()
    text = proposed.toml
    assert text is not None
    card = parse_card(text, "proposed")
    assert all(one.problem() is None for one in card.maneuvers)
    assert all(one.amplitude <= 2 * 0.15 for one in card.maneuvers)
    assert next_maneuver_document(proposed)["card"] == proposed.card


def judging(flight: Sequence[Run], axis: str, *, first: int) -> list[Record]:
    return [
        replace(one, id=f"#{number}", maneuver="chirp", axis=axis) for number, one in enumerate(records(flight), first)
    ]


def test_runs_that_were_flown_and_not_fitted_are_proposed_instead() -> None:
    """By their own commands they tell about what was imagined of the same maneuver, flown twice."""
    imagined = lag_or_delay()
    assert imagined.card is not None
    assert imagined.sigma is not None
    table = {**imagined.card["maneuver"][0], "repeat": 2}
    flown = judging(fly_card("servo_lag", LAG, {"maneuver": [table]}, 3), table["axis"], first=5)
    short = {name: values[:1600] for name, values in rough()[0][-1].items()}
    found, division, whitening = rivals(rough()[1], ["servo_lag", "transport_delay"])
    unfitted = dataset([*flown, *judging([short], "yaw", first=7)], (0.0, 15.0), found[0].dataset)
    proposed = next_maneuver(found, division, whitening, unfitted=unfitted)
    assert proposed is not None
    assert proposed.proposal == FitRuns(("#5", "#6"), "chirp", table["axis"])
    assert (proposed.card, proposed.separates) == (None, imagined.separates)
    repeats = imagined.card["maneuver"][0]["repeat"]
    assert proposed.sigma == pytest.approx(imagined.sigma * math.sqrt(2 / repeats), rel=0.3)


def told(each: Mapping[tuple[str, ...], float]) -> Any:
    """A pair of rivals that runs with these ids set so far apart."""
    dataset = SimpleNamespace(beyond=False)
    return SimpleNamespace(
        truth=SimpleNamespace(dataset=dataset), told_by_runs=lambda some, _: each[tuple(one.id for one in some.records)]
    )


def runs_flown(*named: tuple[str, str, str]) -> Any:
    """Runs as (id, maneuver, axis)."""
    each = [SimpleNamespace(id=id, maneuver=what, axis=axis, duration_s=6.0) for id, what, axis in named]

    def some(records: Sequence[Any]) -> Any:
        return SimpleNamespace(records=tuple(records), spectra=records, in_a_loop=False, of=some)

    return some(each)


def test_repeats_go_together_and_some_run_is_left_to_judge() -> None:
    division: Any = None
    roll, pitch = [("#5", "doublet", "roll"), ("#6", "doublet", "roll")], ("#7", "doublet", "pitch")
    each = [told({("#5", "#6"): 4.0, ("#7",): 9.0}), told({("#5", "#6"): 5.0, ("#7",): 1.0})]
    first, second = flown_already(each, runs_flown(*roll, pitch), division)
    assert (first.ids, first.tells, second.ids, second.tells) == (("#5", "#6"), 2, ("#7",), 1)
    assert [one.ids for one in flown_already([told({("#5",): 4.0})], runs_flown(*roll), division)] == [("#5",)]
    assert flown_already(each, runs_flown(pitch), division) == []
    assert flown_already(each, None, division) == []


def test_a_run_flew_a_plan_by_its_axis_its_size_and_its_band_or_pulses() -> None:
    t = DT * np.arange(4000)
    pulses = (np.floor((t - 1) / 0.25) % 6 == 0) * 1.0 - (np.floor((t - 1) / 0.25) % 6 == 1)
    channels = {name: np.zeros(t.size) for name in ("p", "q", "delta_x", "delta_y")}

    def flown(wave: FloatArray, **more: Any) -> Record:
        return Record("#1", {**channels, "t": t, "excitation_x": wave}, axis="roll", **more)

    plan = Plan(kind="doublet", axis="roll", amplitude=0.1, f_start_hz=0.5, f_stop_hz=10.0, duration_s=6.0)
    assert flew(plan, flown(0.1 * pulses, maneuver="doublet"))
    assert flew(plan, flown(0.109 * pulses, maneuver="doublet"))
    assert not flew(plan, flown(0.15 * pulses, maneuver="doublet"))
    assert not flew(replace(plan, axis="pitch"), flown(0.1 * pulses, maneuver="doublet"))
    assert not flew(replace(plan, pulse_s=0.5), flown(0.1 * pulses, maneuver="doublet"))
    assert not flew(replace(plan, channel="omega"), flown(0.1 * pulses, maneuver="doublet"))
    sweep = flown(0.1 * np.sign(np.sin(30 * t)), maneuver="chirp", swept_band_hz=(0.5, 10.0))
    assert flew(replace(plan, kind="chirp"), sweep)
    assert not flew(replace(plan, kind="chirp", f_stop_hz=15.0), sweep)


@cache
def commuting() -> tuple[list[Candidate], Division, Whitening]:
    return rivals(fly("servo_lag", PLANTED["servo_lag"], seed=5, duration_s=10.0), ["servo_lag", "gyro_lag"])


def test_what_no_input_separates_asks_for_a_signal() -> None:
    found = next_maneuver(*commuting())
    assert found is not None
    assert found.separates == ("servo_lag", "gyro_lag")
    assert "servo's position" in proposal_text(found.proposal)
    assert "whatever these inputs do" in why_text(found.why)
    assert found.card is None
    assert found.toml is None


def test_a_multirotor_is_asked_for_its_motors(monkeypatch: pytest.MonkeyPatch) -> None:
    candidates, *noise = commuting()
    monkeypatch.setitem(vars(candidates[0].dataset), "airframe", Airframe.MULTIROTOR)  # as if its runs told it
    found = next_maneuver(candidates, *noise)
    assert found is not None
    assert "motors' speeds" in proposal_text(found.proposal)


def test_the_integrator_says_so_too() -> None:
    """A lag in all servos is a lag in both gyros, the elevator moving or not; the swashplate tells them apart."""
    t = np.arange(4000) * DT
    commands = np.stack([0.1 * np.sin(9 * t), 0.1 * np.sin(7 * t + 1), 0.3 * np.sin(11 * t + 2)], axis=1)
    servo = respond("servo_lag", {"tau_s": 0.03}, commands, forward=True)
    gyro = respond("gyro_lag", {"tau_g": 0.03}, commands, forward=True)
    for name in ("p", "q"):
        assert np.max(np.abs(servo[name] - gyro[name])) < 1e-6 * np.max(np.abs(servo[name]))
    late = servo["state v_x"] - commands[:, 0]
    assert float(np.std(late)) > 0.1 * float(np.std(commands[:, 0]))


def test_another_input_is_proposed_where_it_helps() -> None:
    """A turned gyro turns the elevator's answer as any other; a product of inertia makes it a roll of its own.

    Flown: the elevator's run makes the true one likelier by far more than the cyclic's runs do.
    """
    names = ["inertia_coupling", "gyro_misalignment"]
    flight = fly("inertia_coupling", {"c_p": 0.03}, seed=5, duration_s=10.0, forward=True, gusts=2.0)
    cyclic = [run for i, run in enumerate(flight) if i % 3 != 2]
    found = next_maneuver(*rivals(cyclic, names, ["angular_damping"]))
    assert found is not None
    assert found.card is not None
    assert found.card["maneuver"][0]["axis"] == "elevator"
    assert found.sigma is not None
    base = ["angular_damping", "elevator"]
    assert likelier(flight, names, base) > likelier(cyclic, names, base[:1]) + 0.5 * min(found.sigma**2, 100.0)


def test_nonlinear_rivals_stay_inside_the_envelope() -> None:
    flight = fly("quadratic_damping", PLANTED["quadratic_damping"], seed=4, duration_s=10.0, gusts=8.0, noise=0.03)
    (linear,), division, whitening = rivals(flight, ["angular_damping"])
    true = compose("tpp", ["quadratic_damping"], linear.dataset.available, {"Omega_0": OMEGA_0})
    model = Model(true, true.vector({**TABLE_4, **PLANTED["quadratic_damping"]}))
    nonlinear = replace(linear.estimate, model=model, error=output_error(model, linear.dataset.stacks))
    found = next_maneuver(
        [candidate(nonlinear, (), linear.dataset, ["quadratic_damping"]), linear], division, whitening
    )
    assert found is not None
    assert found.separates == ("quadratic_damping", "angular_damping")
    assert found.card is not None
    assert found.card["maneuver"][0]["amplitude"] <= 0.3


def test_an_unexplained_error_asks_for_half_the_amplitude() -> None:
    flight = rough()[0]
    on = dataset(records(flight), (0.0, 15.0))
    structure = compose("tpp", (), on.available, {"Omega_0": OMEGA_0})
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    found = linear_or_not(parent, divide(parent.estimate.error, on.stacks, on.causes))
    assert found is not None
    assert found.toml is not None
    small, full = parse_card(found.toml, "proposed").maneuvers
    assert small.amplitude == pytest.approx(0.5 * full.amplitude)
    assert full.amplitude <= 0.15 + 1e-9
    assert small.repeat == full.repeat == 2


def test_every_maneuver_imagined_is_one_that_a_card_takes() -> None:
    (first, second), _, _ = rivals(rough()[1], ["servo_lag", "transport_delay"])
    flown = Flown.of(first)
    plans = possible_plans(flown, [first, second])
    tables = [replace(one, repeats=2).table() for one in plans]
    text = NextManeuver(
        plans[0], (), MeasuredNotGuessed("b"), None, {"name": 'a "path\\effect.py"', "maneuver": tables}
    ).toml
    assert text is not None
    card = parse_card(text, "imagined")
    assert card.name == 'a "path\\effect.py"'
    assert all(one.problem() is None for one in card.maneuvers)
    assert all(one.times <= min(2.0, flown.most_times) for one in plans)


def test_peaks_near_the_envelope_forbid_more_amplitude() -> None:
    (one,), _, _ = rivals(rough()[1], ["servo_lag"])
    near = [{**run, "p": run["p"] * 2.3 / np.max(np.abs(run["p"]))} for run in rough()[1]]
    assert Flown.of(one).most_times > 1.2
    assert Flown.of(replace(one, dataset=dataset(records(near), (0.0, 15.0)))).most_times < 1.1


def test_one_rival_alone_needs_nothing() -> None:
    found, division, whitening = commuting()
    assert next_maneuver(found[:1], division, whitening) is None


def test_the_chirp_is_the_papers() -> None:
    """Table 1: the frequency grows from 0.5 to 10 Hz with C1 = 4."""
    n = round(30 / DT)
    t = DT * np.arange(n)
    grown = (np.exp(4 * t / 30) - 1) / (math.exp(4) - 1)
    frequency = 0.5 + 9.5 * grown
    expected = 0.1 * np.sin(2 * np.pi * np.concatenate([[0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1])) * DT]))
    assert np.max(np.abs(chirp(0.1, 0.5, 10.0, n, DT) - expected)) < 1e-4

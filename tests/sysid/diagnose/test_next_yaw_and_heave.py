"""What to fly next on yaw and thrust, on motions that scipy integrated: it tells what it was said to tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from gcs.analysis.text.documents import next_maneuver_document
from gcs.analysis.text.maneuvers import how_text, proposal_text
from gcs.cards.maneuver import parse_card
from sysid.data.airframe import Airframe
from sysid.data.chirp import Chirp
from sysid.data.dataset import dataset
from sysid.data.record import FloatArray, Record
from sysid.diagnose.evidence import Candidate, candidate, gain, instrumental_step, refit
from sysid.diagnose.maneuver_plans import LARGEST_FORCE, Flown, Plan, possible_plans
from sysid.diagnose.next_maneuver import NextManeuver, linear_or_not, next_maneuver
from sysid.fit.estimate import estimate
from sysid.fit.noise import Division, divide
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose

DT, REST_S = 0.005, 1.0
BAND_HZ = (0.4, 12.0)
LAG_S = 0.012
SEEDS = (11, 12, 13)
YAW = ("delta_r", "r", [50.0], [1.0, 3.0], 0.1)
HEAVE = ("delta_c", "az", [-25.0, 0.0], [0.08, 1.0, 1.1], 0.1)
"""Command, output, numerator and denominator behind a lag, noise."""
AXES = {"delta_r": "yaw", "delta_c": "thrust"}


def swept(
    vehicle: tuple[str, str, list[float], list[float], float],
    *,
    amplitude: float = 0.05,
    band_hz: tuple[float, float] = (0.5, 8.0),
    duration_s: float = 15.0,
    seed: int,
) -> Record:
    """A run of one chirp."""
    command, output, numerator, denominator, noise = vehicle
    n, rest = round(duration_s / DT), round(REST_S / DT)
    law = Chirp(axis="yaw", law="tischler", f_start_hz=band_hz[0], f_stop_hz=band_hz[1], duration_s=duration_s)
    whole = np.zeros(n + 2 * rest)
    whole[rest : rest + n] = amplitude * law.wave(np.asarray(DT * np.arange(n), float))
    num, den, _ = cont2discrete((numerator, np.polymul(denominator, [LAG_S, 1.0]).tolist()), DT, "zoh")
    rng = np.random.default_rng(seed)
    channels: dict[str, FloatArray] = {
        "t": np.asarray(DT * np.arange(whole.size), float),
        "delta_x": 0 * whole,
        "delta_y": 0 * whole,
    }
    channels |= {name: 0.01 * rng.standard_normal(whole.size) for name in ("p", "q")}
    channels |= {command: whole, f"excitation_{command[-1]}": whole}
    channels[output] = lfilter(np.ravel(num), den, whole) + noise * rng.standard_normal(whole.size)
    axis = AXES[command]
    return Record(f"{axis}#{seed}", channels, maneuver="chirp", axis=axis, rate_source="SIDD", swept_band_hz=band_hz)


def rivals(
    runs: Sequence[Record], base: str, names: Sequence[str] = ("servo_lag", "transport_delay")
) -> tuple[list[Candidate], Division, Whitening]:
    """Refits on these runs, and the noise of the first."""
    outputs = compose(base, (), {"delta_r", "delta_c", "r", "az"}).outputs
    on = dataset(runs, BAND_HZ, outputs=outputs)
    structure = compose(base, (), on.available)
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    found = [refit(compose(base, [name], on.available), parent, [name]) for name in names]
    division = divide(found[0].estimate.error, on.stacks, on.causes)
    return found, division, noise_whitening(found[0].model, on.stacks, division)


def likelier(runs: Sequence[Record], base: str) -> float:
    """Chi squared by which the lag is likelier than the delay."""
    found, _, whitening = rivals(runs, base)
    first, second = (instrumental_step(one, whitening) for one in found)
    return gain(first, second)[0]


def flown_card(vehicle: Any, card: Mapping[str, Any], seed: int) -> list[Record]:
    """The maneuvers of a card."""
    return [
        swept(
            vehicle,
            amplitude=table["amplitude"],
            band_hz=(table["f_start_hz"], table["f_stop_hz"]),
            duration_s=table["duration_s"],
            seed=1000 * seed + number,
        )
        for table in card["maneuver"]
        for number in range(table["repeat"])
    ]


def proposed(vehicle: Any, base: str, seed: int = SEEDS[0]) -> NextManeuver:
    found = next_maneuver(*rivals([swept(vehicle, seed=seed)], base))
    assert found is not None
    return found


@pytest.mark.thorough
def test_the_card_proposed_for_yaw_tells_what_was_foretold() -> None:
    told = proposed(YAW, "yaw")
    assert told.card is not None
    assert told.toml is not None
    assert told.sigma is not None
    assert told.sigma >= 3
    (table, *_) = told.card["maneuver"]
    assert (table["kind"], table["axis"]) == ("chirp", "yaw")
    assert 0.05 <= table["amplitude"] <= 0.1
    assert parse_card(told.toml, "proposed").maneuvers[0].axis == "yaw"
    grown = []
    for seed in SEEDS:
        before = [swept(YAW, seed=seed)]
        grown.append(likelier([*before, *flown_card(YAW, told.card, seed)], "yaw") - likelier(before, "yaw"))
    assert float(np.mean(grown)) == pytest.approx(told.sigma**2, rel=0.6)


def test_thrust_is_swept_by_parameters_and_by_no_card() -> None:
    run = swept(HEAVE, seed=5)
    told = proposed(HEAVE, "heave", seed=5)
    assert isinstance(told.proposal, Plan)
    assert (told.proposal.axis, told.card, told.toml) == ("thrust", None, None)
    chirp = replace(told.proposal, kind="chirp")
    how = str(next_maneuver_document(replace(told, proposal=chirp), [run])["how"])
    assert "SID_AXIS 13" in how
    assert f"SID_MAGNITUDE {chirp.amplitude:.3g}" in how
    theirs = {source: how_text(chirp, [replace(run, rate_source=source)]) for source in ("gyroADC", "csv")}
    assert theirs["csv"] is None
    assert "throttle stick" in str(theirs["gyroADC"])
    assert how_text(chirp, [run, replace(run, rate_source="csv")]) is None
    rotorflight = replace(run, rate_source="gyroADC", airframe=Airframe.HELICOPTER)
    assert how_text(chirp, [rotorflight]) is None
    assert "a pulse each way" in str(how_text(replace(chirp, kind="doublet"), [run]))


def test_thrust_may_grow_as_far_as_rotors_stay_loaded() -> None:
    (one, _), _, _ = rivals([swept(HEAVE, seed=5)], "heave")
    assert Flown.of(one).axes == ("thrust",)
    assert Flown.of(one).most_times == 2
    strong = (*HEAVE[:2], [-55.0, 0.0], *HEAVE[3:])
    run = swept(strong, seed=5)
    (one, _), _, _ = rivals([run], "heave")
    assert Flown.of(one).most_times == pytest.approx(LARGEST_FORCE / np.max(np.abs(run.channels["az"])), rel=0.01)
    hovering = replace(run, channels={**run.channels, "delta_c": run.channels["delta_c"] + 0.68})
    (one, _), _, _ = rivals([hovering], "heave")
    assert Flown.of(one).most_times == pytest.approx((0.72 - 0.68) / 0.05, rel=0.06)


def test_a_hand_or_an_elevator_is_not_asked_of_a_yaw_sweep() -> None:
    run = swept(YAW, seed=5)
    moved = replace(run, channels={**run.channels, "delta_e": 0.1 * np.sin(run.t), "delta_c": 0.3 + 0 * run.t})
    found, _, _ = rivals([moved], "yaw")
    plans = possible_plans(Flown.of(found[0]), found)
    assert {plan.axis for plan in plans} == {"yaw"}


@pytest.mark.parametrize(("vehicle", "base", "axis"), [(YAW, "yaw", "yaw"), (HEAVE, "heave", "thrust")])
def test_an_unexplained_error_asks_for_half_the_amplitude(vehicle: Any, base: str, axis: str) -> None:
    run = swept(vehicle, seed=6)
    output = vehicle[1]
    bent = replace(run, channels={**run.channels, output: run.channels[output] * np.abs(run.channels[output])})
    on = dataset([bent], BAND_HZ, outputs=(output,))
    structure = compose(base, (), on.available)
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    told = linear_or_not(parent, divide(parent.estimate.error, on.stacks, on.causes))
    assert told is not None
    assert f"{axis} chirps at half the amplitude (0.025)" in proposal_text(told.proposal)
    assert (told.card is None) == (axis == "thrust")

"""The probe against the simulated vehicle, made-up vehicles and real logs: right passes, wrong is named.

The vehicle flies as fast as it computes and its log is read as the app reads it. Faults are planted in the samples.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from flying import log_of
from more_of_a_kind import thorough
from numpy.typing import NDArray
from scipy import signal

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver, TestCard, load_card
from gcs.flight.live import LiveLog, LiveWindow
from gcs.flight.probe import (
    ProbeResult,
    ProbeStep,
    largest_amplitude,
    probe_card,
    result_document,
    result_words,
)
from gcs.flight.probe.card import FRACTION, LEAST_AMPLITUDE
from gcs.flight.probe.judge import judge_probe
from gcs.flight.probe.prediction import predicted_attitude
from gcs.flight.verdict import cut
from gcs.logs import ingest
from gcs.vehicle.profile import VehicleProfile, bundled_profiles
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import DT, make_vehicle

FloatArray = NDArray[np.float64]
Samples = dict[str, FloatArray]
Probe = tuple[Samples, tuple[ProbeStep, ...]]

TABLE_1 = next(profile for profile in bundled_profiles() if profile.chirp_law == "table 1")
STOCK = next(profile for profile in bundled_profiles() if not profile.kinds)
CARD = load_card("hover")


# ------------------------------------------------------------------------------------------------ what is flown


def test_a_part_of_the_largest_amplitude_on_each_axis_is_flown_as_a_doublet() -> None:
    card = replace(
        CARD, maneuvers=(*CARD.maneuvers, Maneuver(kind="doublet", axis="roll", amplitude=0.2, duration_s=6.0))
    )
    flown = probe_card(card, TABLE_1).maneuvers
    assert [(m.kind, m.axis) for m in flown] == [("doublet", "roll"), ("doublet", "pitch")]
    assert [m.amplitude for m in flown] == pytest.approx([0.04, 0.03])
    assert [m.amplitude for m in probe_card(card, TABLE_1, fraction=0.3).maneuvers] == pytest.approx([0.06, 0.045])


def test_a_stock_vehicle_flies_a_short_narrow_chirp() -> None:
    flown = probe_card(CARD, STOCK).maneuvers
    assert [(m.kind, m.axis, m.f_start_hz, m.f_stop_hz) for m in flown] == [
        ("chirp", "roll", 1.0, 2.0),
        ("chirp", "pitch", 1.0, 2.0),
    ]


@pytest.mark.parametrize("vehicle", [TABLE_1, STOCK])
@pytest.mark.parametrize("amplitude", [1e-9, 1e-4, 0.03, 1.0])
def test_every_probe_can_be_flown_and_is_no_larger_than_its_card(vehicle: VehicleProfile, amplitude: float) -> None:
    card = TestCard(
        name="small", maneuvers=(Maneuver(kind="chirp", axis="roll", amplitude=amplitude, duration_s=30.0),)
    )
    (maneuver,) = probe_card(card, vehicle).maneuvers
    assert vehicle.plan(maneuver).maneuver == maneuver
    assert 0 < maneuver.amplitude <= amplitude
    assert maneuver.amplitude == pytest.approx(min(amplitude, max(LEAST_AMPLITUDE, FRACTION * amplitude)))


def test_rates_asked_for_and_quiet_runs_need_no_probe() -> None:
    card = TestCard(
        name="none",
        maneuvers=(
            Maneuver(kind="doublet", axis="roll", amplitude=0.3, duration_s=9.0, target="rate"),
            Maneuver(kind="quiet"),
        ),
    )
    assert probe_card(card, TABLE_1).maneuvers == ()
    assert [m.axis for m in probe_card(load_card("forward"), TABLE_1).maneuvers] == ["roll", "pitch", "elevator"]
    assert [m.axis for m in probe_card(load_card("forward"), STOCK).maneuvers] == ["roll", "pitch"]


# ------------------------------------------------------------------------------------------------ the simulated vehicle


def window_of(log: Path) -> LiveWindow:
    data = log.read_bytes()
    live = LiveLog(keep_s=120.0, rate_hz=520.0)
    for at in range(0, len(data), 200):
        live.feed(at // 200, data[at : at + 200])
    return live.window(1e6)


@cache
def flown(
    plant: str, seed: int, fraction: float = 0.1, gusts: float = 1.0, stock: bool = False, card: str = "hover"
) -> Probe:
    """Five seconds of hover and the steps, the true attitude beside them; as a `stock` vehicle flies and logs."""
    profile = STOCK if stock else TABLE_1
    attitude: list[tuple[float, float, float]] = []
    with TemporaryDirectory() as folder:
        vehicle = make_vehicle(plant, seed=seed, directory=Path(folder), gust_scale=gusts)

        def fly(steps: int) -> None:
            for _ in range(steps):
                attitude.append((vehicle.time_s, vehicle.plant.phi, vehicle.plant.theta))
                vehicle.step()

        fly(1000)
        spans = [(vehicle.time_s, vehicle.time_s + 5.0)]
        fly(2500)
        maneuvers = probe_card(load_card(card), profile, fraction).maneuvers
        for maneuver in maneuvers:
            plan = profile.plan(maneuver)
            vehicle.write_parameter("SIDX_LAW", 0)
            vehicle.write_parameter("SIDX_KIND", 0)
            for name, value in plan.writes:
                assert vehicle.write_parameter(name, value) is not None
            assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
            spans.append((vehicle.time_s, vehicle.time_s + plan.over_s + 0.9))
            fly(round((plan.finished_s + 0.5) / DT))
            assert not vehicle.sweeping
            assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
            fly(1000)
        window = window_of(log_of(vehicle, Path(folder)))
    t, phi, theta = np.array(attitude).T
    pieces = []
    for start, stop in spans:
        piece = cut(window, start, stop)
        piece["phi"], piece["theta"] = np.interp(piece["t"], t, phi), np.interp(piece["t"], t, theta)
        if stock:
            piece |= {name: np.full(piece["t"].size, np.nan) for name in ("excitation_x", "excitation_y")}
        pieces.append(piece)
    steps = [
        ProbeStep(maneuver, piece, start + profile.lead_s)
        for maneuver, piece, (start, _) in zip(maneuvers, pieces[1:], spans[1:], strict=True)
    ]
    return pieces[0], tuple(steps)


@cache
def sound(*probe: Any) -> ProbeResult:
    return judge_probe(*flown(*probe), 500.0)


def kinds(result: ProbeResult) -> set[tuple[str, str | None]]:
    return {(finding.kind, finding.axis) for finding in result.findings if finding.serious}


@pytest.mark.parametrize(
    ("plant", "seed", "fraction", "gusts", "stock"),
    [
        ("hover-ideal", 102, 0.1, 0.5, True),
        ("hover", 101, 0.3, 1.0, False),
        *thorough(
            [
                ("hover-ideal", 101, 0.1, 1.0, False),
                ("hover-ideal", 103, 0.2, 2.0, False),
                ("hover", 102, 0.2, 0.5, False),
                ("hover", 103, 0.3, 1.0, True),
            ]
        ),
    ],
)
def test_a_sound_vehicle_is_in_order(plant: str, seed: int, fraction: float, gusts: float, stock: bool) -> None:
    result = sound(plant, seed, fraction, gusts, stock)
    assert not result.wrong, result_words(result)
    assert result.ok, result_words(result)
    assert [answer.axis for answer in result.answers] == ["roll", "pitch"]
    # Table 4 in steady state is turned by -18 degrees with rows of one length
    assert result.turn_deg is not None
    assert abs(result.turn_deg + 18) < 30
    roll, pitch = result.answers
    assert roll.gain is not None
    assert pitch.gain is not None
    assert (roll.rate, pitch.rate) == ("p", "q")
    assert 2.0 < roll.gain < 8.5
    assert 1.1 < pitch.gain < 5.0
    json.dumps(result_document(result), allow_nan=False)


def test_what_does_not_stand_out_of_the_noise_is_neither_right_nor_wrong() -> None:
    quiet, steps = flown("hover-ideal", 101, 0.1, 1.0)
    deaf = []
    for step in steps:
        # what hover gives by itself, with the commands of a step
        at = slice(0, step.samples["t"].size)
        part = {name: np.resize(quiet[name], step.samples["t"].size) for name in ("p", "q")}
        deaf.append(replace(step, samples={**step.samples, **{name: part[name][at] for name in part}}))
    result = judge_probe(quiet, deaf, 500.0)
    assert not result.wrong, result_words(result)
    assert not result.ok
    assert [answer.seen for answer in result.answers] == [False, False]
    assert [answer.gain for answer in result.answers] == [None, None]
    assert {(f.kind, f.axis) for f in result.findings} == {("unseen", "roll"), ("unseen", "pitch")}
    assert any("not seen above the noise" in line for line in result_words(result))
    assert largest_amplitude(result, Limits(), 0.3, CARD.maneuvers[0]) is None


def test_an_elevator_is_seen_and_its_sign_is_left_alone() -> None:
    quiet, steps = flown("forward", 1, 0.2, card="forward")
    result = judge_probe(quiet, steps, 500.0)
    assert not result.wrong, result_words(result)
    answer = result.answers[-1]
    assert (answer.axis, answer.rate, answer.seen) == ("elevator", "q", True)
    other = [replace(steps[-1], samples={**steps[-1].samples, "q": -steps[-1].samples["q"]})]
    turned = judge_probe(quiet, other, 500.0)
    assert not turned.wrong
    assert turned.answers[0].gain == pytest.approx(-(answer.gain or 0.0), rel=0.05)


# ------------------------------------------------------------------------------------------------ planted faults

Fault = Callable[[Samples], Mapping[str, FloatArray]]


def faulty(probe: Probe, fault: Fault) -> Probe:
    quiet, steps = probe
    return dict(fault(quiet)), tuple(replace(step, samples=fault(dict(step.samples))) for step in steps)


def exchanged(samples: Samples, *pairs: tuple[str, str]) -> Samples:
    out = dict(samples)
    for one, other in pairs:
        out[one], out[other] = samples[other], samples[one]
    return out


def negated(samples: Samples, *names: str) -> Samples:
    return {**samples, **{name: -samples[name] for name in names}}


def without_attitude(samples: Samples) -> Samples:
    return {name: values for name, values in samples.items() if name not in ("phi", "theta")}


def later(samples: Samples, delay_s: float) -> Samples:
    n = round(delay_s / DT)
    return {**samples, **{k: np.concatenate([samples[k][:n], samples[k][:-n]]) for k in ("p", "q")}}


def holed(samples: Samples) -> Samples:
    keep = (np.arange(samples["t"].size) // 40) % 12 != 0
    return {name: values[keep] for name, values in samples.items()}


PROBES = [("hover-ideal", 101, 0.1, 1.0), ("hover", 101, 0.3, 1.0)]

FAULTS: dict[str, tuple[Fault, set[tuple[str, str | None]], str]] = {
    "gyro p": (lambda s: negated(s, "p"), {("reversed", "roll")}, "the gyro is"),
    "gyro q": (lambda s: negated(s, "q"), {("reversed", "pitch")}, "the gyro is"),
    "both gyros": (lambda s: negated(s, "p", "q"), {("reversed", "roll"), ("reversed", "pitch")}, "the gyro is"),
    "no attitude": (lambda s: negated(without_attitude(s), "p"), {("reversed", "roll")}, "does not tell which"),
    "servo x": (lambda s: negated(s, "delta_x", "excitation_x"), {("reversed", "roll")}, "the command more likely"),
    "mixing y": (lambda s: negated(s, "delta_y"), {("reversed", "pitch")}, "look at the mixing"),
    "gyro axes": (lambda s: exchanged(s, ("p", "q")), {("swapped", None)}, "the gyro's axes"),
    "gyro turned": (lambda s: negated(exchanged(s, ("p", "q")), "q"), {("swapped", None)}, "p answers delta_y"),
    "mixing axes": (lambda s: exchanged(s, ("delta_x", "delta_y")), {("swapped", None)}, "look at the mixing"),
    "frozen p": (lambda s: {**s, "p": np.full(s["t"].size, 0.01)}, {("frozen", "p")}, "p stands still"),
    "frozen q": (lambda s: {**s, "q": np.zeros(s["t"].size)}, {("frozen", "q")}, "q stands still"),
    "0.2 s": (lambda s: later(s, 0.2), {("late", "pitch")}, "ms after the command"),
    "gaps": (holed, {("gaps", None), ("gaps", "roll"), ("gaps", "pitch")}, "gaps in the log"),
    "command": (
        lambda s: {**s, "delta_x": np.full(s["t"].size, 0.1)},
        {("no excitation", "roll")},
        "delta_x did not move",
    ),
    "nothing added": (
        lambda s: {**s, "excitation_y": np.zeros(s["t"].size)},
        {("no excitation", "pitch")},
        "no step was flown",
    ),
}


IN_PLAY = ("gyro p", "mixing y", "gyro axes", "gyro turned", "0.2 s")
"""Planted in the vehicle with play and servos, too."""


ALIKE = ("gyro q", "frozen q", "mixing axes")
"""Another axis of what is planted anyway."""


def thorough_where(more: bool, *values: object) -> Any:
    return pytest.param(*values, marks=[pytest.mark.thorough] if more else [])


@pytest.mark.parametrize(
    ("probe", "fault"),
    [
        *(thorough_where(fault in ALIKE, PROBES[0], fault) for fault in FAULTS),
        *(thorough_where(fault in ("gyro p", "gyro axes"), PROBES[1], fault) for fault in IN_PLAY),
    ],
)
def test_a_planted_fault_is_named_and_nothing_else(probe: tuple[str, int, float, float], fault: str) -> None:
    plant, expected, words = FAULTS[fault]
    assert not sound(*probe).wrong
    result = judge_probe(*faulty(flown(*probe), plant), 500.0)
    if fault == "0.2 s":  # a tenth of the amplitude is too little to be sure of a delay in gusts: it "seems" late
        assert kinds(result) <= {("late", "roll"), ("late", "pitch")}, result_words(result)
        assert bool(kinds(result)) == (probe[2] > 0.1)
    else:
        assert not result.ok
        assert kinds(result) == expected, result_words(result)
    assert words in " ".join(result_words(result))


@pytest.mark.parametrize("probe", [PROBES[0], pytest.param(PROBES[1], marks=pytest.mark.thorough)])
def test_degrees_are_told_by_the_hover_and_by_the_answer(probe: tuple[str, int, float, float]) -> None:
    def degrees(samples: Samples) -> Samples:
        return {**samples, "p": np.degrees(samples["p"]), "q": np.degrees(samples["q"])}

    quiet, steps = flown(*probe)
    assert kinds(judge_probe(*faulty((quiet, steps), degrees), 500.0)) == {("units", "p"), ("units", "q")}
    _, in_degrees = faulty((quiet, steps), degrees)
    only_steps = judge_probe(quiet, in_degrees, 500.0)
    assert ("units", "p") in kinds(only_steps), result_words(only_steps)


def test_more_noise_than_usual_is_said_and_wrong_is_something_else() -> None:
    quiet, steps = flown("hover-ideal", 101, 0.1, 1.0)
    usual = sound("hover-ideal", 101, 0.1, 1.0).noise
    rng = np.random.default_rng(5)

    def noisy(samples: Samples) -> Samples:
        return {**samples, "q": samples["q"] + rng.normal(0, 1.8 * usual["q"], samples["t"].size)}

    result = judge_probe(*faulty((quiet, steps), noisy), 500.0, usual)
    assert [(f.kind, f.axis, f.serious) for f in result.findings if f.kind == "noisy"] == [("noisy", "q", False)]
    assert not result.wrong
    assert not [f for f in judge_probe(quiet, steps, 500.0, usual).findings if f.kind == "noisy"]


def test_the_log_s_rate_is_judged_by_what_it_should_be() -> None:
    quiet, steps = flown("hover-ideal", 101, 0.1, 1.0)

    def thinned(every: int) -> Probe:
        return faulty((quiet, steps), lambda s: {name: values[::every] for name, values in s.items()})

    slower = judge_probe(*thinned(5), 500.0)
    assert slower.rate_hz == pytest.approx(100.0)
    assert slower.ok, result_words(slower)
    assert ("slow log", None) in {(f.kind, f.axis) for f in slower.findings}
    assert not judge_probe(*thinned(5), 100.0).findings
    assert ("slow log", None) in kinds(judge_probe(*thinned(25), 20.0))


@pytest.mark.parametrize("size", [0, 1, 2, 30])
def test_no_samples_at_all_are_said(size: int) -> None:
    probe = faulty(flown("hover-ideal", 101, 0.1, 1.0), lambda s: {name: values[:size] for name, values in s.items()})
    result = judge_probe(*probe, 500.0)
    assert {("no samples", None), ("no samples", "roll"), ("no samples", "pitch")} <= kinds(result)
    assert result.answers == ()
    json.dumps(result_document(result), allow_nan=False)


def test_channels_that_are_not_logged_are_no_crash() -> None:
    def nothing(samples: Samples) -> Samples:
        return {name: values if name == "t" else np.full(values.size, np.nan) for name, values in samples.items()}

    result = judge_probe(*faulty(flown("hover-ideal", 101, 0.1, 1.0), nothing), 500.0)
    assert not result.ok
    assert result.answers == ()


def test_one_axis_alone_is_judged_by_itself() -> None:
    quiet, steps = flown("hover-ideal", 101, 0.1, 1.0)
    result = judge_probe(quiet, steps[:1], 500.0)
    assert result.ok, result_words(result)
    assert result.turn_deg is None
    flipped = faulty((quiet, steps[:1]), lambda s: negated(s, "p", "q"))
    assert kinds(judge_probe(*flipped, 500.0)) == {("reversed", "roll")}


# ------------------------------------------------------------------------------------------------ made-up vehicles


def made_up(
    gains: FloatArray, poles: tuple[float, float], delay_s: float = 0.0, stock: bool = False, noise: float = 0.02
) -> Probe:
    """Rates y with y' = poles y + gains delta (late), under weak feedback of rates and attitude; 500 Hz."""
    rng = np.random.default_rng(3)
    profile = STOCK if stock else TABLE_1
    late = round(delay_s / DT)

    (g_xx, g_xy), (g_yx, g_yy) = gains.tolist()
    pole_x, pole_y = poles

    def fly(added: FloatArray) -> Samples:
        p = q = phi = theta = gust_p = gust_q = 0.0
        sent = [(0.0, 0.0)] * late
        rows = []
        drawn = rng.standard_normal((len(added), 4)) * (noise, noise, 0.001, 0.001)
        for (e_x, e_y), (n_p, n_q, more_p, more_q) in zip(added.tolist(), drawn.tolist(), strict=True):
            u_x, u_y = e_x - 0.02 * p - 0.05 * phi, e_y - 0.02 * q - 0.05 * theta
            rows.append((p + n_p, q + n_q, u_x, u_y, e_x, e_y, phi, theta))
            sent.append((u_x, u_y))
            x, y = sent.pop(0)
            gust_p, gust_q = 0.99 * gust_p + more_p, 0.99 * gust_q + more_q
            p += DT * (pole_x * p + g_xx * x + g_xy * y + gust_p)
            q += DT * (pole_y * q + g_yx * x + g_yy * y + gust_q)
            phi, theta = phi + DT * p, theta + DT * q
        names = ("p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y", "phi", "theta")
        samples = dict(zip(names, np.array(rows).T, strict=True))
        if stock:
            samples |= {name: np.full(len(rows), np.nan) for name in ("excitation_x", "excitation_y")}
        return {"t": 100 + np.arange(len(rows)) * DT, **samples}

    steps = []
    for axis, maneuver in enumerate(probe_card(CARD, profile).maneuvers):
        t = np.arange(round((maneuver.duration_s + 2) / DT)) * DT - 1
        if stock:
            wave = signal.chirp(np.clip(t, 0, None), 1.0, maneuver.duration_s, 2.0, phi=-90)
        else:
            pulse = np.floor(t / maneuver.pulse_s) % 6
            wave = np.select([pulse == 0, pulse == 1], [1.0, -1.0], 0.0)
        added = np.zeros((t.size, 2))
        added[:, axis] = maneuver.amplitude * wave * ((t >= 0) & (t < maneuver.duration_s))
        steps.append(ProbeStep(maneuver, fly(added), 101.0))
    return fly(np.zeros((2500, 2))), tuple(steps)


@pytest.mark.parametrize(
    ("gains", "poles", "stock"),
    [
        ((150.0, 120.0), (-10.0, -10.0), False),
        ((60.0, 40.0), (0.0, 0.0), False),
        ((30.0, 25.0), (-0.5, -0.3), True),
        pytest.param((150.0, 120.0), (-10.0, -10.0), True, marks=pytest.mark.thorough),
        pytest.param((60.0, 40.0), (0.0, 0.0), True, marks=pytest.mark.thorough),
        pytest.param((30.0, 25.0), (-0.5, -0.3), False, marks=pytest.mark.thorough),
    ],
)
def test_a_vehicle_without_coupling_is_in_order(
    gains: tuple[float, float], poles: tuple[float, float], stock: bool
) -> None:
    result = judge_probe(*made_up(np.diag(gains), poles, stock=stock), 500.0)
    assert result.ok, result_words(result)
    assert result.turn_deg == pytest.approx(0.0, abs=10.0)
    for answer, gain, pole in zip(result.answers, gains, poles, strict=True):
        step = gain * (0.5 if pole == 0 else np.expm1(pole * 0.5) / pole)
        assert answer.gain == pytest.approx(step, rel=0.2)
        assert answer.delay_s is not None
        assert answer.delay_s < 0.05


def test_an_unstable_vehicle_has_the_sign_of_its_answer() -> None:
    """Its gain at no frequency at all would be negative."""
    result = judge_probe(*made_up(np.diag([60.0, 40.0]), (0.8, 0.8), noise=0.01), 500.0)
    assert not result.wrong, result_words(result)


@pytest.mark.parametrize("stock", [*thorough([False]), True])
def test_a_delay_is_measured(stock: bool) -> None:
    result = judge_probe(*made_up(np.diag([60.0, 40.0]), (-5.0, -5.0), 0.06, stock), 500.0)
    assert result.ok, result_words(result)
    for answer in result.answers:
        assert answer.delay_s == pytest.approx(0.06, abs=0.02)
    late = judge_probe(*made_up(np.diag([60.0, 40.0]), (-5.0, -5.0), 0.25, stock), 500.0)
    assert kinds(late) == {("late", "roll"), ("late", "pitch")}, result_words(late)


@pytest.mark.parametrize(("turn", "kind"), [(40.0, None), (52.0, "turned"), (90.0, "swapped"), (-90.0, "swapped")])
def test_a_swashplate_that_is_turned_is_measured(turn: float, kind: str | None) -> None:
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    result = judge_probe(*made_up(50 * np.array([[c, -s], [s, c]]), (-5.0, -5.0)), 500.0)
    assert result.turn_deg == pytest.approx(turn, abs=6.0)
    assert {finding.kind for finding in result.findings} == ({kind} if kind else set())
    assert result.wrong == (kind == "swapped")


# ------------------------------------------------------------------------------------------------ how much is safe


@pytest.mark.parametrize(("axis", "amplitude"), [("roll", 0.1), ("pitch", 0.15)])
def test_the_card_stays_within_what_is_predicted_of_it(axis: str, amplitude: float) -> None:
    result = sound("hover-ideal", 101, 0.1, 1.0)
    answer = next(answer for answer in result.answers if answer.axis == axis)
    maneuver = Maneuver(kind="chirp", axis=axis, amplitude=amplitude, duration_s=15.0)
    vehicle = make_vehicle("hover-ideal", seed=7)
    for name, value in TABLE_1.plan(maneuver).writes:
        vehicle.write_parameter(name, value)
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    peaks = np.zeros(4)
    while vehicle.sweeping:
        vehicle.step()
        plant = vehicle.plant
        peaks = np.maximum(peaks, np.abs([plant.p, plant.q, plant.phi, plant.theta]))
    assert answer.peak_rate is not None
    assert max(peaks[:2]) < 1.25 * answer.peak_rate * amplitude
    assert max(peaks[:2]) > 0.5 * answer.peak_rate * amplitude
    attitude = predicted_attitude(answer, maneuver, 0.3) * amplitude
    assert 0.25 * attitude < max(peaks[2:]) < attitude


def test_a_slower_abort_allows_less_and_so_do_tighter_limits() -> None:
    result = sound("hover-ideal", 101, 0.1, 1.0)
    chirp = CARD.maneuvers[0]
    caps = [largest_amplitude(result, Limits(), abort_s, chirp) or 0.0 for abort_s in (0.0, 0.1, 0.3)]
    assert caps[0] > caps[1] > caps[2] > 0
    tight = largest_amplitude(result, Limits(attitude=0.1), 0.3, chirp) or 0.0
    assert tight == pytest.approx(caps[2] * 0.1 / Limits().attitude)
    slow = largest_amplitude(result, Limits(rate=0.2), 0.0, chirp) or 0.0
    assert slow * (result.answers[0].peak_rate or 0.0) * 1.25 == pytest.approx(0.2)
    assert largest_amplitude(result, Limits(), 0.3, Maneuver(kind="chirp", axis="elevator", amplitude=0.1)) is None
    higher = largest_amplitude(result, Limits(), 0.3, replace(chirp, f_start_hz=0.25)) or 1.0
    assert higher < caps[2]


# ------------------------------------------------------------------------------------------------ real autopilots


@pytest.mark.data
@pytest.mark.parametrize("vehicle", [pytest.param("quad", marks=pytest.mark.thorough), "heli"])
def test_eight_seconds_of_a_real_autopilot_s_sweep_are_in_order(shared_data: Path, vehicle: str) -> None:
    """From 1 Hz on; nothing of what was added is in the samples. The helicopter's servos are 50 ms late."""
    steps, quiet = [], None
    for axis in ("roll", "pitch"):
        log = shared_data / "ardupilot" / f"{vehicle}_{axis}_sweep.BIN"
        (run,) = ingest([log]).runs
        window = window_of(log)
        if quiet is None:
            quiet = cut(window, float(window.t[0]), run.start_s - 0.2)
        piece = cut(window, run.start_s + 17.0, run.start_s + 25.0)
        steps.append(
            ProbeStep(
                Maneuver(kind="chirp", axis=axis, amplitude=0.05, duration_s=8.0, f_start_hz=1.0, f_stop_hz=1.5), piece
            )
        )
    assert quiet is not None
    result = judge_probe(quiet, steps, 400.0)
    assert not result.wrong, result_words(result)
    assert all(answer.seen for answer in result.answers), result_words(result)
    flipped = [replace(step, samples=negated(dict(step.samples), "q")) for step in steps]
    assert ("reversed", "pitch") in kinds(judge_probe(quiet, flipped, 400.0))

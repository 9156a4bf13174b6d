"""Keep or fly again: samples, envelope, excitation. Coherence is checked against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from gcs.cards.envelope import Limits, Peaks
from gcs.cards.maneuver import Maneuver
from gcs.flight.live import LiveWindow
from gcs.flight.verdict import cut, judge
from gcs.vehicle.profile import Plan, bundled_profiles
from sysid.data.coherence import coherence

RATE_HZ = 500.0
PROFILE = bundled_profiles()[0]
CHIRP = PROFILE.plan(Maneuver(kind="chirp", axis="pitch", amplitude=0.15, duration_s=30.0))
DOUBLET = PROFILE.plan(Maneuver(kind="doublet", axis="roll", amplitude=0.1, duration_s=6.0))
Samples = dict[str, NDArray[np.float64]]


def flown(plan: Plan, noise: float = 0.01, gain: float = 4.0) -> Samples:
    rng = np.random.default_rng(2)
    t = np.arange(round(plan.maneuver.duration_s * RATE_HZ)) / RATE_HZ
    if plan.maneuver.kind == "chirp":
        u = plan.maneuver.amplitude * signal.chirp(t, 0.5, t[-1], 10.0, "logarithmic")
    else:
        pulse = (t / plan.maneuver.pulse_s).astype(int) % 6
        u = plan.maneuver.amplitude * np.select([pulse == 0, pulse == 1], [1.0, -1.0], 0.0)
    b, a = signal.butter(2, 6.0, fs=RATE_HZ)
    answer = gain * signal.lfilter(b, a, u) + rng.normal(0, noise, t.size)
    rest = rng.normal(0, noise, t.size)
    zero = np.zeros(t.size)
    on_pitch = plan.maneuver.axis == "pitch"
    return {
        "t": t,
        "p": rest if on_pitch else answer,
        "q": answer if on_pitch else rest,
        "delta_x": zero if on_pitch else u,
        "delta_y": u if on_pitch else zero,
        "excitation_x": np.full(t.size, np.nan),
        "excitation_y": u if on_pitch else np.full(t.size, np.nan),
    }


def without(samples: Samples, start: int, stop: int) -> Samples:
    keep = np.ones(samples["t"].size, bool)
    keep[start:stop] = False
    return {name: values[keep] for name, values in samples.items()}


@pytest.mark.parametrize("plan", [CHIRP, DOUBLET])
def test_a_good_run_is_kept(plan: Plan) -> None:
    verdict = judge(plan, Limits(), Peaks(p=0.5), flown(plan), RATE_HZ)
    assert verdict.keep, verdict.reasons
    assert (verdict.missing, verdict.gaps) == (0, 0)
    assert "keep" in verdict.words


def test_the_coherent_band_is_where_the_answer_stands_out_of_the_noise() -> None:
    clear = judge(CHIRP, Limits(), Peaks(), flown(CHIRP, noise=0.01), RATE_HZ)
    noisy = judge(CHIRP, Limits(), Peaks(), flown(CHIRP, noise=3.0), RATE_HZ)
    assert clear.coherent_hz is not None
    assert clear.coherent_hz[0] <= 0.75
    assert clear.coherent_hz[1] > 9.0
    assert clear.coherent_share is not None
    assert noisy.coherent_share is not None
    assert noisy.coherent_share < clear.coherent_share - 0.2
    assert not noisy.keep


def test_coherence_is_scipys() -> None:
    samples = flown(CHIRP, noise=0.3)
    u, y = samples["delta_y"] - samples["delta_y"].mean(), samples["q"] - samples["q"].mean()
    n = 1000
    _, theirs = signal.coherence(u, y, RATE_HZ, np.hanning(n), n, n // 2, detrend=False)
    ours = coherence(samples["delta_y"], samples["q"], n)
    assert np.allclose(ours[1:-1], theirs[1:-1], atol=1e-6)


def test_missing_samples_are_counted_and_flown_again() -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), without(flown(CHIRP), 5000, 5400), RATE_HZ)
    assert (verdict.keep, verdict.missing, verdict.gaps) == (False, 400, 1)
    assert "400 of 15000 samples are missing" in verdict.reasons


def test_a_few_missing_samples_do_no_harm_but_are_counted() -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), without(flown(CHIRP), 5000, 5004), RATE_HZ)
    assert (verdict.keep, verdict.missing, verdict.gaps) == (True, 4, 1)


def test_no_samples_at_all() -> None:
    nothing = {name: values[:0] for name, values in flown(CHIRP).items()}
    for rate in (RATE_HZ, None):
        verdict = judge(CHIRP, Limits(), Peaks(), nothing, rate)
        assert verdict.reasons == ("no samples came",)


def test_beyond_the_limits_is_flown_again() -> None:
    verdict = judge(CHIRP, Limits(rate=1.0), Peaks(q=1.5), flown(CHIRP), RATE_HZ)
    assert verdict.reasons == ("150 % of the limits",)


def test_a_run_that_was_interrupted_says_so_first() -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), flown(CHIRP), RATE_HZ, interruption="aborted: Ctrl-C")
    assert verdict.reasons == ("aborted: Ctrl-C",)
    assert verdict.coherent_hz is None


def test_a_doublet_that_was_not_flown_or_not_answered_is_told() -> None:
    still = flown(DOUBLET)
    still["delta_x"] = np.zeros_like(still["t"])
    assert "no doublet was flown" in judge(DOUBLET, Limits(), Peaks(), still, RATE_HZ).reasons[0]
    deaf = flown(DOUBLET, gain=0.0, noise=0.004)
    assert "did not answer" in judge(DOUBLET, Limits(), Peaks(), deaf, RATE_HZ).reasons[0]


def test_a_window_is_cut_to_the_maneuver() -> None:
    t = np.arange(0, 10, 0.01)
    window = LiveWindow(t=t, p=t, q=t, delta_x=t, delta_y=t, excitation_x=t, excitation_y=t)
    samples = cut(window, 2.0, 3.0)
    assert samples["t"][0] == pytest.approx(2.0)
    assert samples["t"][-1] == pytest.approx(3.0)
    assert np.array_equal(samples["q"], samples["t"])


def test_an_elevator_chirp_is_judged_by_the_elevator() -> None:
    plan = PROFILE.plan(Maneuver(kind="chirp", axis="elevator", amplitude=0.3, duration_s=30.0))
    answered = flown(CHIRP)
    answered["excitation_e"] = answered.pop("excitation_y")
    answered["delta_e"] = answered["excitation_e"]
    answered["excitation_y"] = answered["delta_y"] = np.zeros_like(answered["t"])
    assert judge(plan, Limits(), Peaks(), answered, RATE_HZ).keep
    unknown = {name: values for name, values in answered.items() if not name.endswith("_e")}
    assert not judge(plan, Limits(), Peaks(), unknown, RATE_HZ).keep


@pytest.mark.parametrize("plan", [CHIRP, DOUBLET])
def test_a_log_that_ends_before_the_run_did_is_said_and_flown_again(plan: Plan) -> None:
    samples = flown(plan)
    short = without(samples, samples["t"].size - 1600, samples["t"].size)
    verdict = judge(plan, Limits(), Peaks(), short, RATE_HZ, start_s=0.0)
    assert not verdict.keep
    assert verdict.ends_early_s == pytest.approx(3.2)
    assert verdict.reasons[0] == (
        f"the log ends 3.2 s before the run did (1600 of {samples['t'].size} samples are missing)"
    )
    assert "gaps 0, 3.2 s missing at the end" in verdict.words
    assert verdict.to_json()["ends_early_s"] == pytest.approx(3.2)


def test_a_long_runs_last_half_second_counts_though_it_is_under_a_hundredth() -> None:
    plan = PROFILE.plan(Maneuver(kind="chirp", axis="pitch", amplitude=0.15, duration_s=60.0))
    samples = flown(plan)
    verdict = judge(plan, Limits(), Peaks(), without(samples, samples["t"].size - 250, 30_000), RATE_HZ, start_s=0.0)
    assert verdict.reasons == ("the log ends 0.5 s before the run did (250 of 30000 samples are missing)",)


@pytest.mark.parametrize("late", [-2, 0, 2])
def test_a_sample_more_or_less_at_the_end_is_no_early_end(late: int) -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), flown(CHIRP), RATE_HZ, start_s=late / RATE_HZ)
    assert verdict.keep
    assert verdict.ends_early_s == 0.0
    assert "gaps 0 " in verdict.words


def test_samples_missing_at_the_beginning_are_not_called_an_early_end() -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), without(flown(CHIRP), 0, 1600), RATE_HZ, start_s=0.0)
    assert verdict.reasons == ("1600 of 15000 samples are missing",)
    assert verdict.ends_early_s == 0.0


def test_where_no_sample_came_no_gaps_are_counted() -> None:
    nothing = {name: values[:0] for name, values in flown(CHIRP).items()}
    for interruption in (None, "link lost: the link was lost"):
        words = judge(CHIRP, Limits(), Peaks(), nothing, RATE_HZ, interruption=interruption, start_s=0.0).words
        assert "gaps" not in words
        assert "no samples" in words


def every(samples: Samples, step: int) -> Samples:
    return {name: values[::step] for name, values in samples.items()}


def test_a_log_slower_than_the_loop_is_judged_by_what_the_sweep_needs() -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), every(flown(CHIRP), 5), RATE_HZ)
    assert verdict.keep, verdict.reasons
    assert (verdict.missing, verdict.expected, verdict.gaps) == (0, 3000, 0)
    assert "logged at 100 Hz, the vehicle's loop runs at 500: enough for a sweep to 10 Hz" in verdict.words
    assert "2.2 times as wide" in verdict.words
    assert "LOG_BITMASK bit 0" in verdict.words
    assert verdict.to_json()["notes"] == list(verdict.notes)


def test_a_log_too_slow_for_the_sweep_is_called_that_and_not_incomplete() -> None:
    verdict = judge(CHIRP, Limits(), Peaks(), every(flown(CHIRP), 10), RATE_HZ)
    assert not verdict.keep
    assert "logged at 50 Hz, too slow" in verdict.reasons[0]
    assert "missing" not in verdict.words


def test_samples_lost_in_a_slow_log_are_still_missing_and_the_remedy_is_named() -> None:
    slow = every(flown(CHIRP), 5)
    keep = np.arange(slow["t"].size) % 100 >= 10
    verdict = judge(CHIRP, Limits(), Peaks(), {name: values[keep] for name, values in slow.items()}, RATE_HZ)
    assert not verdict.keep
    assert "300 of 3000 samples are missing" in verdict.reasons[0]
    assert "LOG_MAV_BUFSIZE to 50" in verdict.words


def test_a_log_that_lost_every_other_sample_by_chance_has_not_half_the_rate() -> None:
    chance = np.random.default_rng(1).random(15000) < 0.5
    verdict = judge(CHIRP, Limits(), Peaks(), {n: v[chance] for n, v in flown(CHIRP).items()}, RATE_HZ)
    assert not verdict.keep
    assert "samples are missing" in verdict.reasons[0]

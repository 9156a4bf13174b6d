"""Where a model fails: shares, noise against what was really flown, coherence against scipy, mistakes found or not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
import planted
import pytest
from more_of_a_kind import thorough
from planted import PLANTED, Run, axes, fly
from scipy.signal import butter, coherence, lfilter, sosfiltfilt, welch

from gcs.analysis.text.documents import comparison_document
from gcs.analysis.text.findings import finding_text, listed_runs, suspicion_text
from sysid.compare.compare import compare
from sysid.compare.data_checks import flat_tops
from sysid.compare.finding_kinds import LeavesBounds
from sysid.compare.on_runs import CompareError
from sysid.compare.values import Comparison
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.model.compose import compose
from sysid.model.structure import Model

BAND = (0.0, 15.0)
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
Array = Any


@cache
def flight(
    effect: str | None, seed: int, gusts: float = 1.0, scale: float = 1.0, duration_s: float = 20.0
) -> list[Run]:
    """Two roll and two pitch chirps, `scale` times the usual amplitude; 0 is quiet hover."""
    usual = planted.SIZES
    try:
        planted.SIZES = MappingProxyType({name: scale * size for name, size in usual.items()})
        return fly(effect, PLANTED.get(effect or "", {}), seed=seed, gusts=gusts, duration_s=duration_s)
    finally:
        planted.SIZES = usual


def told(compared: Comparison) -> tuple[str, ...]:
    """Its findings in sentences."""
    return tuple(finding_text(finding) for finding in compared.findings)


def records(
    runs: Sequence[Run],
    log: str = "f",
    without: Sequence[str] = (),
    edit: Callable[[dict[str, Array]], None] = lambda channels: None,
    maneuver: str = "chirp",
) -> list[Record]:
    """Without the attitude, which planted flights log without error."""
    found = []
    for number, (run, axis) in enumerate(zip(runs, axes(False), strict=True), 1):
        channels = {name: values for name, values in run.items() if name not in {"phi", "theta", *without}}
        edit(channels)
        declared = axis if maneuver == "chirp" else None
        found.append(
            Record(
                f"{log}#{number}",
                channels,
                maneuver=maneuver,
                axis=declared,
                rate_source="SIDD",
                path="",
                sha256="",
                swept_band_hz=(0.5, 10.0),
            )
        )
    return found


@cache
def model_of(effect: str | None, seed: int, base: str = "tpp", gusts: float = 1.0) -> Model:
    return identify(compose(base), records(flight(effect, seed, gusts))).model


@cache
def compared(effect: str | None, seed: int, base: str = "tpp", gusts: float = 1.0) -> Comparison:
    return compare(model_of(effect, seed, base, gusts), records(flight(effect, seed, gusts)), BAND)


def kinds(found: Comparison) -> set[str]:
    return {one.kind for one in found.suspicions}


# ------------------------------------------------------------------------------------------------ shares


@pytest.mark.parametrize("base", ["tpp", *thorough(["cd"])])
def test_every_division_adds_up_to_one(base: str) -> None:
    found = compared("servo_lag", 1, base)
    for axis, output in (("roll", "p"), ("pitch", "q")):
        assert sum(one.error_share for one in found.bands if one.axis == axis) == pytest.approx(1)
        assert sum(one.error_share for one in found.windows if one.axis == axis) == pytest.approx(1)
        assert sum(one.error_share[output] for one in found.runs) == pytest.approx(1)
        for channel in {one.channel for one in found.levels if one.axis == axis}:
            each = [one for one in found.levels if (one.axis, one.channel) == (axis, channel)]
            assert sum(one.error_share for one in each) == pytest.approx(1)
            assert [one.time_share for one in each] == pytest.approx([0.25] * 4, abs=0.05)
            assert all(a.high == b.low for a, b in pairwise(each))
        for one in found.runs:  # power over time is power over frequency
            inside = sum(w.error_share for w in found.windows if w.axis == axis and w.run == one.id)
            assert inside == pytest.approx(one.error_share[output])
    bands = [one for one in found.bands if one.axis == "roll"]
    assert (bands[0].low_hz, bands[-1].high_hz) == BAND
    assert all(a.high_hz == b.low_hz for a, b in pairwise(bands))


def test_bands_follow_the_sweep_and_the_modes() -> None:
    found = compared("servo_lag", 1)
    edges = [one.low_hz for one in found.bands if one.axis == "roll"]
    assert 0.5 in edges
    assert 10.0 in edges
    for mode in model_of("servo_lag", 1).modes:
        inside = [one for one in found.bands if one.low_hz < mode.frequency_hz < one.high_hz]
        assert all(one.high_hz / one.low_hz < 2.5 for one in inside)


def test_nrmse_is_the_fit_s_own() -> None:
    fit = identify(compose("tpp"), records(flight("servo_lag", 1)))
    found = compare(fit.model, records(flight("servo_lag", 1)), BAND)
    assert found.nrmse_percent == pytest.approx(dict(fit.nrmse_percent))


# ------------------------------------------------------------------------------------------------ noise


NOISE_BAND = (0.5, 15.0)
"""Below it the estimated end states take some of the noise along."""
IN_BAND = butter(4, NOISE_BAND, "band", fs=1 / planted.DT, output="sos")


def power(rows: Array) -> Array:
    """(k,), of the band, without the filter's ends."""
    return np.sum(sosfiltfilt(IN_BAND, rows, axis=1)[:, 500:-500] ** 2, axis=1)


def true_noise(effect: str | None, runs: Sequence[Run], found: Comparison) -> Array:
    """What gusts and gyro made of p and q, over the model's residual: the flown vehicle answers the same commands."""
    noise, residual = np.zeros(2), np.zeros(2)
    for run, trace in zip(runs, found.traces, strict=True):
        commands = np.stack([run[name] for name in ("delta_x", "delta_y", "delta_e")], axis=1)
        signals = {name: run[name] for name in ("r", "omega", "delta_c", "delta_r")}
        calm = planted.respond(effect, PLANTED.get(effect or "", {}), commands, **signals)
        noise += power(np.stack([run[name] - calm[name] for name in "pq"]))
        residual += power(trace.residual)
    return noise / residual


def shares(found: Comparison) -> Array:
    assert found.noise_share is not None
    return np.array([*found.noise_share.values()])


@pytest.mark.parametrize(
    ("effect", "gusts"), [("servo_lag", 3.0), *thorough([("servo_lag", 1.0), ("transport_delay", 3.0)])]
)
def test_noise_is_what_gusts_and_gyro_made(effect: str, gusts: float) -> None:
    """A little more: what gusts made of the commands, and the model of those, is noise to it as well."""
    runs = flight(effect, 1, gusts)
    found = compare(model_of(effect, 1, "tpp", gusts), records(runs), NOISE_BAND)
    truth = true_noise(effect, runs, found)
    assert shares(found) == pytest.approx(truth, abs=0.1)
    assert np.all(shares(found) > truth - 0.02)
    assert found.noise_share_is == "measured"
    assert found.noise_from == "logged excitation"
    assert found.noise_floor_percent is not None
    reached = compared(None, 1, gusts=gusts).nrmse_percent  # the same air, nothing missing
    assert list(found.noise_floor_percent.values()) == pytest.approx(list(reached.values()), abs=2.5)


@pytest.mark.parametrize("seed", [1, *thorough([2, 3])])
def test_nothing_to_find_where_nothing_is_missing(seed: int) -> None:
    found = compared(None, seed)
    assert told(found) == ("what is left is noise: nothing to find here (measured, the excitation is logged)",)
    assert found.suspicions == ()
    assert not any(found.more.values())
    for one in found.responses:
        seen = sum(high - low for low, high in one.noticed)
        assert seen < 0.5, "Hz above what noise allows"


def test_what_is_missing_is_placed() -> None:
    found = compared("servo_lag", 1)
    assert found.explained
    text = next(text for text in told(found) if text.startswith("pitch"))
    assert "linear dynamics are missing there" in text
    assert "coherent with the commands" in text
    assert "Noise explains 1" in text
    strongest = max((one for one in found.bands if one.axis == "pitch"), key=lambda one: one.error_share)
    assert strongest.low_hz < 5 < strongest.high_hz
    assert strongest.coherence_together > 0.8
    (q_per_y,) = [one for one in found.responses if (one.mismatch.output, one.mismatch.command) == ("q", "delta_y")]
    assert any(low < 8 < high for low, high in q_per_y.noticed), "30 ms of lag show above the pitch mode"
    left = [one for one in found.findings if isinstance(one, LeavesBounds)]
    assert [one.axis for one in left] == ["roll", "pitch"]
    for one in left:
        assert abs(one.decibels) > 0.5 or abs(one.degrees) > 3
        assert any(low <= one.furthest_hz <= high for low, high in one.bands_hz)
        assert any("lies outside the bounds of the measured response" in text for text in told(found))


@pytest.fixture(scope="module")
def windy() -> tuple[Model, list[Run], list[Run]]:
    """A model that lacks the servo, what it was fitted to, and quiet hover in the same air."""
    return model_of("servo_lag", 1, "tpp", 3.0), flight("servo_lag", 1, 3.0), flight("servo_lag", 9, 3.0, 0.0)


def test_without_the_excitation_the_share_is_a_bound(windy: tuple[Model, list[Run], list[Run]]) -> None:
    model, runs, _ = windy
    found = compare(model, records(runs, without=EXCITATIONS), NOISE_BAND)
    assert found.noise_share_is == "upper bound, closed loop"
    assert found.references == ("delta_x", "delta_y")
    measured = compare(model, records(runs), NOISE_BAND)
    assert np.all(shares(found) < shares(measured) - 0.02), "feedback hides some of the noise"
    assert "at least" in told(found)[0]


def test_quiet_hover_measures_the_noise(windy: tuple[Model, list[Run], list[Run]]) -> None:
    """Its noise is that of the sweeps where no excitation was logged; and the bound becomes a measurement."""
    model, runs, calm = windy
    bare, still = records(runs, without=EXCITATIONS), records(calm, "quiet", EXCITATIONS, maneuver="quiet")
    found = compare(model, bare, NOISE_BAND, still)
    assert found.noise_share_is == "measured"
    assert found.noise_from == "quiet hover"
    assert shares(found) == pytest.approx(true_noise("servo_lag", runs, found), abs=0.1)
    assert "measured from quiet hover" in told(found)[0]
    among = compare(model, [*bare, *still], NOISE_BAND)
    assert among.noise_share == found.noise_share
    assert [one.id for one in among.runs] == [one.id for one in bare]


def test_quiet_hover_agrees_with_the_logged_excitation(windy: tuple[Model, list[Run], list[Run]]) -> None:
    model, runs, calm = windy
    found = compare(model, records(runs), NOISE_BAND, records(calm, "quiet", maneuver="quiet"))
    assert found.quiet_ratio is not None
    assert list(found.quiet_ratio.values()) == pytest.approx([1, 1], abs=0.15)
    assert "quiet hover agrees" in told(found)[0]


def test_play_is_neither_noise_nor_linear() -> None:
    """What quiet hover does not show and the commands do not explain linearly is called by its name."""
    still = records(flight("servo_backlash", 9, 1.0, 0.0), "quiet", maneuver="quiet")
    runs = flight("servo_backlash", 1)
    model = identify(
        compose("tpp"), records(runs), weights="constant"
    ).model  # the noise predicted would take part of it
    found, alone = compare(model, records(runs), NOISE_BAND, still), compare(model, records(runs), NOISE_BAND)
    truth = true_noise("servo_backlash", runs, found)
    assert np.all(np.abs(shares(found) - truth) < 0.7 * np.abs(shares(alone) - truth))
    assert any("a nonlinearity" in text for text in told(found) if text.startswith("pitch"))


# ------------------------------------------------------------------------------------------------ coherence


def test_coherence_against_scipy() -> None:
    """One input, flown open loop; a model that does nothing leaves all of it."""
    rng = np.random.default_rng(3)
    dt, n = 0.01, 12000
    x, y = 0.1 * rng.standard_normal((2, n))
    b, a = butter(2, 3.0, fs=1 / dt)
    noise = lfilter(*butter(1, 6.0, fs=1 / dt), 0.08 * rng.standard_normal(n))
    p = lfilter(b, a, x) + noise
    q = 0.1 * rng.standard_normal(n)
    channels = {"t": dt * np.arange(n), "p": p, "q": q, "delta_x": x, "delta_y": y}
    channels |= {"excitation_x": x, "excitation_y": y}
    record = Record("white", channels, maneuver="chirp", axis="roll", swept_band_hz=(0.5, 10.0))
    model = Model(compose("cd"), np.array([-5.0, 0, 0, -5.0, 1e-9, 0, 0, 1e-9]))
    found = compare(model, [record], BAND)
    assert found.nrmse_percent["p"] == pytest.approx(0, abs=0.5)
    hz, gamma = coherence(x, p, 1 / dt, nperseg=500)
    _, power = welch(p, 1 / dt, nperseg=500)
    for one in found.bands:
        if one.axis == "roll" and one.low_hz >= 0.5:
            at = (hz > one.low_hz) & (hz <= one.high_hz)
            expected = float(np.sum(gamma[at] * power[at]) / np.sum(power[at]))
            assert one.coherence["delta_x"] == pytest.approx(expected, abs=0.06)
            assert one.coherence["delta_y"] < 0.1
        if one.axis == "pitch":
            assert max(one.coherence.values()) < 0.15


def test_other_controls_that_move_the_vehicle_are_named() -> None:
    found = compare(model_of("input_coupling", 5), records(flight("input_coupling", 5)), BAND)
    assert any("delta_c explains" in text and "not in the structure" in text for text in told(found))
    without = compare(
        model_of("input_coupling", 5), records(flight("input_coupling", 5), without=("delta_c", "delta_r")), BAND
    )
    assert found.noise_share is not None
    assert without.noise_share is not None
    assert found.noise_share["p"] < without.noise_share["p"] - 0.3, "what a recorded signal explains is no noise"


# ------------------------------------------------------------------------------------------------ amplitude


def at_two_amplitudes(effect: str | None) -> Comparison:
    small, large = (
        records(flight(effect, seed, 1.0, scale, 20.0), f"{scale}") for seed, scale in ((1, 0.5), (11, 1.0))
    )
    return compare(identify(compose("tpp"), small).model, [*small, *large], BAND, own_runs=False)


def test_a_linear_error_is_proportional_to_the_command() -> None:
    found = at_two_amplitudes("servo_lag")
    assert len(found.growth) >= 3
    for one in found.growth:
        if not one.at_least:
            assert one.per_doubling == pytest.approx(1, abs=0.15)
        assert not one.significant
        assert one.high == pytest.approx(2 * one.low, rel=0.1)
    assert not any("amplitude" in text or "worse" in text for text in told(found))
    assert kinds(found) == set()


@pytest.mark.parametrize(
    ("effect", "way"),
    [
        pytest.param("quadratic_damping", "grows", marks=pytest.mark.thorough),
        ("servo_saturation", "grows"),
        ("servo_backlash", "falls"),
    ],
)
def test_a_nonlinear_one_is_not(effect: str, way: str) -> None:
    found = at_two_amplitudes(effect)
    assert any(f"the error {way} with amplitude" in text and "nonlinearity" in text for text in told(found))


def test_clean_flights_of_two_amplitudes() -> None:
    assert len(at_two_amplitudes(None).findings) == 1


# ------------------------------------------------------------------------------------------------ time and runs


def shaken(number: int, start_s: float, stop_s: float, size: float) -> list[Record]:
    """A flight in which the air shook one run for a while."""
    found = records(flight(None, 1))
    run = found[number]
    rng = np.random.default_rng(8)
    at = (run.t >= start_s) & (run.t < stop_s)
    q = run.channels["q"] + at * lfilter(*butter(2, [0.02, 0.04], "band"), size * rng.standard_normal(run.t.size))
    found[number] = Record(
        run.id, {**run.channels, "q": q}, maneuver=run.maneuver, axis=run.axis, swept_band_hz=run.swept_band_hz
    )
    return found


def test_a_knock_is_placed_in_time() -> None:
    found = compare(model_of(None, 1), shaken(2, 12.0, 14.0, 1.5), BAND)
    assert any("sits at 12-14 s of f#3" in text for text in told(found))


def test_errors_at_the_start_of_the_runs() -> None:
    runs = records(flight(None, 1))
    late = []
    for run in runs:
        ring = 0.5 * np.exp(-run.t) * np.sin(2 * np.pi * 3 * run.t)
        late.append(
            Record(run.id, {**run.channels, "p": run.channels["p"] + ring}, maneuver=run.maneuver, axis=run.axis)
        )
    found = compare(model_of(None, 1), late, BAND)
    assert any("sits in the first 2 s of the runs" in text for text in told(found))


def test_a_run_that_is_worse_than_the_others() -> None:
    found = compare(model_of(None, 1), shaken(2, 0.0, 40.0, 0.5), BAND)
    assert any(text.startswith("f#3 is worse than the others: its pitch error") for text in told(found))
    assert any("rougher air" in text for text in told(found))


def test_an_error_that_goes_with_the_rotor_speed() -> None:
    """Repeats of a maneuver at other rotor speeds part what drifts from what the sweep does."""
    runs = []
    for number, run in enumerate(records(flight(None, 1))):
        rng = np.random.default_rng(number)
        extra = lfilter(*butter(2, [0.004, 0.02], "band"), rng.standard_normal(run.t.size))
        size = 0.3 * np.exp((run.channels["omega"] - 171) / 5)
        run = Record(
            run.id, {**run.channels, "q": run.channels["q"] + size * extra}, maneuver=run.maneuver, axis=run.axis
        )
        runs.append(run)
    found = compare(model_of(None, 1), runs, BAND)
    (trend,) = [one for one in found.trends if (one.axis, one.channel) == ("pitch", "omega")]
    assert trend.significant
    made = 2 * (trend.high - trend.low) / 5
    assert 0.5 * made < np.log(trend.factor) < 1.2 * made, "noise is left where there was little"
    assert any("grows where the rotor speed is high" in text for text in told(found))
    shares = [one.error_share for one in found.conditions if (one.axis, one.channel) == ("pitch", "omega")]
    assert shares == sorted(shares)


# ------------------------------------------------------------------------------------------------ suspicions


def clip_q(channels: dict[str, Array]) -> None:
    channels["q"] = np.clip(channels["q"], -0.4, 0.4)


def test_a_clipped_gyro_is_seen() -> None:
    found = compare(model_of(None, 1), records(flight(None, 1), edit=clip_q), BAND)
    (one,) = [one for one in found.suspicions if one.kind == "clipped"]
    assert "q is clipped at 0.4 rad/s" in suspicion_text(one)
    assert one.runs == ("f#1", "f#2", "f#3", "f#4")
    assert suspicion_text(one) == told(found)[0], "before anything is made of the numbers"


def test_flat_tops() -> None:
    t = np.arange(0, 20, 0.002)
    wave = np.sin(2 * np.pi * 0.7 * t) + 0.3 * np.sin(2 * np.pi * 1.9 * t)
    noisy = wave + 0.004 * np.random.default_rng(1).standard_normal(t.size)
    coarse = np.round(wave / 0.001) * 0.001
    held = np.repeat(noisy[::10], 10)
    for clean in (wave, noisy, coarse, held, np.zeros(100)):
        assert flat_tops(clean) == (0.0, 0.0)
    for values in (noisy, np.round(noisy / 0.001) * 0.001, held):
        share, limit = flat_tops(np.clip(values, -0.8, 0.8))
        assert limit == pytest.approx(0.8)
        assert share == pytest.approx(np.mean(np.abs(values) >= 0.8), rel=0.2)


def exchanged(*pairs: tuple[str, str]) -> Callable[[dict[str, Array]], None]:
    def edit(channels: dict[str, Array]) -> None:
        for one, other in pairs:
            channels[one], channels[other] = channels[other], channels[one]

    return edit


def turned(p: str, q: str) -> Callable[[dict[str, Array]], None]:
    def edit(channels: dict[str, Array]) -> None:
        was = dict(channels)
        for name, source in (("p", p), ("q", q)):
            channels[name] = -was[source[-1]] if source.startswith("-") else was[source]

    return edit


@pytest.mark.parametrize(
    ("edit", "kind", "says"),
    [
        (exchanged(("p", "q")), "signs", "rates and commands are swapped"),
        (turned("q", "-p"), "signs", "turned by 90 degrees"),
        pytest.param(turned("-q", "p"), "signs", "turned by 90 degrees", marks=pytest.mark.thorough),
        (turned("-p", "-q"), "signs", "turned by 180 degrees"),
        (turned("-p", "q"), "signs", "the sign of p or of delta_x"),
        pytest.param(turned("p", "-q"), "signs", "the sign of q or of delta_y", marks=pytest.mark.thorough),
        (exchanged(("delta_x", "delta_y")), "axes", "excitation_x moves delta_y"),
        (
            exchanged(("p", "q"), ("delta_x", "delta_y"), ("excitation_x", "excitation_y")),
            "axes",
            "f#1, #3 are declared roll, but excitation_y moved most",
        ),
    ],
)
@pytest.mark.parametrize("base", ["cd", *thorough(["tpp"])])
def test_mistaken_axes_are_seen(edit: Callable[[dict[str, Array]], None], kind: str, says: str, base: str) -> None:
    """CD fits them as well as the right ones; the TPP of the right ones stands for a structure with bounds."""
    wrong = records(flight(None, 2, duration_s=15.0), edit=edit)
    model = identify(compose("cd"), wrong).model if base == "cd" else model_of(None, 2)
    found = compare(model, wrong, BAND)
    assert any(one.kind == kind and says in suspicion_text(one) for one in found.suspicions)


def test_right_axes_are_not_suspected() -> None:
    for seed in (1, 2, 3):
        assert kinds(compared(None, seed)) == set()
    for effect, base in ((None, "cd"), ("servo_lag", "tpp"), ("servo_backlash", "tpp")):
        assert kinds(compared(effect, 1, base)) == set()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("effect", "seed", "base"),
    [(None, 2, "cd"), (None, 3, "cd"), ("attitude_stiffness", 1, "tpp"), ("hub_gyroscopics", 1, "tpp")],
)
def test_right_axes_of_other_vehicles_are_not_suspected(effect: str | None, seed: int, base: str) -> None:
    assert kinds(compared(effect, seed, base)) == set()


def test_commands_alone_tell_the_declared_axis() -> None:
    bare = records(flight(None, 1), without=EXCITATIONS, edit=exchanged(("p", "q"), ("delta_x", "delta_y")))
    found = compare(identify(compose("cd"), bare).model, bare, BAND)
    assert any("declared pitch, but delta_x moved most" in suspicion_text(one) for one in found.suspicions)


def test_runs_of_two_vehicles_are_told_apart() -> None:
    both = [*records(flight(None, 1))[:2], *records(flight("servo_lag", 1))[2:]]
    found = compare(identify(compose("tpp"), both).model, both, BAND)
    (one,) = [one for one in found.suspicions if one.kind == "mixed"]
    assert "f#1 against f#3" in suspicion_text(one)
    assert "f#2 against f#4" in suspicion_text(one)
    assert found.noise_share is not None
    assert found.noise_share["q"] < 0.2, "what every run's own response explains is no noise"
    assert not any("nothing to find" in text for text in told(found))


def test_sweeps_without_noise_on_the_other_axis_are_of_one_vehicle(monkeypatch: pytest.MonkeyPatch) -> None:
    """As ArduPilot flies them: alone, a run's other command is feedback only, which is no reference."""
    air_of_run = planted._air_of_run

    def one_axis(axis: str, *rest: Any) -> list[Array]:
        excitation, *others = air_of_run(axis, *rest)
        return [np.where(np.arange(3) == ("roll", "pitch").index(axis), excitation, 0.0), *others]

    monkeypatch.setattr(planted, "_air_of_run", one_axis)
    same = records(fly(None, {}, seed=1, duration_s=20.0))
    model = identify(compose("tpp"), same).model
    found = compare(model, same, BAND)
    assert found.references == ("excitation_x", "excitation_y")
    assert found.suspicions == ()
    assert found.noise_floor_percent == pytest.approx(found.nrmse_percent, abs=0.5)
    other = records(fly("servo_lag", PLANTED["servo_lag"], seed=2, duration_s=20.0), "g")
    assert "mixed" in kinds(compare(model, [*same, *other], BAND))


def test_runs_are_written_short() -> None:
    assert listed_runs(["a.BIN#1", "a.BIN#2", "b.BIN#1", "run.csv"]) == "a.BIN#1, #2, b.BIN#1, run.csv"


# ------------------------------------------------------------------------------------------------ bad input


def test_one_run_only() -> None:
    found = compare(model_of("servo_lag", 1), records(flight("servo_lag", 1))[:1], BAND)
    assert found.growth == ()
    assert all(
        sum(one.error_share for one in found.windows if one.axis == axis) == pytest.approx(1)
        for axis in ("roll", "pitch")
    )


def test_two_seconds_are_too_short_to_tell_noise() -> None:
    short = [one.window(5.0, 7.2) for one in records(flight("servo_lag", 1, duration_s=30.0))[:1]]
    found = compare(model_of("servo_lag", 1), short, BAND)
    assert found.noise_share is None
    assert found.explained is None
    assert all("too short to tell noise from error" in text for text in told(found)[:2])
    document = comparison_document(found)
    assert document["noise_share"] == {"p": None, "q": None}
    assert sum(one["error_share"] for one in document["bands"]) == pytest.approx(2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda runs: [one.window(5.0, 6.0) for one in runs], "2 s"),
        (lambda runs: records(flight(None, 1), maneuver="quiet"), "quiet hover alone"),
        (lambda runs: [], "no run to compare on"),
        (
            lambda runs: [
                Record(one.id, {**one.channels, "p": 0 * one.t}, maneuver=one.maneuver, axis=one.axis) for one in runs
            ],
            "p does not move",
        ),
    ],
)
def test_runs_that_nothing_can_be_said_of(change: Callable[[list[Record]], list[Record]], says: str) -> None:
    with pytest.raises(CompareError, match=says):
        compare(model_of(None, 1), change(records(flight(None, 1))), BAND)


def test_an_empty_band_is_refused() -> None:
    with pytest.raises(CompareError, match="no frequency lies in"):
        compare(model_of(None, 1), records(flight(None, 1)), (0.0, 0.01))


def test_a_missing_channel_names_the_effect() -> None:
    structure = compose("tpp", ["rotor_speed"], {"omega"}, {"Omega_0": planted.NOMINAL_OMEGA})
    model = Model(structure, structure.vector({**planted.TABLE_4, **PLANTED["rotor_speed"]}))
    runs = flight(None, 1)
    assert compare(model, records(runs), BAND).nrmse_percent["p"] > 0
    with pytest.raises(CompareError, match=r"omega is not logged, which the fit's rotor_speed needs"):
        compare(model, records(runs, without=("omega",)), BAND)


def test_single_axis_runs_say_that_they_separate_nothing() -> None:
    still = records(flight(None, 1))[0]
    nothing = Record(
        "one", {**still.channels, "delta_y": 0 * still.t, "excitation_y": 0 * still.t}, maneuver="chirp", axis="roll"
    )
    found = compare(model_of(None, 1), [nothing], BAND)
    assert "not separable" in kinds(found)
    assert "pitch axis not identifiable" in told(found)[-1]

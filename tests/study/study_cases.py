"""Cases of an examination from outside that `study_findings` has not, as it flew them: each case's flights, one line.

    python tests/study/study_cases.py [CASE...]      # those whose words hold one of these; all without

Vehicles, loops, gusts and logs are made without the package. Exact vehicles in slow logs are `study_slow_logs`'.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "study")]

from planted import PLANTED, TABLE_4, Array  # noqa: E402
from strangers import air  # noqa: E402
from strangers.air import Maneuver  # noqa: E402
from strangers.asking import records, weighed  # noqa: E402
from strangers.flights import Plan, as_planned  # noqa: E402
from strangers.hiding import Hidden  # noqa: E402
from study_findings import (  # noqa: E402
    DELFTACOPTER,
    FIRST_SEED,
    Case,
    Setting,
    asked,
    flown,
    in_loop,
    named,
    no_alarm,
    plainly,
    said_of,
)

from gcs.cli import main  # noqa: E402
from sysid.compare.compare import compare  # noqa: E402
from sysid.control.regulator import DesignError, design  # noqa: E402
from sysid.data.record import Record  # noqa: E402
from sysid.diagnose.verdict import Diagnosis  # noqa: E402
from sysid.errors import SysidError  # noqa: E402
from sysid.fit.identify import identify  # noqa: E402
from sysid.model.compose import compose  # noqa: E402
from sysid.model.paper import TPP  # noqa: E402
from sysid.model.structure import Model  # noqa: E402

BAND = (0.0, 15.0)
TRUTH = np.array([TABLE_4[name] for name in TPP.names])
LARGEST_Z = 1.2
"""Rms."""
SHORT_S, DOUBLET_S = 8.0, 5.0
LOGGED_FOR = {"rotor_speed": ("omega",), "input_coupling": ("delta_c", "delta_r"), "yaw_coupling": ("r",)}
"""Channels that an effect needs."""


@dataclass(frozen=True)
class Told:
    """A line that is no answer of a diagnosis."""

    words: str
    was: str
    show: Callable[[], tuple[bool, str]]


# -------------------------------------------------------------------------------------------------------- waveforms


def _linear(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    t = np.arange(round(duration_s / dt)) * dt
    low, high = band_hz
    return np.asarray(size * np.sin(2 * math.pi * (low * t + (high - low) * t**2 / (2 * duration_s))))


def _logarithmic(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    t = np.arange(round(duration_s / dt)) * dt
    low, high = band_hz
    rate = math.log(high / low) / duration_s
    return np.asarray(size * np.sin(2 * math.pi * low * np.expm1(rate * t) / rate))


def _pulses(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    """3-2-1-1, again and again, each time shorter."""
    wave: list[Array] = []
    unit = 0.4
    while sum(map(len, wave)) < duration_s / dt:
        wave += [np.full(round(times * unit / dt), sign) for times, sign in ((3, 1.0), (2, -1.0), (1, 1.0), (1, -1.0))]
        wave.append(np.zeros(round(3 * unit / dt)))
        unit = max(0.1, 0.75 * unit)
    return np.asarray(size * np.concatenate(wave)[: round(duration_s / dt)])


def _doublets(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    return air.doublets(size, duration_s, 2 * math.pi * 1.5, dt)


def _by_hand(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    """A stick that is moved faster and faster, never evenly, to 4 Hz."""
    rng = np.random.default_rng(5)
    t = np.arange(round(duration_s / dt)) * dt
    knots = np.arange(0.0, duration_s + 1.0)
    uneven = np.interp(t, knots, rng.uniform(0.6, 1.4, knots.size))
    hz = uneven * band_hz[0] * (8.0 ** (t / duration_s))
    return np.asarray(size * (0.7 + 0.3 * uneven) * np.sin(2 * math.pi * np.cumsum(hz) * dt))


def _multisine(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    rng = np.random.default_rng(6)
    t = np.arange(round(duration_s / dt)) * dt
    lines = np.arange(band_hz[0], band_hz[1], 0.2)
    wave = np.sum(np.sin(2 * math.pi * lines[:, None] * t + rng.uniform(0, 2 * math.pi, lines.size)[:, None]), axis=0)
    return np.asarray(size * wave / np.max(np.abs(wave)))


WAVES = {
    "linear chirp": _linear,
    "logarithmic chirp": _logarithmic,
    "3-2-1-1": _pulses,
    "doublets": _doublets,
    "sweep by hand": _by_hand,
    "multisine": _multisine,
}


def waved(wave: Callable[..., Array], effect: str | None) -> Callable[[int], tuple[Sequence[Record], Sequence[Record]]]:
    def runs(seed: int) -> tuple[Sequence[Record], Sequence[Record]]:
        with patch.object(air, "chirp", wave):
            return records(flown(Setting(), seed, effect, {"tau_s": 0.025})), ()

    return runs


# -------------------------------------------------------------------------------------------------------- flights


def judged_by_others(
    effect: str, sizes: Mapping[str, float] | None = None
) -> Callable[[int], tuple[Sequence[Record], Sequence[Record]]]:
    """Chirps of 12 s, validated by a doublet and a chirp of half the size on each axis."""

    def runs(seed: int) -> tuple[Sequence[Record], Sequence[Record]]:
        plan = Setting(seconds=12.0).plan(seed, (effect,))
        return _split(_with(plan, ("doublet", 1.0, 8.0), ("chirp", 0.5, 8.0)), effect, sizes)

    return runs


def short(effect: str | None) -> Callable[[int], tuple[Sequence[Record], Sequence[Record]]]:
    """Two chirps of 8 s, and two doublets of 5 s to validate."""

    def runs(seed: int) -> tuple[Sequence[Record], Sequence[Record]]:
        channels = LOGGED_FOR.get(effect or "", ())
        setting = Setting(seconds=SHORT_S, axes=(0, 1), channels=channels)
        plan = setting.plan(seed, () if effect is None else (effect,))
        return _split(_with(plan, ("doublet", 1.0, DOUBLET_S)), effect)

    return runs


def _with(plan: Plan, *judging: tuple[str, float, float]) -> Plan:
    more = [
        Maneuver(kind=kind, axis=axis, amplitude=size, duration_s=seconds, fitted=False)
        for kind, size, seconds in judging
        for axis in (0, 1)
    ]
    return replace(plan, card=(*plan.card, *more))


def _split(
    plan: Plan, effect: str | None, sizes: Mapping[str, float] | None = None
) -> tuple[Sequence[Record], Sequence[Record]]:
    hidden = Hidden((), ()) if effect is None else Hidden((effect,), (dict(sizes or PLANTED[effect]),))
    runs = records(as_planned(plan, hidden))
    return runs[: plan.fitted], runs[plan.fitted :]


SHORTLY = (
    None, "second_order_flapping", "dynamic_inflow", "rotor_speed", "hub_gyroscopics", "angular_damping",
    "quadratic_damping", "attitude_stiffness", "speed_stability", "inertia_coupling", "yaw_coupling",
    "structural_mode", "input_coupling", "servo_lag", "lag_per_axis", "servo_second_order", "transport_delay",
    "servo_rate_limit", "servo_acceleration_limit", "servo_saturation", "servo_deadband", "servo_backlash", "gyro_lag",
    "gyro_misalignment", "gyro_filter", "stabiliser_bar",
)  # fmt: skip


def complete(found: Diagnosis) -> bool:
    return found.verdict == "complete"


def unexplained(found: Diagnosis) -> bool:
    return found.verdict == "unexplained"


def not_confidently_wrong(found: Diagnosis) -> bool:
    return found.verdict == "unexplained" or found.confidence < 0.9


def _filtered(one: Record) -> Record:
    """Told as an ArduCopter's log tells it."""
    return replace(one, vehicle={"INS_GYRO_FILTER": "20"}, rate_source="RATE")


def behind_told_filter(seed: int) -> tuple[Sequence[Record], Sequence[Record]]:
    return [
        _filtered(one) for one in records(flown(Setting(), seed, "gyro_filter", {"corner": 20.0, "zeta": 0.7071}))
    ], ()


def cases() -> Iterator[Case | Told]:
    yield Case(
        words="lag of 20 ms at 100 Hz, loop told",
        was="gyro_lag 14.0 ms",
        runs=plainly(Setting(every=5), "servo_lag", {"tau_s": 0.02}),
        wanted=named("servo_lag"),
    )
    yield Case(
        words="lag of 20 ms at 100 Hz, loop not told",
        was="gyro_lag 14.0 ms",
        runs=plainly(Setting(every=5, told=False), "servo_lag", {"tau_s": 0.02}),
        wanted=named("servo_lag"),
    )
    for words, loop, gusts, was in (
        ("usual", 1, 1, "1 of 8 alarm"), ("gusts x2", 1, 2, "5 of 8"), ("loop x2", 2, 1, "5 of 8"),
        ("loop x2, gusts x2", 2, 2, "8 of 8"),
    ):  # fmt: skip
        setting = Setting(vehicle=in_loop(DELFTACOPTER, loop), gusts=gusts, excitation=False, seconds=30.0)
        yield Case(words=f"30 s, no excitation: {words}", was=was, runs=plainly(setting), wanted=no_alarm, flights=8)
    yield Case(words="gusts x5", was="complete", runs=plainly(Setting(gusts=5)), wanted=complete)
    yield Case(
        words="lag of 15 ms, loop x2, no excitation",
        was="servo_lag 15.5 ms at 0.64",
        runs=plainly(Setting(vehicle=in_loop(DELFTACOPTER, 2), excitation=False), "servo_lag", {"tau_s": 0.015}),
        wanted=named("servo_lag"),
    )
    for name, wave in WAVES.items():
        yield Case(words=f"wave: {name}, nothing", was="right", runs=waved(wave, None), wanted=complete, flights=1)
        yield Case(
            words=f"wave: {name}, lag of 25 ms", was="right", runs=waved(wave, "servo_lag"), wanted=named("servo_lag"),
            flights=1,
        )  # fmt: skip
    yield Case(
        words="lag of 25 ms, roll alone",
        was="transport_delay, in class",
        runs=plainly(Setting(axes=(0, 0)), "servo_lag", {"tau_s": 0.025}),
        wanted=named("servo_lag"),
    )
    yield Case(
        words="collective, logged",
        was="input_coupling",
        runs=plainly(
            Setting(channels=("delta_c",)),
            "input_coupling",
            {"L_delta_c": 30.0, "M_delta_c": 60.0, "L_delta_r": 0.0, "M_delta_r": 0.0},
        ),
        wanted=named("input_coupling"),
    )
    yield Case(
        words="collective, not logged",
        was="4 of 8 unexplained",
        runs=plainly(
            Setting(), "input_coupling", {"L_delta_c": 30.0, "M_delta_c": 60.0, "L_delta_r": 0.0, "M_delta_r": 0.0}
        ),
        wanted=no_alarm,
        flights=8,
    )
    yield Case(
        words="lag of 6 ms in roll, 40 ms in pitch",
        was="unexplained (rate limit)",
        runs=plainly(Setting(), "lag_per_axis", {"tau_x": 0.006, "tau_y": 0.04}),
        wanted=named("lag_per_axis"),
    )
    yield Case(
        words="hub stiffer by 80 b^3", was="unexplained, right", runs=plainly(Setting(), "cubic_hub", {"k": 80.0}),
        wanted=not_confidently_wrong,
    )  # fmt: skip
    yield Case(
        words="control power fades by 25 %",
        was="unexplained, right",
        runs=plainly(Setting(), "fading_power", {"share": 0.25, "over_s": 17.0}),
        wanted=not_confidently_wrong,
    )
    yield Case(
        words="dead band of .03, validated",
        was="servo_backlash, 8.9 points short",
        runs=judged_by_others("servo_deadband", {"width": 0.03}),
        wanted=named("servo_deadband"),
    )
    yield Case(
        words="gyro filter that the log tells of", was="servo_second_order at 1.00", runs=behind_told_filter,
        wanted=lambda found: found.effect == "gyro_filter" and found.winner is not None and not found.winner.added,
    )  # fmt: skip
    yield Told("margins of late loops", "good ones printed of four that are unstable", late_loops)
    yield Told("two vehicles, no noise on the other axis", "said in 8 of 8", one_vehicle)
    yield Told("roll alone, no noise", "M_a +12.9 %, z 10; log10 p -12115", roll_alone)
    yield Told("speed_stability, usual gusts", "M_u +12 %, z rms 2.5", speed_stability)
    yield Told("poor fit at 62.5 Hz", "39 s CPU", poor_slow_fit)
    yield Told("lag of 20 ms and play .012, --repeat", "both, then transport_delay", repeated)
    yield Told("four tenths of the samples", "refused, says why", torn)
    yield Told("short: two 8 s chirps, two 5 s doublets", "22 right, 2 wrong at 0.99, 1 unexplained of 25", shortly)


# -------------------------------------------------------------------------------------------------------- others


def late_loops() -> tuple[bool, str]:
    """Table 4 behind a delay; an exact simulation holds the first loop alone."""
    said = []
    for cost, late_s in ((5.0, 0.046), (5.0, 0.050), (5.0, 0.060), (2.0, 0.040), (2.0, 0.050)):
        structure = compose("tpp", ["transport_delay"])
        try:
            margins = design(Model(structure, structure.vector({**TABLE_4, "T_d": late_s})), cost).margins
            said.append(f"{cost:g}, {1e3 * late_s:.0f} ms: {margins.gain_db:.1f} dB, {1e3 * margins.delay_s:.0f} ms")
        except DesignError:
            said.append(f"{cost:g}, {1e3 * late_s:.0f} ms: refused")
    return [one.endswith("refused") for one in said] == [False, True, True, True, True], "; ".join(said)


def one_vehicle() -> tuple[bool, str]:
    said = 0
    for seed in range(FIRST_SEED, FIRST_SEED + 8):
        runs = records(flown(Setting(noise=0.0), seed))
        said += any(one.kind == "mixed" for one in compare(identify(TPP, runs).model, runs, BAND).suspicions)
    return not said, f"said in {said} of 8"


def roll_alone() -> tuple[bool, str]:
    runs = records(flown(Setting(noise=0.0, axes=(0, 0)), FIRST_SEED))
    try:
        fit = identify(TPP, runs)
    except SysidError as error:
        return True, f"refused: {str(error)[:120]}"
    z = np.abs(fit.model.values - TRUTH) / np.maximum(fit.standard_errors, 1e-12)
    found = asked(runs)
    worst = float(np.max(z))
    return worst < 4 and no_alarm(found), (
        f"largest error {worst:.1f} standard errors ({TPP.names[int(np.argmax(z))]}); {said_of(found)}; "
        f"{'; '.join(fit.warnings)[:200]}"
    )


def speed_stability() -> tuple[bool, str]:
    offs, zs = [], []
    sizes = {"Y_v": -0.3, "L_v": -2.0, "X_u": -0.3, "M_u": 6.0}
    for seed in range(FIRST_SEED, FIRST_SEED + 8):
        fit = identify(
            TPP, records(flown(Setting(seconds=30.0), seed, "speed_stability", sizes)), effects=["speed_stability"]
        )
        names = fit.model.structure.names
        truth = np.array([{**TABLE_4, **sizes}[name] for name in names])
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (fit.model.values - truth) / fit.standard_errors
        zs.append(z[np.isfinite(z)])
        offs.append(100 * (fit.model["M_u"] / sizes["M_u"] - 1))
    rms = float(np.sqrt(np.mean(np.concatenate(zs) ** 2)))
    return rms < LARGEST_Z, f"M_u {np.mean(offs):+.1f} % in the mean of 8, z rms {rms:.2f}"


def poor_slow_fit() -> tuple[bool, str]:
    runs = []
    for one in records(flown(Setting(every=8, gusts=2.0, seconds=30.0), FIRST_SEED, "servo_lag", {"tau_s": 0.04})):
        line = 0.15 * np.sin(2 * math.pi * 55.0 * one.t)
        runs.append(
            replace(one, channels={**one.channels, "p": one.channels["p"] + line, "q": one.channels["q"] + line})
        )
    begin = time.process_time()
    fit = identify(TPP, runs)
    took = time.process_time() - begin
    reached = "/".join(f"{value:.0f}" for value in fit.nrmse_percent.values())
    told = [text for text in fit.warnings if "alias" in text or "line" in text or "fold" in text]
    return took < 5, f"{took:.1f} s CPU, NRMSE {reached}; a line folded back is {'named' if told else 'not named'}"


def _said(*words: object) -> tuple[int, str, str]:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main([str(word) for word in words])
    return status, out.getvalue(), err.getvalue()


def repeated() -> tuple[bool, str]:
    names = ("servo_lag", "servo_backlash")
    hidden = Hidden(names, ({"tau_s": 0.02}, {"half_width": 0.012}))
    runs = records(as_planned(Setting(seconds=30.0).plan(FIRST_SEED, names), hidden))
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"run{number}.npz" for number in range(len(runs))]
        for path, one in zip(paths, runs, strict=True):
            one.save(path)
        begin, end = Path(folder) / "fit.json", Path(folder) / "end.json"
        _said("fit", *paths, "--model", "tpp", "-o", begin)
        _, out, err = _said("diagnose", begin, "--repeat", "-o", end)
        found = json.loads(end.read_text("utf-8"))["structure"]["effects"] if end.exists() else []
    last = [line for line in out.splitlines() if line.startswith(("complete", "missing", "unexplained"))]
    return set(found) == set(names), f"{' + '.join(found) or err[:100]}; {last[-1] if last else ''}"


def torn() -> tuple[bool, str]:
    rng = np.random.default_rng(FIRST_SEED)
    (one, *_) = records(flown(Setting(seconds=30.0), FIRST_SEED))
    keep = np.zeros(one.t.size, dtype=bool)
    at = 0
    while at < keep.size:
        length = int(rng.integers(20, 320))
        keep[at : at + length] = True
        at += length + int(rng.integers(30, 500))
    names = ("t", "p", "q", "delta_x", "delta_y")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "torn.csv"
        table = np.stack([one.channels[name][keep] for name in names], axis=1)
        np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.6f")
        status, out, err = _said("fit", path, "--model", "tpp")
    text = " ".join((out + err).split())
    return status != 0, f"{100 * np.mean(keep):.0f} % kept, exit {status}: {text[-220:]}"


def shortly() -> tuple[bool, str]:
    right, wrong, confident = 0, [], 0
    for number, effect in enumerate(SHORTLY):
        fitted, judging = short(effect)(FIRST_SEED + number)
        found = weighed(asked(fitted, judging))
        good = complete(found) if effect is None else named(effect)(found)
        right += good
        if not good:
            wrong.append(f"{effect}: {said_of(found)}")
            confident += found.verdict == "missing" and found.confidence >= 0.9
    return not confident, f"{right} of {len(SHORTLY)} right, wrong at 0.9 and more {confident}; {'; '.join(wrong)}"


def study_cases(wanted: Sequence[str] = ()) -> None:
    failed = []
    print(f"\n{'case':52}was; said")
    for case in cases():
        if wanted and not any(word in case.words for word in wanted):
            continue
        if isinstance(case, Told):
            right, said = case.show()
        else:
            answers = [weighed(asked(*case.runs(FIRST_SEED + i))) for i in range(case.flights)]
            good = sum(map(case.wanted, answers))
            right = good == case.flights
            counted = Counter(map(said_of, answers)).items()
            said = f"{good} of {case.flights}: " + "; ".join(f"{count} x {one}" for one, count in counted)
        print(f"  {case.words:50}{case.was}; {said}{'' if right else '   NOT AS WANTED'}", flush=True)
        if not right:
            failed.append(case.words)
    assert not failed, f"not as wanted: {', '.join(failed)}"


if __name__ == "__main__":
    study_cases(sys.argv[1:])

"""Maneuvers found without settings in the log: by modes, texts, the excitation itself; never where none is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from flying import CHIRP, PITCH, ROLL, fly_maneuver, log_of
from more_of_a_kind import thorough

from gcs.logs import ingest
from gcs.logs.formats.tables import Log, Series
from gcs.logs.profile.profiles import ChannelSource, Profile
from gcs.logs.runs import excited, runs, told
from gcs.logs.runs.run import Run
from sitl.autopilot.vehicle import make_vehicle

Saved = Callable[[bytes, str], Path]
Array = np.ndarray

CHANNELS = ("p", "q", "delta_x", "delta_y")
PROFILE = Profile(name="fake", channels={name: ChannelSource(name, (f"M.{name}",)) for name in CHANNELS})


class FakeLog:
    """A log of whatever kind: one message M with all fields, and what is said about it."""

    def __init__(
        self,
        fields: Mapping[str, Array],
        kind: str = "tlog",
        texts: Sequence[tuple[float, str]] = (),
        modes: Sequence[tuple[float, int]] = (),
        armed: Sequence[tuple[float, bool]] = (),
    ) -> None:
        self.path = "fake"
        self.kind = kind
        self.dropped: dict[str, int] = {}
        self._t = fields["t"]
        self._fields = {f"M.{name}": values for name, values in fields.items() if name != "t"}
        self._told = texts, modes, armed

    @property
    def sampled_s(self) -> float:
        return float(self._t[-1] - self._t[0])

    def has(self, key: str) -> bool:
        return key in self._fields

    def series(self, key: str) -> Series:
        return Series(self._t, self._fields[key], "M")

    def fields(self) -> tuple[str, ...]:
        return tuple(self._fields)

    def texts(self) -> Sequence[tuple[float, str]]:
        return self._told[0]

    def modes(self) -> Sequence[tuple[float, int]]:
        return self._told[1]

    def armed(self) -> Sequence[tuple[float, bool]]:
        return self._told[2]


def noise(rng: np.random.Generator, n: int, rate_hz: float, low: float, high: float, slope: float = 0.5) -> Array:
    """Of unit variance between two frequencies, its amplitude falling with f^-slope."""
    hz = np.fft.rfftfreq(n, 1 / rate_hz)
    shape = np.where((hz >= low) & (hz <= high), np.maximum(hz, 1e-3) ** -slope, 0.0)
    values = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * shape, n)
    return np.asarray(values / values.std())


def tischler(t: Array, begin: float, duration: float, low: float, high: float) -> Array:
    """The sweep of Table 1: slow at first."""
    since = np.clip(t - begin, 0, duration)
    hz = low + 0.0187 * (np.exp(4 * since / duration) - 1) * (high - low)
    on = (t >= begin) & (t < begin + duration)
    return np.asarray(on * np.sin(2 * np.pi * np.cumsum(hz * on) * (t[1] - t[0])))


def flight(
    seed: int, chirps: Sequence[tuple[float, float, str]] = (), seconds: float = 60.0, rate_hz: float = 200.0
) -> dict[str, Array]:
    """Hover in gusts, with chirps (begin, duration, axis) of 0.5 to 10 Hz under a fifth of noise."""
    rng = np.random.default_rng(seed)
    t = 100 + np.arange(round(seconds * rate_hz)) / rate_hz
    x, y = (0.008 * noise(rng, t.size, rate_hz, 0.1, 20) for _ in range(2))
    for begin, duration, axis in chirps:
        put_in = 0.1 * tischler(t, begin, duration, 0.5, 10.0)
        put_in += 0.02 * ((t >= begin) & (t < begin + duration)) * noise(rng, t.size, rate_hz, 0.2, 15, 0)
        x, y = x + (put_in if axis == "roll" else 0.3 * put_in), y + (put_in if axis == "pitch" else 0.3 * put_in)
    p, q = 3 * x + 0.02 * rng.standard_normal(t.size), 2 * y + 0.02 * rng.standard_normal(t.size)
    return {"t": t, "p": p, "q": q, "delta_x": x, "delta_y": y}


def runs_in(log: Log, **more: object) -> tuple[Run, ...]:
    return runs.runs_of([(log, PROFILE)], "fake", "0", **more).runs  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------ the excitation


@pytest.mark.parametrize("seed", range(4))
def test_chirps_are_found_by_their_excitation(seed: int) -> None:
    fields = flight(seed, [(109.0, 15.0, "roll"), (130.0, 20.0, "pitch")])
    found = runs_in(FakeLog(fields))
    assert [(run.maneuver, run.axis) for run in found] == [("chirp", "roll"), ("chirp", "pitch")]
    for run, (start, duration) in zip(found, [(109.0, 15.0), (130.0, 20.0)], strict=True):
        assert run.start_s == pytest.approx(start, abs=0.5)
        assert run.start_s + run.duration_s == pytest.approx(start + duration, abs=0.5)
        assert run.swept_band_hz == pytest.approx((0.5, 10.0), rel=0.2)
        assert run.usable, run.reasons
        assert any("found by its excitation, no settings in the log" in note for note in run.notes)


def test_a_falling_chirp_is_found_too() -> None:
    fields = flight(1)
    t = fields["t"]
    fields["delta_y"] = fields["delta_y"] + 0.1 * tischler(250 - t[::-1], 110.0, 20.0, 0.5, 10.0)[::-1]
    (span,) = excited.find_in(fields)
    # played backwards: it begins fast where the clock of the mirrored one ends
    mirrored = 250 - t[::-1]
    begin = float(t[::-1][np.flatnonzero((mirrored >= 110.0) & (mirrored < 130.0))].min())
    assert (span.maneuver, span.axis) == ("chirp", "pitch")
    assert span.start_s == pytest.approx(begin, abs=0.5)
    assert span.stop_s == pytest.approx(begin + 20.0, abs=0.5)


def stick(rng: np.random.Generator, t: Array) -> Array:
    """A pilot's inputs at 50 Hz, held between."""
    return np.repeat(0.15 * noise(rng, t.size, 200.0, 0.1, 4)[::4], 4)[: t.size]


def shaken(rng: np.random.Generator, t: Array) -> Array:
    """A pilot who shakes the stick at nearly one frequency."""
    return 0.2 * noise(rng, t.size, 200.0, 1.5, 3.0, 0)


def cycle(rng: np.random.Generator, t: Array) -> Array:
    return 0.1 * np.sin(2 * np.pi * 4 * t) + 0.01 * rng.standard_normal(t.size)


def pulses(rng: np.random.Generator, t: Array) -> Array:
    """A hand's pulses: no two of the same height or length."""
    levels = rng.uniform(-0.3, 0.3, 80) * rng.integers(0, 2, 80)
    edges = np.cumsum(rng.uniform(0.3, 1.5, 80)) + t[0]
    return levels[np.clip(np.searchsorted(edges, t), 0, 79)]


@pytest.mark.parametrize("hand", [stick, shaken, cycle, pulses])
@pytest.mark.parametrize("seed", range(3))
def test_no_maneuver_is_found_in_what_is_none(hand: Callable[..., Array], seed: int) -> None:
    fields = flight(seed)
    rng = np.random.default_rng(100 + seed)
    fields["delta_x"] = fields["delta_x"] + hand(rng, fields["t"])
    assert excited.find_in(fields) == []
    (run,) = runs_in(FakeLog(fields))
    assert (run.maneuver, run.usable) == ("unknown", False)
    assert any("no excitation maneuver" in reason for reason in run.reasons)


@pytest.mark.parametrize("slope", [0.0, 0.5, 1.0])
def test_no_maneuver_is_found_in_noise(slope: float) -> None:
    rng = np.random.default_rng(5)
    t = np.arange(40_000) / 200.0
    x, y = (0.05 * noise(rng, t.size, 200.0, 0.05, 60.0, slope) for _ in range(2))
    assert excited.find_in({"t": t, "delta_x": x, "delta_y": y}) == []


def test_doublets_are_found_as_one_train() -> None:
    fields = flight(2)
    t = fields["t"]
    since = (t - 120.0) % 1.5
    on = (t >= 120.0) & (t < 126.0)
    fields["delta_x"] = fields["delta_x"] + on * np.select([since < 0.25, since < 0.5], [0.1, -0.1], 0.0)
    (span,) = excited.find_in(fields)
    assert (span.maneuver, span.axis) == ("doublet", "roll")
    assert span.start_s == pytest.approx(120.0, abs=0.02)
    assert 125.0 - 0.02 <= span.stop_s <= 126.0


def test_a_logged_excitation_tells_the_axis_where_feedback_is_larger() -> None:
    fields = flight(3, [(110.0, 20.0, "roll")])
    fields["excitation_x"] = 0.1 * tischler(fields["t"], 110.0, 20.0, 0.5, 10.0)
    fields["delta_y"] = 3 * fields["delta_y"]
    (span,) = excited.find_in(fields)
    assert span.axis == "roll"
    assert span.start_s == pytest.approx(110.0, abs=0.1)


def test_a_window_leaves_found_runs_their_numbers_and_sweeps_what_is_in_it() -> None:
    log = FakeLog(flight(0, [(109.0, 15.0, "roll"), (130.0, 20.0, "pitch")]))
    (second,) = runs_in(log, window=(136.0, 150.0))
    assert second.id == "fake#2"
    assert second.swept_band_hz is not None
    assert second.swept_band_hz[0] == pytest.approx(0.5 + 0.0187 * (math.exp(1.2) - 1) * 9.5, rel=0.2)
    assert second.swept_band_hz[1] == pytest.approx(10.0, rel=0.2)


def test_a_csv_is_not_cut_but_called_after_its_chirp(saved: Saved) -> None:
    fields = flight(0, [(109.0, 30.0, "roll")])
    rows = np.stack([fields[name] for name in ("t", *CHANNELS)], axis=1)
    text = "t,p,q,delta_x,delta_y\n" + "\n".join(",".join(f"{v:.6g}" for v in row) for row in rows)
    (run,) = ingest([saved(text.encode(), "sweep.csv")]).runs
    assert (run.maneuver, run.axis, run.usable) == ("chirp", "roll", True)
    assert run.swept_band_hz == pytest.approx((0.5, 10.0), rel=0.2)
    assert run.start_s == pytest.approx(100.0)
    assert run.duration_s == pytest.approx(60.0, abs=0.01)


# ------------------------------------------------------------------------------------------------ modes and texts


def test_mode_systemid_tells_where_it_was_flown_and_the_excitation_when() -> None:
    fields = flight(4, [(109.0, 15.0, "roll"), (130.0, 20.0, "pitch")])
    log = FakeLog(fields, modes=[(100.0, 5), (108.4, 25), (126.0, 0), (129.4, 25), (152.0, 5)])
    first, second = runs_in(log)
    assert (first.axis, second.axis) == ("roll", "pitch")
    assert (first.entered_s, second.entered_s) == (108.4, 129.4)
    assert first.start_s == pytest.approx(109.0, abs=0.5)
    assert first.duration_s == pytest.approx(15.0, abs=0.6)


def test_a_mode_alone_is_believed_where_the_commands_show_nothing() -> None:
    fields = flight(4)
    (span,) = told.find(FakeLog(fields, modes=[(108.0, 25), (126.0, 0)]))
    assert (span.start_s, span.stop_s, span.maneuver, span.swept_band_hz) == (109.0, 126.0, "chirp", None)
    (run,) = runs_in(FakeLog(fields, modes=[(108.0, 25), (126.0, 0)]))
    assert run.start_s == pytest.approx(109.0)
    assert any("settings" in note for note in run.notes)


def test_mode_25_of_a_plane_or_of_another_autopilot_is_something_else() -> None:
    fields = flight(4)
    modes = [(108.0, 25), (126.0, 0)]
    assert told.find(FakeLog(fields, texts=[(100.0, "ArduPlane V4.5.1 (abc)")], modes=modes)) == []
    assert told.find(FakeLog(fields, kind="ulog", modes=modes)) == []


def test_ardupilots_texts_tell_axis_and_end() -> None:
    fields = flight(4)
    texts = [
        (100.0, "Arming motors"),
        (108.0, "SystemID Starting: axis=11"),
        (122.0, "SystemID Stopped: lean=31.0 max=30.0"),
        (130.0, "SystemID Starting: axis=10"),
        (150.0, "SystemID Finished"),
    ]
    first, second = told.find(FakeLog(fields, texts=texts))
    assert (first.axis, first.start_s, first.stop_s) == ("pitch", 109.0, 122.0)
    assert any("Stopped: lean" in note for note in first.notes)
    assert (second.axis, second.start_s, second.stop_s) == ("roll", 131.0, 150.0)
    assert not any("ended" in note for note in second.notes)


def test_texts_and_modes_about_one_run_are_one_run() -> None:
    texts = [(108.2, "SystemID Starting: axis=10"), (125.0, "SystemID Finished")]
    (span,) = told.find(FakeLog(flight(4), texts=texts, modes=[(100.0, 0), (108.9, 25), (126.0, 0)]))
    assert (span.axis, span.entered_s, span.stop_s) == ("roll", 108.2, 125.0)


@pytest.mark.parametrize(
    ("start", "stop", "maneuver", "axis"),
    [
        ("sys_id_chirp: pitch started", "sys_id_chirp: done", "chirp", "pitch"),
        ("Chirp roll active", "chirp off", "chirp", "roll"),
        ("doublet begin (pitch)", "doublet complete", "doublet", "pitch"),
        ("Sweep started", "Sweep aborted by pilot", "chirp", None),
    ],
)
def test_other_autopilots_texts(start: str, stop: str, maneuver: str, axis: str | None) -> None:
    log = FakeLog(flight(4), kind="ulog", texts=[(110.0, start), (125.0, stop)])
    (span,) = told.find(log)
    assert (span.start_s, span.stop_s, span.maneuver, span.axis) == (110.0, 125.0, maneuver, axis)


def test_texts_about_other_things_tell_of_no_run() -> None:
    texts = [
        (101.0, "EKF3 IMU0 started"),
        (102.0, "Mission: 1 Takeoff"),
        (110.0, "Autotune: stopped"),
        (120.0, "GPS on"),
    ]
    assert told.find(FakeLog(flight(4), texts=texts)) == []


# ------------------------------------------------------------------------------------------------ real logs


def without(data: bytes, names: set[str]) -> bytes:
    """A DataFlash log from which some kinds of message are gone, formats included."""
    lengths: dict[int, int] = {128: 89}
    gone: set[int] = set()
    kept = []
    at = 0
    while at + 3 <= len(data):
        id = data[at + 2]
        if data[at : at + 2] != b"\xa3\x95" or id not in lengths:
            at += 1
            continue
        message = data[at : at + lengths[id]]
        at += lengths[id]
        if id == 128:
            lengths[message[3]] = message[4]
            if message[5:9].rstrip(b"\0").decode() in names:
                gone.add(message[3])
                continue
        if id not in gone:
            kept.append(message)
    return b"".join(kept)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "axis", "start_s"),
    [
        ("quad_roll_sweep.BIN", "roll", 77.172),
        pytest.param("quad_pitch_sweep.BIN", "pitch", 76.942, marks=pytest.mark.thorough),
        pytest.param("heli_roll_sweep.BIN", "roll", 256.590, marks=pytest.mark.thorough),
        pytest.param("heli_pitch_sweep.BIN", "pitch", 95.310, marks=pytest.mark.thorough),
    ],
)
@pytest.mark.parametrize("told_of", [True, False])
def test_a_real_sweep_is_found_without_its_settings(
    shared_data: Path, saved: Saved, name: str, axis: str, start_s: float, told_of: bool
) -> None:
    gone = {"SIDS", "SIDD"} if told_of else {"SIDS", "SIDD", "MODE", "MSG"}
    (run,) = ingest([saved(without((shared_data / "ardupilot" / name).read_bytes(), gone), "bare.BIN")]).runs
    assert (run.maneuver, run.axis, run.usable, run.rate_source) == ("chirp", axis, True, "RATE")
    # a fade of 5 s from the least amplitude: its first second is below the noise
    assert run.start_s == pytest.approx(start_s, abs=1.0)
    assert run.start_s + run.duration_s == pytest.approx(start_s + 60, abs=1.0)
    assert run.swept_band_hz == pytest.approx((0.5, 10.0), rel=0.2)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Run]]:
    """A log of the simulated vehicle with a roll and a pitch chirp of Table 1 in gusts, and its runs as SIDS tells."""
    vehicle = make_vehicle("hover", seed=3, directory=tmp_path_factory.mktemp("hover"))
    for axis, magnitude in ((ROLL, 0.10), (PITCH, 0.15)):
        fly_maneuver(vehicle, CHIRP, axis, magnitude, 20.0, rest_steps=1500)
    assert vehicle.directory is not None
    log = log_of(vehicle, vehicle.directory)
    return log.read_bytes(), list(ingest([log]).runs)


@pytest.mark.parametrize("kept", [*thorough(["excitation logged"]), "commands alone"])
def test_the_simulated_vehicles_chirps_are_found_without_a_word(
    simulated: tuple[bytes, list[Run]], saved: Saved, kept: str
) -> None:
    data, known = simulated
    gone = {"SIDS", "SIDD", "SIDY", "MODE", "MSG"} | ({"TPEX"} if kept == "commands alone" else set())
    found = ingest([saved(without(data, gone), "bare.BIN")]).runs
    assert [run.axis for run in known] == ["roll", "pitch"]
    assert [(run.maneuver, run.axis, run.usable) for run in found] == [
        ("chirp", "roll", True),
        ("chirp", "pitch", True),
    ]
    within = 0.02 if kept == "excitation logged" else 1.0
    for run, true in zip(found, known, strict=True):
        assert run.start_s == pytest.approx(true.start_s, abs=within)
        assert run.start_s + run.duration_s == pytest.approx(true.start_s + true.duration_s, abs=within)
        assert run.swept_band_hz == pytest.approx((0.5, 10.0), rel=0.2)


@pytest.mark.data
def test_a_pilot_shaking_a_quadrotor_is_no_chirp(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"]).runs
    assert (run.maneuver, run.axis, run.swept_band_hz) == ("unknown", None, None)


@pytest.mark.data
def test_a_pilots_flight_has_no_maneuver(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "log171.bin"]).runs
    assert run.maneuver == "unknown"

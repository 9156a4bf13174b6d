"""Health: each way of being unusable is found, named, and comes with what to do."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from gcs.logs import ingest
from gcs.logs.formats.tables import Series
from gcs.logs.profile.profiles import ChannelSource, Profile
from gcs.logs.runs import around, health, latency
from sysid.data import preprocess
from sysid.data.record import Record

Change = Callable[[dict[str, np.ndarray]], None]


def channels(rate_hz: float = 200.0, seconds: float = 20.0) -> dict[str, np.ndarray]:
    t = np.arange(0, seconds, 1 / rate_hz)
    x, y = 0.1 * np.sin(2 * np.pi * 2 * t), 0.1 * np.sin(2 * np.pi * 3 * t)
    return {"t": t, "p": 3 * x, "q": 2 * y, "delta_x": x, "delta_y": y}


def record(c: dict[str, np.ndarray], maneuver: str = "chirp") -> Record:
    return Record("x#1", c, maneuver=maneuver)


def test_a_sound_run_has_no_reasons_and_measures_its_excitation() -> None:
    found = health.check(record(channels()))
    assert found.usable
    assert found.notes == ()
    assert found.rate_hz == pytest.approx(200)
    command, rate = found.excitation["roll"]
    assert command == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    assert rate == pytest.approx(0.3 / np.sqrt(2), rel=0.02)


def test_gaps_split_and_do_not_count_in_the_rate() -> None:
    c = channels()
    keep = (c["t"] < 8) | (c["t"] > 9.5)
    found = health.check(record({name: values[keep] for name, values in c.items()}))
    assert found.gaps == ((pytest.approx(7.995), pytest.approx(9.505)),)
    assert found.rate_hz == pytest.approx(200)
    assert found.longest_piece_s == pytest.approx(10.49, abs=0.01)
    assert found.usable
    assert "1 gap" in found.notes[0]


def test_a_gap_is_more_than_three_medians_and_more_than_a_quarter_of_the_shortest_period() -> None:
    t = np.cumsum(np.r_[0, np.full(500, 0.002), 0.016, np.full(500, 0.002), 0.018, np.full(500, 0.002)])
    assert (preprocess.gap_places(np.diff(t), 15.0) - 1).tolist() == [1001]
    assert (preprocess.gap_places(np.diff(t), 20.0) - 1).tolist() == [500, 1001]


def still(c: dict[str, np.ndarray]) -> None:
    for name in ("p", "q", "delta_x", "delta_y"):
        c[name] = 1e-4 * c[name]


def no_commands(c: dict[str, np.ndarray]) -> None:
    c["delta_x"] = c["delta_y"] = np.zeros_like(c["t"])


def dead_gyro(c: dict[str, np.ndarray]) -> None:
    c["p"] = np.full_like(c["t"], 0.25)


def degrees(c: dict[str, np.ndarray]) -> None:
    c["p"] = np.rad2deg(5 * c["p"])


def microseconds(c: dict[str, np.ndarray]) -> None:
    c["delta_x"] = 1500 + 4000 * c["delta_x"]


def at_the_stop(c: dict[str, np.ndarray]) -> None:
    c["delta_x"] = np.clip(30 * c["delta_x"], -1, 1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (still, ["no excitation", "fly a chirp"]),
        (no_commands, ["neither delta_x nor delta_y", "profile"]),
        (dead_gyro, ["p never changes", "gyro"]),
        (degrees, ["degrees", "scale"]),
        (microseconds, ["delta_x reaches 1900", "scale"]),
        (at_the_stop, ["full command", "less amplitude"]),
    ],
)
def test_values_that_cannot_be_used(change: Change, words: list[str]) -> None:
    c = channels()
    change(c)
    found = health.check(record(c))
    assert not found.usable
    text = "; ".join(found.reasons)
    for word in words:
        assert word in text


def test_too_slow_too_short_and_torn_to_pieces() -> None:
    slow = health.check(record(channels(49.0)))
    assert "49.0 Hz" in slow.reasons[0]
    assert "60 Hz" in slow.reasons[0]
    assert health.check(record(channels(49.0)), f_high_hz=10).usable
    short = health.check(record(channels(seconds=3.0)))
    assert "only 3.0 s long" in short.reasons[0]
    (shorter,) = health.check(record(channels(seconds=1.0))).reasons
    assert "only 1.0 s long" in shorter, "there is no gap that could be to blame"
    c = channels()
    keep = (c["t"] % 1.0) < 0.8
    torn = health.check(record({name: values[keep] for name, values in c.items()}))
    assert any("no piece of 2 s" in reason for reason in torn.reasons)


def test_a_command_logged_slowly_is_named() -> None:
    found = health.check(record(channels()), slow_channels={"delta_x": 0.1, "omega": 0.1})
    assert found.reasons == (
        "delta_x is logged at 10 Hz only; at least 60 Hz are needed: log the command in every control loop",
    )


def test_quiet_needs_no_excitation() -> None:
    c = channels()
    still(c)
    assert health.check(record(c, "quiet")).usable


def test_one_axis_alone_is_enough_and_said() -> None:
    c = channels()
    c["delta_y"] = np.zeros_like(c["t"])
    found = health.check(record(c))
    assert found.usable
    assert "delta_y never changes" in found.notes[0]


def test_a_clipped_gyro_is_noted() -> None:
    c = channels()
    c["p"] = np.clip(c["p"], -0.2, 0.2)
    assert any("clipped" in note for note in health.check(record(c)).notes)


def test_the_times_of_gaps_are_said() -> None:
    c = channels()
    keep = (c["t"] < 8) | (c["t"] > 9.5)
    found = health.check(record({name: values[keep] for name, values in c.items()}))
    assert "7.99-9.51 s of the log" in found.notes[0] or "8.00-9.51 s of the log" in found.notes[0]


@pytest.mark.parametrize(("spread", "noted"), [(0.1, False), (0.45, True)])
def test_jitter_is_measured_and_noted_where_it_is_large(spread: float, noted: bool) -> None:
    c = channels()
    rng = np.random.default_rng(1)
    c["t"] = np.cumsum(0.005 * (1 + spread * rng.uniform(-1.7, 1.7, c["t"].size)))
    found = health.check(record(c))
    assert found.jitter == pytest.approx(spread, rel=0.05)
    assert any("irregularly" in note for note in found.notes) == noted
    assert found.usable, "time stamps that are right are used as they are"


def test_a_gyro_at_full_scale_is_named_and_when() -> None:
    c = channels()
    full = math.radians(250)
    c["p"] = np.clip(40 * c["p"], -full, full)
    (note,) = [note for note in health.check(record(c)).notes if "clipped" in note]
    assert "250 deg/s" in note
    first = float(c["t"][np.argmax(np.abs(c["p"]) == full)])
    assert f"first at {first:.2f} s" in note
    assert health.check(record(c)).clipped["p"] > 10


def test_a_slow_field_that_is_repeated_is_not_clipped() -> None:
    c = channels()
    c["p"] = np.repeat(c["p"][::8], 8)[: c["t"].size]
    assert health.check(record(c)).clipped == {}


def sweep(noise: float, seconds: float = 30.0) -> dict[str, np.ndarray]:
    """A roll sweep of 0.5 to 10 Hz answered with noise (rad/s rms, white) on p."""
    rng = np.random.default_rng(3)
    t = np.arange(0, seconds + 1, 0.005)
    x = 0.1 * np.sin(2 * np.pi * 0.5 * seconds / np.log(20) * (20 ** (t / seconds) - 1)) * (t < seconds)
    y = 0.01 * np.cumsum(rng.standard_normal(t.size)) / np.sqrt(t.size)
    return {"t": t, "p": 3 * x + noise * rng.standard_normal(t.size), "q": 2 * y, "delta_x": x, "delta_y": y}


def test_coherence_and_power_say_in_which_band() -> None:
    found = health.check(Record("x#1", sweep(0.05), maneuver="chirp", axis="roll", swept_band_hz=(0.5, 10.0)))
    low, high = found.command_band_hz["roll"]
    assert low == pytest.approx(0.5, abs=0.3)
    assert high == pytest.approx(10.0, abs=1.0)
    coherent = found.coherent["roll"]
    assert (coherent.low_hz, coherent.high_hz) == pytest.approx((0.5, 10.0), abs=0.6)
    assert coherent.share > 0.9
    assert found.notes == ()
    assert "coherence 0.5-" in found.words("roll")


def test_rates_that_do_not_follow_are_noted() -> None:
    c = sweep(0.05)
    c["p"] = 0.2 * np.random.default_rng(4).standard_normal(c["t"].size)
    found = health.check(Record("x#1", c, maneuver="chirp", axis="roll", swept_band_hz=(0.5, 10.0)))
    assert found.coherent["roll"].share < 0.3
    assert any("the rates follow the roll command in only" in note for note in found.notes)


@pytest.mark.parametrize(("other", "noted"), [(0.05, True), (3.0, False)])
def test_inputs_that_move_together_are_noted(other: float, noted: bool) -> None:
    c = sweep(0.05)
    rng = np.random.default_rng(5)
    own = np.convolve(rng.standard_normal(c["t"].size), np.ones(20) / 20, "same")
    c["delta_y"] = -0.5 * c["delta_x"] + other * 0.1 * own
    found = health.check(record(c))
    assert found.input_correlation is not None
    assert (found.input_correlation < -0.9) == noted
    assert any("cannot be separated" in note for note in found.notes) == noted
    assert found.usable, "joined with another run it is worth something"


# ------------------------------------------------------------------------------------------------ the log around it


class FakeLog:
    """Messages with clocks of their own: {"M": {"t": ..., "field": ...}}."""

    def __init__(
        self,
        messages: Mapping[str, Mapping[str, np.ndarray]],
        armed: Sequence[tuple[float, bool]] = (),
        kind: str = "dataflash",
    ) -> None:
        self.path, self.kind, self.dropped, self.sampled_s = "fake", kind, dict[str, int](), 100.0
        self._messages = messages
        self._armed = armed

    def has(self, key: str) -> bool:
        message, _, field = key.partition(".")
        return field in self._messages.get(message, {})

    def series(self, key: str) -> Series:
        message, _, field = key.partition(".")
        return Series(self._messages[message]["t"], self._messages[message][field], message)

    def fields(self) -> tuple[str, ...]:
        return tuple(f"{name}.{field}" for name, one in self._messages.items() for field in one if field != "t")

    def texts(self) -> Sequence[tuple[float, str]]:
        return ()

    def modes(self) -> Sequence[tuple[float, int]]:
        return ()

    def armed(self) -> Sequence[tuple[float, bool]]:
        return self._armed


def profile(**sources: str) -> Profile:
    return Profile(
        name="fake", channels={name: ChannelSource(name, tuple(text.split("|"))) for name, text in sources.items()}
    )


SAMPLES = {"G": {"t": np.arange(10.0, 100.0, 0.5), "p": np.arange(180.0)}}


@pytest.mark.parametrize(
    ("kind", "armed", "words"),
    [
        ("dataflash", [], None),
        ("dataflash", [(20.0, True), (90.0, False)], None),
        ("dataflash", [(95.0, False)], None),  # an event: it was armed until then
        ("dataflash", [(10.1, False)], "never armed"),
        ("ulog", [(16.0, False)], "never armed"),
        ("ulog", [(10.0, False), (70.0, True)], "only in other parts"),
        ("ulog", [(10.0, False), (40.0, True), (41.0, False)], None),
        ("dataflash", [(12.0, True), (25.0, False)], "only in other parts"),
    ],
)
def test_disarmed_throughout(kind: str, armed: list[tuple[float, bool]], words: str | None) -> None:
    said = around.disarmed(FakeLog(SAMPLES, armed, kind), 30.0, 60.0)
    assert (said is None) == (words is None)
    assert words is None or (said is not None and "disarmed throughout" in said and words in said)


def test_rates_too_slow_and_actuators_not_logged_say_what_there_is() -> None:
    slow = np.arange(0, 60.0, 1.0)
    log = FakeLog(
        {
            "ATTITUDE": {"t": slow, "rollspeed": slow, "pitchspeed": slow},
            "VFR_HUD": {"t": np.arange(0, 60, 0.25), "alt": np.arange(240.0)},
        },
        kind="tlog",
    )
    of = profile(p="ATTITUDE.rollspeed", q="ATTITUDE.pitchspeed", delta_x="SERVO.x - SERVO.y", delta_y="SERVO.y")
    slow_reason, missing = around.slow_rates(log, of), around.no_actuators(log, of)
    assert slow_reason is not None
    assert missing is not None
    assert slow_reason.startswith("ATTITUDE at 1 Hz: too slow for attitude identification")
    assert missing.startswith("actuators not logged: no SERVO for delta_x, delta_y")
    assert "VFR_HUD at 4 Hz, ATTITUDE at 1 Hz" in missing


@pytest.mark.parametrize(("difference", "said"), [(0.0, True), (0.5, False)])
def test_equal_motors_make_no_moment(difference: float, said: bool) -> None:
    t = np.arange(0, 10, 0.02)
    together = 1200 + 50 * np.sin(t)
    log = FakeLog({"RCOU": {"t": t, **{f"C{i}": together + difference * (i == 2) for i in (1, 2, 3, 4)}}})
    moment = {"delta_x": "(-RCOU.C1 + RCOU.C2 + RCOU.C3 - RCOU.C4)", "delta_y": "RCOU.C1 - RCOU.C2"}
    plain = {"delta_x": "RATE.ROut", "delta_y": "RATE.POut"}
    for sources, moved in ((moment, 0.0), (plain, 0.05)):
        reason = around.equal_motors(log, sources, {"roll": (moved, 0.0)}, 0.0, 10.0)
        assert (reason is not None and reason.startswith("roll commands and motors equal: no moment")) == said
    assert around.equal_motors(log, plain, {"roll": (0.0, 0.0)}, 0.0, 10.0) is None, "nothing was commanded"


def test_motors_on_other_outputs_are_not_missed() -> None:
    t = np.arange(0, 10, 0.02)
    outputs = {f"C{i}": np.full(t.size, 1500.0) for i in (1, 2, 3, 4)} | {"C5": 1200 + 50 * np.sin(t)}
    log = FakeLog({"RCOU": {"t": t, **outputs}})
    plain = {"delta_x": "RATE.ROut", "delta_y": "RATE.POut"}
    assert around.equal_motors(log, plain, {"roll": (0.05, 0.3)}, 0.0, 10.0) is None


def test_quiet_hover_is_found_beside_a_run_and_not_in_another() -> None:
    rng = np.random.default_rng(6)
    t = np.arange(0, 100, 0.01)
    loud = ((t > 30) & (t < 60)) | (t < 20) | (t > 68)
    p = (0.02 + 0.4 * loud) * rng.standard_normal(t.size)
    log = FakeLog({"G": {"t": t, "p": p, "q": p[::-1].copy(), "x": 0.1 * p, "y": 0.1 * p}})
    log._messages["G"]["q"][:] = p  # type: ignore[index]
    of = profile(p="G.p", q="G.q", delta_x="G.x", delta_y="G.y")
    before, after = around.quiet(log, of, (30.0, 60.0), 0.4, [(68.0, 90.0)])
    assert (before.where, after.where) == ("before", "after")
    assert before.start_s == pytest.approx(20, abs=1.1)
    assert before.duration_s == pytest.approx(10, abs=1.1)
    assert after.duration_s == pytest.approx(8, abs=1.1)
    still = FakeLog({"G": {"t": t, "p": 0.01 * p, "q": 0.01 * p, "x": 0 * p, "y": 0 * p}})
    assert around.quiet(still, of, (30.0, 60.0), 0.4, []) == (), "commands that do not move: not in the air"


@pytest.mark.parametrize("late_s", [0.0098, -0.0037, 0.031])
def test_latency_is_measured_between_samples(late_s: float) -> None:
    t = np.arange(0, 30, 1 / 400)
    other = np.sort(t + np.random.default_rng(7).uniform(0, 5e-4, t.size))

    def moved(at: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * 0.5 * 30 / np.log(20) * (20 ** (at / 30) - 1))

    log = FakeLog(
        {
            "A": {"t": t, "p": moved(t), "x": moved(t)},
            "B": {"t": other, "p": 57.3 * moved(other - late_s)},
            "C": {"t": t, "p": np.random.default_rng(8).standard_normal(t.size)},
        }
    )
    of = profile(p="A.p|B.p|C.p", q="A.p", delta_x="A.x", delta_y="A.x")
    (found,) = latency.measure(log, of, {"p": "A.p", "delta_x": "A.x"}, {"roll": (0.1, 0.3)}, (0.0, 30.0))
    assert (found.field, found.against) == ("B.p", "A.p")
    assert found.late_s == pytest.approx(late_s, abs=5e-4)
    assert ("later" if late_s > 0 else "earlier") in found.words


@pytest.mark.data
@pytest.mark.parametrize("name", ["quad_roll", "quad_pitch", "heli_roll", "heli_pitch"])
def test_the_health_of_real_sweeps(shared_data: Path, name: str) -> None:
    (run,) = ingest([shared_data / "ardupilot" / f"{name}_sweep.BIN"]).runs
    assert run.health is not None
    assert run.usable
    assert run.notes == ("ArduPilot's law, no noise",), "nothing to be alarmed about"
    axis = run.axis or ""
    coherent = run.health.coherent[axis]
    assert coherent.low_hz <= 0.5
    assert coherent.high_hz > 9.0
    assert coherent.share > 0.9
    assert run.health.jitter < 0.02
    assert {quiet.where for quiet in run.health.quiet} == {"before", "after"}
    late = {one.field.split(".")[0]: one.late_s for one in run.health.latency}
    assert late["RATE"] == pytest.approx(0.010, abs=0.001), "what INS_GYRO_FILTER at 20 Hz takes"


@pytest.mark.data
def test_rates_from_the_later_message_are_noted(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "heli_roll_sweep.BIN"], Path("arducopter_rate")).runs
    assert any("RATE.R is 10.1 ms later than SIDD.Gx" in note for note in run.notes)


@pytest.mark.data
def test_a_vehicle_on_the_bench_was_never_armed(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "px4" / "sample.ulg"]).runs
    assert not run.usable
    assert any("never armed" in reason for reason in run.reasons)
    assert any("motors equal: no moment" in reason for reason in run.reasons)


@pytest.mark.filterwarnings("error")
def test_a_value_beyond_all_reason_hides_no_latency() -> None:
    t = np.arange(0, 20, 0.0025)
    ours, theirs = np.sin(2 * np.pi * 3 * t) + np.sin(2 * np.pi * 5.3 * t), np.zeros(t.size)
    theirs[4:] = ours[:-4]
    theirs[[100, 3000]] = 1e300, np.nan
    found = latency.shift(Series(t, ours, "A"), Series(t, theirs, "B"))
    assert found is not None
    assert found[0] == pytest.approx(0.01, abs=3e-4)

"""Health: each way of being unusable is found, named, and comes with what to do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.logs import health
from sysid.record import Record

Change = Callable[[dict[str, np.ndarray]], None]


def channels(rate_hz: float = 200.0, seconds: float = 20.0) -> dict[str, np.ndarray]:
    t = np.arange(0, seconds, 1 / rate_hz)
    x, y = 0.1 * np.sin(2 * np.pi * 2 * t), 0.1 * np.sin(2 * np.pi * 3 * t)
    return {"t": t, "p": 3 * x, "q": 2 * y, "delta_x": x, "delta_y": y}


def record(c: dict[str, np.ndarray], maneuver: str = "chirp") -> Record:
    return Record("x#1", c, maneuver)


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
    assert health.gaps_in(t, 15.0).tolist() == [1001]
    assert health.gaps_in(t, 20.0).tolist() == [500, 1001]


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
        (still, ["no excitation", "tippath sweep"]),
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

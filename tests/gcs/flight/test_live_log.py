"""The live reader against a log made with struct alone: order, gaps, bounds, damage."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable

import numpy as np
import pytest

from gcs.flight.live import LiveLog
from sitl.autopilot.logger import filler

Make = Callable[..., bytes]


def blocks_of(data: bytes) -> list[bytes]:
    return [data[at : at + 200] for at in range(0, len(data), 200)]


def test_samples_in_si_and_in_step_with_the_excitation(dataflash: Make) -> None:
    log = LiveLog()
    for number, block in enumerate(blocks_of(dataflash(1000))):
        log.feed(number, block)
    window = log.window(100.0)
    i = np.arange(1000.0)
    assert window.received == 1000
    assert window.t == pytest.approx(1.0 + 0.002 * i)
    assert window.p == pytest.approx(i, rel=1e-6)
    assert window.q == pytest.approx(-i, rel=1e-6)
    assert window.delta_x == pytest.approx(0.001 * i, rel=1e-6)
    assert window.delta_y == pytest.approx(-0.001 * i, rel=1e-6)
    assert np.array_equal(window.excitation_x, i)
    assert np.array_equal(window.excitation_y, -i)
    assert window.excitation_e is not None
    assert np.array_equal(window.excitation_e, 2 * i)
    assert window.delta_e is not None
    assert np.array_equal(window.delta_e, 3 * i)
    assert window.sweep_s == pytest.approx(0.002 * 999)
    assert window.sweep_hz == pytest.approx(0.5 + 9.99)


def test_the_window_is_the_newest_seconds(dataflash: Make) -> None:
    log = LiveLog()
    assert log.window(1.0).t.size == 0
    for number, block in enumerate(blocks_of(dataflash(2000, excitation=False, sweep=False))):
        log.feed(number, block)
    window = log.window(0.5)
    assert window.t[-1] == pytest.approx(1.0 + 0.002 * 1999)
    assert window.t.size in (250, 251)
    assert np.all(np.isnan(window.excitation_x))
    assert window.sweep_s is None


def test_order_and_duplicates_do_not_matter(dataflash: Make) -> None:
    blocks = list(enumerate(blocks_of(dataflash(1500))))
    mixed = []
    rng = random.Random(2)
    for at in range(0, len(blocks), 20):
        some = blocks[at : at + 20] * 2
        rng.shuffle(some)
        mixed += some
    straight, shuffled = LiveLog(), LiveLog()
    for number, block in blocks:
        straight.feed(number, block)
    for number, block in mixed:
        shuffled.feed(number, block)
    assert np.array_equal(straight.window(9).p, shuffled.window(9).p)
    assert shuffled.window(9).received == 1500


def test_blocks_resent_long_after_they_were_read_are_not_read_again(dataflash: Make) -> None:
    log = LiveLog()
    blocks = list(enumerate(blocks_of(dataflash(2000))))
    for number, block in blocks:
        log.feed(number, block)
    for number, block in blocks:
        log.feed(number, block)
    assert len(blocks) > log.PATIENCE_BLOCKS
    assert log.window(100.0).received == 2000


def test_a_block_that_never_comes_is_passed_over(dataflash: Make) -> None:
    log = LiveLog()
    blocks = blocks_of(dataflash(4000))
    lost = 400
    for number, block in enumerate(blocks):
        if number != lost:
            log.feed(number, block)
        if number == lost + 300:
            waiting = log.window(100.0).received
    window = log.window(100.0)
    assert waiting < lost * 200 / 140
    assert 3990 <= window.received < 4000
    assert set(np.round(window.p)) <= set(range(4000))
    assert np.max(np.diff(window.t)) < 0.02


def test_old_samples_leave_and_the_newest_stay(dataflash: Make) -> None:
    log = LiveLog(keep_s=0.3, rate_hz=1000.0)
    for number, block in enumerate(blocks_of(dataflash(3000))):
        log.feed(number, block)
    window = log.window(100.0)
    assert window.t.size == 300
    assert np.array_equal(np.round(window.p), np.arange(2700.0, 3000.0))


def test_damage_and_lies_about_formats_raise_nothing(dataflash: Make) -> None:
    rng = random.Random(6)
    clean = dataflash(800)
    for _ in range(60):
        data = bytearray(clean)
        for _ in range(30):
            data[rng.randrange(len(data))] = rng.randrange(256)
        log = LiveLog()
        for number, block in enumerate(blocks_of(bytes(data))):
            log.feed(number, block)
        window = log.window(1000.0)
        assert window.t.size == window.p.size
    log = LiveLog()
    for number in range(300):
        log.feed(number, rng.randbytes(200))
    assert log.window(1.0).t.size == 0


def test_a_new_log_forgets_the_old(dataflash: Make) -> None:
    log = LiveLog()
    for number, block in enumerate(blocks_of(dataflash(500))):
        log.feed(number, block)
    log.restart()
    assert log.window(9).t.size == 0
    for number, block in enumerate(blocks_of(dataflash(100, start_us=0))):
        log.feed(number, block)
    assert log.window(9).received == 100


# ------------------------------------------------------------------------------------------------ what the vehicle says

FORMATS = {
    "SIDS": (10, "QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout"),
    "SIDY": (11, "QBBfff", "TimeUS,Kind,Law,C1,Noise,Pulse"),
    "MODE": (12, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "SIDD": (13, "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az"),
    "RATE": (14, "Qfffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew"),
    "MSG": (15, "QZ", "TimeUS,Message"),
    "PAD4": (16, "B", "Zero"),
    "PAD5": (17, "H", "Zero"),
}


def log_of(*messages: tuple[str, float, tuple[float | bytes, ...]]) -> bytes:
    """Formats, then messages as (name, seconds, columns after TimeUS), filled up to whole blocks."""
    packings = {
        name: struct.Struct("<BBB" + codes.replace("M", "B").replace("Z", "64s"))
        for name, (_, codes, _) in FORMATS.items()
    }
    out = b""
    for name, (kind, codes, labels) in FORMATS.items():
        fields = (kind, packings[name].size, name.encode(), codes.encode(), labels.encode())
        out += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields)
    for name, t, columns in messages:
        out += packings[name].pack(0xA3, 0x95, FORMATS[name][0], round(t * 1e6), *columns)
    fours, fives = filler(len(out))
    return out + b"\xa3\x95\x10\0" * fours + b"\xa3\x95\x11\0\0" * fives


def read(data: bytes, skip: int | None = None) -> LiveLog:
    log = LiveLog()
    log.PATIENCE_BLOCKS = 3
    for number, block in enumerate(blocks_of(data)):
        if number != skip:
            log.feed(number, block)
    return log


def rate(t: float) -> tuple[str, float, tuple[float, ...]]:
    return ("RATE", t, (0.0,) * 13)


def sample(t: float, time_s: float) -> tuple[str, float, tuple[float, ...]]:
    return ("SIDD", t, (time_s, 0.1, 0.5, *(0.0,) * 6))


SIDS = (10, 0.15, 0.5, 10.0, 1.0, 4.0, 30.0, 2.0)


def sweep(begin_s: float, length_s: float, time_s: float = 0.0) -> list[tuple[str, float, tuple[float, ...]]]:
    steps = [i * 0.1 for i in range(round(length_s / 0.1) + 1)]
    return [message for dt in steps for message in (sample(begin_s + dt, time_s + dt), rate(begin_s + dt))]


def test_the_vehicles_own_record_of_its_sweep_and_mode() -> None:
    entered = ("SIDS", 5.0, SIDS), ("SIDY", 5.0, (0, 0, 4.0, 0.2, 1.5)), ("MODE", 5.0, (25, 25, 1))
    window = read(log_of(rate(4.9), *entered, *sweep(5.0, 2.0))).window(60.0)
    settings = window.sweep_settings
    assert settings is not None
    assert (settings.at_s, settings.axis) == (5.0, 10)
    assert (settings.magnitude, settings.noise) == (pytest.approx(0.15), pytest.approx(0.2))
    assert (settings.f_start_hz, settings.f_stop_hz, settings.duration_s) == (0.5, 10.0, 30.0)
    assert (settings.fade_in_s, settings.constant_s, settings.fade_out_s) == (1.0, 4.0, 2.0)
    assert (settings.kind, settings.law, settings.c1, settings.pulse_s) == (0, 0, 4.0, 1.5)
    assert (window.mode, window.mode_at_s) == (25, 5.0)
    assert (window.sweep_s, window.sweep_entered_s) == (pytest.approx(2.0), 5.0)
    assert window.log_s == pytest.approx(7.0)


def test_a_vehicle_without_the_second_record() -> None:
    settings = read(log_of(("SIDS", 5.0, SIDS), *sweep(5.0, 1.0))).window(60.0).sweep_settings
    assert settings is not None
    assert (settings.kind, settings.law, settings.c1, settings.noise) == (None, None, None, None)


def test_the_first_sweep_is_not_taken_for_the_second() -> None:
    first = [("SIDS", 5.0, SIDS), ("MODE", 5.0, (25, 25, 1)), *sweep(5.0, 3.0)]
    left = [("MODE", 8.05, (0, 0, 1)), rate(8.1)]
    again = [("SIDS", 8.2, SIDS), ("MODE", 8.2, (25, 25, 1))]
    assert read(log_of(*first)).window(60.0).sweep_entered_s == 5.0
    after_it = read(log_of(*first, *left)).window(60.0)
    assert (after_it.sweep_s, after_it.sweep_hz, after_it.sweep_entered_s, after_it.mode) == (None, None, None, 0)
    assert read(log_of(*first, *left, *again)).window(60.0).sweep_s is None
    assert read(log_of(*first, again[0], rate(8.2))).window(60.0).sweep_s is None
    second = read(log_of(*first, *left, *again, *sweep(8.2, 1.0))).window(60.0)
    assert (second.sweep_s, second.sweep_entered_s) == (pytest.approx(1.0), 8.2)


def test_a_sweep_whose_record_was_lost_is_dated_by_its_own_time() -> None:
    window = read(log_of(("SIDS", 5.0, SIDS), *sweep(5.0, 1.0), *sweep(20.0, 1.0, time_s=0.5))).window(60.0)
    assert (window.sweep_s, window.sweep_entered_s) == (pytest.approx(1.5), pytest.approx(19.5))
    assert window.sweep_settings is not None
    assert window.sweep_settings.at_s == 5.0  # of the sweep before: its stamp says so


def test_a_loop_slower_than_nominal_does_not_date_the_entry_later() -> None:
    late = [message for t in range(1, 301) for message in (sample(5.0 + 0.101 * t, 0.1 * t), rate(5.0 + 0.101 * t))]
    window = read(log_of(("SIDS", 5.0, SIDS), *late)).window(60.0)
    assert (window.sweep_s, window.sweep_entered_s) == (pytest.approx(30.0), 5.0)


def test_a_lost_block_may_have_held_a_mode() -> None:
    data = log_of(("MODE", 1.0, (0, 0, 1)), *(rate(1.0 + 0.1 * i) for i in range(60)), ("MODE", 8.0, (2, 2, 1)))
    blocks = len(blocks_of(data))
    assert read(data).window(60.0).mode == 2
    mode_again = read(data, skip=blocks // 2).window(60.0)
    assert (mode_again.mode, mode_again.mode_at_s) == (2, 8.0)
    lost = read(data[: 200 * (blocks - 1)], skip=blocks // 2).window(60.0)
    assert (lost.mode, lost.mode_at_s) == (None, None)
    assert lost.t.size > 20


def test_the_newest_stamp_is_of_any_message_and_needs_no_later_block_at_the_end() -> None:
    data = log_of(*(rate(1.0 + 0.1 * i) for i in range(100)), ("MSG", 12.5, (b"last words",)))
    blocks = blocks_of(data)
    log = read(data)
    assert log.progress() == (12.5, len(blocks))
    assert log.window(60.0).log_s == 12.5
    waiting = LiveLog()
    for number, block in enumerate(blocks):
        if number != len(blocks) - 3:
            waiting.feed(number, block)
    stamp, blocks_read = waiting.progress()
    assert stamp is not None
    assert stamp < 11.0
    assert blocks_read == len(blocks) - 3
    assert waiting.end_s() == 12.5


@pytest.mark.parametrize("name", ["SIDS", "SIDY", "MODE", "SIDD", "RATE"])
def test_formats_that_lie_about_their_types_raise_nothing(name: str) -> None:
    kind, codes, labels = FORMATS[name]
    for lie in ("Z", "n", "f", "d"):
        lying = codes[0] + lie * (len(codes) - 1)
        size = 3 + struct.calcsize("<" + lying.replace("Z", "64s").replace("n", "4s"))
        if size > 255:
            continue
        fields = (kind, size, name.encode(), lying.encode(), labels.encode())
        data = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields)
        data += (b"\xa3\x95" + bytes([kind]) + struct.pack("<Q", 1_000_000) + b"\xff" * (size - 11)) * 3
        assert read(data + log_of(rate(2.0))).window(60.0).log_s == 2.0

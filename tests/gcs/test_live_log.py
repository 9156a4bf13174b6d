"""The live reader against a log made with struct alone: order, gaps, bounds, damage."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest

from gcs.logs.live import LiveLog

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

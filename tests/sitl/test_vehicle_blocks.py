"""The block stream in fake time: what is lost comes again, what is acknowledged never does."""

from __future__ import annotations

import random

from sitl.autopilot.blocks import RESEND_S, SILENCE_S, BlockStream
from sitl.autopilot.logger import BLOCK_BYTES


def fill(stream: BlockStream, blocks: int) -> bytes:
    data = random.Random(blocks).randbytes(blocks * BLOCK_BYTES)
    stream.write(data[:77])  # however the log cuts it
    stream.write(data[77:])
    return data


def test_blocks_come_in_order_and_once() -> None:
    stream = BlockStream(10**6, 0.0)
    data = fill(stream, 30)
    sent = stream.due(0.0)
    assert [number for number, _ in sent] == list(range(30))
    assert b"".join(block for _, block in sent) == data
    assert stream.due(0.05) == []


def test_an_unanswered_block_comes_again_after_100_ms_and_an_acknowledged_one_does_not() -> None:
    stream = BlockStream(10**6, 0.0)
    fill(stream, 3)
    stream.due(0.0)
    stream.acknowledged(1, 0.01)
    assert stream.due(RESEND_S - 0.001) == []
    assert [number for number, _ in stream.due(RESEND_S)] == [0, 2]
    assert stream.due(RESEND_S + 0.05) == []


def test_a_refused_block_comes_again_at_once() -> None:
    stream = BlockStream(10**6, 0.0)
    fill(stream, 8)
    stream.due(0.0)
    stream.refused(5, 0.01)
    stream.refused(5, 0.01)
    assert [number for number, _ in stream.due(0.01)] == [5]
    stream.acknowledged(5, 0.02)
    stream.refused(5, 0.03)
    stream.refused(4_000_000_000, 0.03)
    assert stream.due(0.03) == []


def test_after_an_outage_no_flood() -> None:
    stream = BlockStream(10**7, 0.0)
    fill(stream, 2000)
    for turn in range(100):
        stream.due(0.001 * turn)
    assert stream.open_blocks == 2000
    assert 1 <= len(stream.due(5.0)) <= 5


def test_ten_seconds_without_a_receipt_end_it_and_a_full_buffer_does_too() -> None:
    stream = BlockStream(10**6, 100.0)
    fill(stream, 1)
    assert stream.failure(100.0 + SILENCE_S) is None
    assert stream.failure(100.1 + SILENCE_S) is not None
    stream.due(100.0)
    stream.acknowledged(0, 105.0)
    assert stream.failure(104.9 + SILENCE_S) is None
    small = BlockStream(4 * BLOCK_BYTES, 0.0)
    fill(small, 4)
    assert small.failure(0.0) is None
    fill(small, 1)
    assert small.failure(0.0) == "buffer full"


def test_everything_arrives_through_bad_air() -> None:
    """30 % of blocks and of receipts lost, and a second of nothing: all there, in bounded time."""
    rng = random.Random(7)
    stream = BlockStream(10**6, 0.0)
    data = b""
    received: dict[int, bytes] = {}
    now = 0.0
    for turn in range(20_000):
        now = 0.002 * turn
        if turn < 2000:
            piece = rng.randbytes(140)
            data += piece
            stream.write(piece)
        if turn == 2000:
            tail = rng.randbytes(-len(data) % BLOCK_BYTES)
            data += tail
            stream.write(tail)
            stream.close()
        for number, block in stream.due(now):
            if rng.random() < 0.3 or 1.0 <= now < 2.0:
                continue
            received[number] = block
            if rng.random() >= 0.3:
                stream.acknowledged(number, now)
        if stream.delivered:
            break
    assert stream.delivered
    assert now < 10.0
    assert b"".join(received[number] for number in range(len(received))) == data

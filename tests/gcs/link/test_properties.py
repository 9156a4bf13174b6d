"""Properties of what reads a stranger's bytes and words, over whatever hypothesis thinks of."""

from __future__ import annotations

import itertools
import unicodedata
from collections.abc import Sequence

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.link.decode import sanitise
from gcs.link.frames import FrameFinder
from gcs.logs.words import harmless, printable

alike = settings(derandomize=True, deadline=None, max_examples=200)
"""The same examples every time, on slow machines, too."""


def _frame(kind: int, number: int, *, old: bool, signed: bool) -> bytes:
    messages = (
        mavlink.MAVLink_heartbeat_message(4, 3, number % 256, number, 4, 3),
        mavlink.MAVLink_param_value_message(b"SID_AXIS", float(number), 9, 1, 0),
        mavlink.MAVLink_statustext_message(4, bytes([0xFD, 0xFE]) * 10),
        mavlink.MAVLink_remote_log_data_block_message(255, 0, number, bytes([0xFD, number % 256]) * 100),
    )
    mav = mavlink.MAVLink(None, 1, 1)
    if signed and not old:
        mav.signing.secret_key, mav.signing.sign_outgoing = bytes(range(32)), True
    return bytes(messages[kind].pack(mav, force_mavlink1=old))


frames = st.builds(_frame, st.integers(0, 3), st.integers(0, 2**16), old=st.booleans(), signed=st.booleans())
noise = st.binary(max_size=40).map(lambda data: data.translate(bytes(b if b < 0xFD else 0 for b in range(256))))
"""Without a byte that begins a frame: such a byte may hold back what follows it, until that has come."""


def _in_chunks(data: bytes, cuts: Sequence[int]) -> list[bytes]:
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[begin:end] for begin, end in itertools.pairwise(edges)]


@alike
@given(st.lists(st.tuples(noise, frames), max_size=8), st.lists(st.integers(0, 4000), max_size=12))
def test_every_frame_is_found_however_the_bytes_come(pieces: list[tuple[bytes, bytes]], cuts: list[int]) -> None:
    finder = FrameFinder()
    stream = b"".join(junk + frame for junk, frame in pieces)
    found = [frame.raw for chunk in _in_chunks(stream, cuts) for frame in finder.feed(chunk)]
    assert found == [frame for _, frame in pieces]
    assert finder.bad_bytes == sum(len(junk) for junk, _ in pieces)


def _damaged(frame: bytes, at: int, by: int) -> bytes:
    """One byte of it differs, not the first."""
    at = 1 + at % (len(frame) - 1)
    return frame[:at] + bytes([frame[at] ^ by]) + frame[at + 1 :]


damage = st.one_of(st.none(), st.tuples(st.one_of(st.just(0), st.integers(0, 300)), st.integers(1, 255)))
"""Often of the length, which tells where the next begins."""


@alike
@given(st.lists(st.tuples(frames, damage), max_size=8))
def test_a_damaged_frame_costs_no_other(pieces: list[tuple[bytes, tuple[int, int] | None]]) -> None:
    sent = [frame if harm is None else _damaged(frame, *harm) for frame, harm in pieces]
    found = iter([frame.raw for frame in FrameFinder().feed(b"".join(sent) + bytes(300))])
    assert all(frame in found for frame, harm in pieces if harm is None), "in their order"


@alike
@given(st.lists(st.one_of(st.binary(max_size=60), frames), max_size=8), st.lists(st.integers(0, 4000), max_size=12))
def test_whatever_comes_each_frame_that_is_found_was_there_and_the_next_clean_ones_are_found(
    pieces: list[bytes], cuts: list[int]
) -> None:
    """What looks like the beginning of a frame holds back 280 bytes at most."""
    finder = FrameFinder()
    stream = b"".join(pieces)
    found = [frame for chunk in _in_chunks(stream, cuts) for frame in finder.feed(chunk)]
    assert all(frame.raw in stream for frame in found)
    clean = [_frame(0, number, old=False, signed=False) for number in range(20)]
    after = [frame.raw for one in clean for frame in finder.feed(one)]
    assert after[-3:] == clean[-3:]


words = st.text(
    st.one_of(
        st.characters(), st.sampled_from("\x1b\x9b\x07\r\n\t\u202e\u2066[];m0m"), st.characters(categories=["Cc", "Cf"])
    )
)


@alike
@given(words)
def test_no_word_of_a_stranger_can_order_a_terminal_about(text: str) -> None:
    safe = sanitise(text)
    assert all(unicodedata.category(c)[0] != "C" for c in safe)
    assert sanitise(safe) == safe
    shown = harmless(text)
    assert len(shown) == len(text)
    assert all(c.isprintable() or c in "\n\t" or unicodedata.category(c) == "Zs" for c in shown)
    assert harmless(shown) == shown
    assert printable(text).isprintable()

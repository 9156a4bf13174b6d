"""Who flies and who watches, in fake time."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.browser.seats import CLOSES_S, RETURNS_S, Seats


def test_the_first_flies_and_a_reload_keeps_the_seat() -> None:
    seats = Seats()
    assert [seats.join("a"), seats.join("b")] == ["flies", "watches"]
    seats.leave("a", 10.0)
    assert not seats.take("b", 10.0 + RETURNS_S / 2)
    assert seats.join("a") == "flies"
    assert not seats.free(99.0)
    assert not seats.take("b", 99.0)


def test_a_seat_that_is_left_is_taken_by_asking_only() -> None:
    seats = Seats()
    seats.join("a")
    seats.join("b")
    seats.leave("a", 10.0)
    assert seats.free(10.0 + RETURNS_S)
    assert seats.role("b") == "watches"
    assert seats.take("b", 10.0 + RETURNS_S)
    assert (seats.role("b"), seats.join("a")) == ("flies", "watches")


def test_it_closes_when_nobody_is_there_for_long_enough() -> None:
    seats = Seats()
    assert not seats.closes(1e9)  # nobody was there yet
    seats.join("a")
    seats.join("b")
    seats.leave("a", 10.0)
    assert not seats.closes(10.0 + CLOSES_S)
    seats.leave("b", 20.0)
    assert not seats.closes(20.0 + 0.9 * CLOSES_S)
    assert seats.closes(20.0 + CLOSES_S)
    seats.join("b")
    assert not seats.closes(20.0 + 2 * CLOSES_S)


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.sampled_from("jlt"), st.sampled_from("abc"), st.floats(0, 4, allow_nan=False)), max_size=40)
)
def test_never_two_fly_and_nobody_is_thrown_out(steps: list[tuple[str, str, float]]) -> None:
    seats, now = Seats(), 0.0
    for what, viewer, later in steps:
        now += later
        flew = seats.flying
        if what == "j":
            seats.join(viewer)
        elif what == "l" and viewer in seats.here:
            seats.leave(viewer, now)
        elif what == "t":
            seats.take(viewer, now)
        assert sum(seats.role(one) == "flies" for one in "abc") <= 1
        if flew in seats.here and flew is not None:
            assert seats.flying == flew


@pytest.mark.parametrize("viewer", ["b", "c"])
def test_who_is_not_there_takes_nothing(viewer: str) -> None:
    seats = Seats()
    seats.join("a")
    seats.leave("a", 0.0)
    assert not seats.take(viewer, 1e3)

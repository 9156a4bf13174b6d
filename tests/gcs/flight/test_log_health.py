"""What the link carries against what the log needs, from tallies made by hand, and of a recording in fake time."""

from __future__ import annotations

import pytest

from gcs.flight.log_health import Capacity, LogHealth, Tally, capacity

BLOCKS_A_SECOND = 300


def steady(
    carried: float, numbered: float, advance: float, *, stop_s: float = 8.0, head_blocks: int = 0
) -> list[Tally]:
    """Five tallies a second; rates in blocks a second, the log's clock starting from 100 s behind `head_blocks`."""
    return [
        Tally(
            at_s=t,
            kept=round(head_blocks + carried * t),
            numbered=round(head_blocks + numbered * t),
            read=round(head_blocks + BLOCKS_A_SECOND * advance * t),
            log_s=100.0 + advance * t,
        )
        for t in (0.2 * i for i in range(round(stop_s / 0.2) + 1))
    ]


def shown(tallies: list[Tally]) -> Capacity:
    seen = capacity(tallies)
    assert seen is not None
    return seen


def test_a_link_that_keeps_up_carries_what_is_needed() -> None:
    seen = shown(steady(300, 300, 1.0))
    assert seen.over_s == pytest.approx(5.0, abs=0.25)
    assert seen.carried == pytest.approx(60_000, rel=0.001)
    assert seen.needed == pytest.approx(60_000, rel=0.001)
    assert seen.advance == pytest.approx(1.0, abs=0.001)
    assert seen.enough


def test_blocks_that_are_numbered_and_do_not_come_show_the_need() -> None:
    """57,600 baud that drop what they cannot carry: 212 blocks came, 1,525 were open."""
    seen = shown(steady(28.5, 217, 0.0))
    assert seen.carried == pytest.approx(5_700, rel=0.05)
    assert seen.needed == pytest.approx(43_400, rel=0.05)
    assert seen.per_log_s is None
    assert not seen.enough


def test_a_link_that_delays_the_blocks_shows_the_need_by_the_logs_own_clock() -> None:
    seen = shown(steady(28.5, 28.5, 28.5 / 300))
    assert seen.carried == pytest.approx(5_700, rel=0.05)
    assert seen.per_log_s == pytest.approx(60_000, rel=0.05)
    assert seen.advance == pytest.approx(0.095, abs=0.01)
    assert not seen.enough


def test_the_formats_at_the_beginning_are_not_taken_for_the_rate() -> None:
    head = [Tally(at_s=-0.2, kept=40, numbered=40, read=40, log_s=100.0)]
    seen = shown([*head, *steady(300, 300, 1.0, stop_s=2.0, head_blocks=400)])
    assert seen.per_log_s == pytest.approx(60_000, rel=0.02)


def test_only_the_last_seconds_count() -> None:
    early = steady(300, 300, 1.0, stop_s=20.0)
    last = early[-1]
    later = [
        Tally(at_s=last.at_s + t, kept=last.kept, numbered=last.numbered, read=last.read, log_s=last.log_s)
        for t in (6.0, 20.0)
    ]
    seen = shown([*early, *later])
    assert (seen.carried, seen.numbered, seen.advance) == (0.0, 0.0, 0.0)
    assert not seen.enough


@pytest.mark.parametrize("stop_s", [0.0, 0.8])
def test_less_than_a_second_tells_nothing(stop_s: float) -> None:
    assert capacity(steady(300, 300, 1.0, stop_s=stop_s)) is None
    assert capacity([]) is None


def test_before_the_first_stamp_there_is_no_rate_of_the_clock() -> None:
    seen = shown([Tally(at_s=t, kept=round(10 * t), numbered=0, read=0, log_s=None) for t in (0.0, 1.0, 2.0)])
    assert (seen.advance, seen.per_log_s, seen.carried) == (None, None, 2000.0)


def test_the_clock_is_counted_from_its_first_stamp() -> None:
    silent = [Tally(at_s=t, kept=0, numbered=0, read=0, log_s=None) for t in (-2.0, -1.0)]
    assert shown([*silent, *steady(300, 300, 1.0, stop_s=2.0)]).advance == pytest.approx(1.0)


def test_how_far_the_log_is_behind_the_vehicle() -> None:
    health = LogHealth(
        file=0, blocks=1, open=0, silent_s=0.0, log_s=50.0, clock_s=53.5, capacity=None, reported="", problem=None
    )
    assert health.behind_s == pytest.approx(3.5)

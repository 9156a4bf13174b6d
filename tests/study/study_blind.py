"""A small blind study: every draw once in hover and some clean flights. `make blind` flies strange vehicles, too."""

from __future__ import annotations

from blind import cases, run
from judge import tables
from judged import Flight

FIRST = 20
CLEAN = 14


def study_blind_flights_in_hover() -> None:
    flown = [Flight(run(case)) for case in cases(["hover-ideal"], FIRST, 1, (), CLEAN)]
    print("\n" + tables(flown))

"""Six of the vehicles that stock default gains fly, and what better gains come to. `rate_gains.py` flies any number."""

from __future__ import annotations

from rate_gains import run, table

VEHICLES = 6


def study_better_gains_for_default_ones() -> None:
    answers = [run(seed) for seed in range(VEHICLES)]
    print("\n" + table(answers))
    assert not [one for one in answers if "failed" in one]
    assert all(one["usual"]["truth"] is not None for one in answers if "truth" in one["usual"])

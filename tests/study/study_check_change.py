"""`tippath check-change`: how often it says that an unchanged vehicle changed, and how many flights show a step of 5 %.

Both sets of a pair are drawn, without a flight in common, from flights of one unchanged vehicle that were flown, logged
and fitted; each is of a day of its own. The step is planted in the second set's values of one parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from flying import TWO_CHIRPS, flown
from scipy import stats

from gcs.campaign.check_change import Flights, checked
from gcs.campaign.estimates import estimates_of
from gcs.campaign.work import Outcome, Settings, worked_on

POOL, PAIRS = 240, 400
SIZES = (3, 5, 10, 20)
"""Flights in each set."""
STEP, STEPPED = 0.95, "M_a"
LIMIT_PERCENT = 10.0
FIRST_SEED = 45_000
MOST_FALSE = 0.02


def study_check_change(tmp_path: Path) -> None:
    pool = []
    for number in range(POOL):
        path = tmp_path / "flight.BIN"
        path.write_bytes(flown.__wrapped__("hover-ideal", TWO_CHIRPS, None, FIRST_SEED + number))
        pool.append(worked_on(path, Settings()))
    chance = np.random.default_rng(FIRST_SEED)
    fitted = [one for one in pool if one.fit is not None]
    print(f"\n{len(fitted)} flights; {PAIRS} pairs of each size")
    false = 0
    for size in SIZES:
        said = {"changed": 0, "nothing changed": 0, "cannot tell": 0}
        shown = 0
        for _ in range(PAIRS):
            drawn = [fitted[i] for i in chance.permutation(len(fitted))[: 2 * size]]
            first, second = flights(drawn[:size]), flights(drawn[size:])
            said[checked(first, second, LIMIT_PERCENT).verdict] += 1
            with_step = checked(first, flights(drawn[size:], STEP), LIMIT_PERCENT)
            shown += any(one.changed for one in with_step.differences if one.parameter == STEPPED)
        low, high = stats.binomtest(said["changed"], PAIRS).proportion_ci(method="exact")
        told = ", ".join(f"{words} {100 * count / PAIRS:.1f} %" for words, count in said.items())
        print(f"{size:3} flights each: {told} (95 % {100 * low:.1f} to {100 * high:.1f} %, were all pairs independent; "
              f"{len(fitted) // (2 * size)} are); 5 % of {STEPPED} shown in {100 * shown / PAIRS:.0f} %")  # fmt: skip
        false += said["changed"]
    assert false <= MOST_FALSE * PAIRS * len(SIZES)


def flights(outcomes: Sequence[Outcome], step: float = 1.0) -> Flights:
    """One set, each flight of a day of its own."""
    each = [
        {name: replace(one, day=day) for name, one in estimates_of(outcome).items()}
        for day, outcome in enumerate(outcomes)
    ]
    for one in each:
        one[STEPPED] = replace(one[STEPPED], value=step * one[STEPPED].value)
    fits = [outcome.fit for outcome in outcomes if outcome.fit is not None]
    return Flights(
        estimates={name: [one[name] for one in each] for name in each[0]},
        units={name: one.unit for name, one in fits[0].parameters.items()},
        structures=frozenset(fit.structure for fit in fits),
        count=len(each),
        left_out=(),
    )

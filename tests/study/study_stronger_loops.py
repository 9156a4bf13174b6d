"""Clean strange vehicles in loops of double their gain, in gusts up to the largest of the study, on smaller chirps.

    python tests/study/study_stronger_loops.py [FIRST [COUNT]]

No excitation is logged: the commands are the controller's answer to the gusts. Nothing is hidden, so that each
`missing`, and each `unexplained` without the reason `feedback`, is a false alarm.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "study")]

from intervals import share_of  # noqa: E402
from strangers.asking import ask  # noqa: E402
from strangers.flights import Plan, as_planned, planned  # noqa: E402
from strangers.hiding import NOTHING  # noqa: E402

from sysid.errors import SysidError  # noqa: E402

LONGEST_S = 60.0


class Case(NamedTuple):
    loop: float
    """Times the gains as drawn;"""
    gusts: float
    """of usual size;"""
    size: float
    """of the chirps, of the usual one."""


CASES = (Case(2, 2, 0.4), Case(2, 4, 0.4), Case(1, 4, 0.4), Case(2, 4, 1.0))


def harder(plan: Plan, case: Case) -> Plan:
    """The plan with nothing hidden and no excitation logged."""
    vehicle = replace(
        plan.vehicle,
        rate_gain=case.loop * plan.vehicle.rate_gain,
        attitude_gain=case.loop * plan.vehicle.attitude_gain,
    )
    return replace(
        plan,
        vehicle=vehicle,
        weather=replace(plan.weather, gusts=case.gusts),
        card=tuple(replace(one, amplitude=case.size * one.amplitude) for one in plan.card),
        excitation_logged=False,
        kind="none",
        names=(),
        targets=(),
    )


def study_stronger_loops(first: int = 70000, count: int = 40) -> None:
    said: dict[Case, Counter[str]] = {case: Counter() for case in CASES}
    for seed in range(first, first + count):
        plan, case = planned(seed), CASES[seed % len(CASES)]
        if plan.card[0].duration_s > LONGEST_S:
            continue
        try:
            answer = ask(as_planned(harder(plan, case), NOTHING)).first
        except (RuntimeError, SysidError) as error:  # a loop that does not hold, runs that determine nothing
            said[case][f"none: {type(error).__name__}"] += 1
            continue
        alarm = answer.verdict != "complete" and answer.reason is None
        said[case]["alarm" if alarm else f"{answer.verdict}{' by feedback' if answer.reason else ''}"] += 1
        if alarm:
            what = f"{answer.verdict} {' + '.join(answer.chain)} {answer.confidence:.2f}"
            print(f"  {seed} {plan.vehicle.size}, loop {plan.vehicle.loop}, {plan.log_hz:g} Hz: {what}", flush=True)
    for case, counts in said.items():
        flown = sum(number for word, number in counts.items() if not word.startswith("none"))
        words = ", ".join(f"{number} {word}" for word, number in sorted(counts.items()))
        print(f"loop x{case.loop:g}, gusts x{case.gusts:g}, chirps x{case.size:g}: {words}")
        if flown:
            print(f"  alarms {share_of(counts['alarm'], flown)}")


if __name__ == "__main__":
    study_stronger_loops(*map(int, sys.argv[1:3]))

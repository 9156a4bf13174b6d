"""Counts what the blind flights showed: right, wrong, unsure, by what could be seen and what harm it would have done.

python tests/study/judge.py FILE.jsonl... [--by-size]
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path

import must_show
from intervals import share_of
from judged import LARGEST_CLASS, SURE, VISIBLE_POINTS, Flight, load

DETECTABLE = (0.0, 0.05, 0.2, 1.0, math.inf)
"""Explainable residual power over noise."""
HARM = 0.10
CONFIDENCES = (0.0, 0.5, 0.7, 0.85, 0.95, 0.99, 1.0001)


def share(flights: Sequence[Flight], good: Callable[[Flight], bool]) -> str:
    """With its 95 % interval."""
    return share_of(sum(good(one) for one in flights), len(flights))


def tables(flights: Sequence[Flight]) -> str:
    """The figures of the study as text."""
    failed = [one for one in flights if one.failed]
    flights = [one for one in flights if not one.failed]
    known = [one for one in flights if one.level in ("catalogue", "below")]
    seen = [one for one in known if one.cost_points >= VISIBLE_POINTS]
    clean = [one for one in flights if one.level == "none"]
    beyond = [one for one in flights if one.level == "beyond"]
    beyond_seen = [one for one in beyond if one.cost_points >= VISIBLE_POINTS]
    two = [one for one in flights if one.level == "two"]
    lines = [f"{len(flights)} flights, {len(failed)} failed"]
    lines += [f"  failed: {one.said['case']['plant']} {one.name}: {one.failed}" for one in failed]
    lines += [
        "",
        f"nothing hidden, and said to be complete      {share(clean, lambda one: one.right)}",
        f"in the catalogue, at least {VISIBLE_POINTS:g} points of NRMSE: {len(seen)} flights",
        f"  right first answer                         {share(seen, lambda one: one.right)}",
        f"  or its declared class of at most {LARGEST_CLASS}         {share(seen, lambda one: one.right_in_class)}",
        f"  among the first two                        {share(seen, lambda one: one.in_first_two)}",
        f"    built as the catalogue writes it         "
        f"{share([one for one in seen if one.level == 'catalogue'], lambda one: one.right_in_class)}",
        f"    built below it                           "
        f"{share([one for one in seen if one.level == 'below'], lambda one: one.right_in_class)}",
        f"of any cost, right or in its class           {share(known, lambda one: one.right_in_class)}",
        f"not in the catalogue, said to be unexplained {share(beyond, lambda one: one.right)}",
        f"  at least {VISIBLE_POINTS:g} points                         {share(beyond_seen, lambda one: one.right)}",
        f"two at once, both found                      {share(two, lambda one: one.both_found)}",
    ]
    short = [x for one in seen if one.right_in_class and (x := one.short_of_best()) is not None]
    if short:
        lines.append(
            f"validation NRMSE within 1 point of the best  {sum(x <= 1 for x in short)} of {len(short)} "
            f"({100 * sum(x <= 1 for x in short) / len(short):.1f} %)"
        )
    for level, words in (("catalogue", "within 3 standard errors, built as written"), ("below", "built below it")):
        z = [x for one in seen if one.level == level and one.right_in_class for x in one.sizes_off()]
        if z:
            near = sum(abs(x) <= 3 for x in z)
            lines.append(f"sizes {words:38} {near} of {len(z)} ({100 * near / len(z):.1f} %)")
    seconds = sorted(one.said["seconds"] for one in flights)
    if seconds:
        lines.append(
            f"seconds of computing for a diagnosis         median {seconds[len(seconds) // 2]:.1f}, "
            f"nine of ten below {seconds[int(0.9 * len(seconds))]:.1f}"
        )
    lines += ["", *_confidences(flights), "", *_bins(known), "", *_confusion(flights), "", *_wrong(flights)]
    return "\n".join(lines)


def _confidences(flights: Sequence[Flight]) -> list[str]:
    """Of answers that name an effect, how many are right, by what was said of their sureness."""
    named = [one for one in flights if one.said["verdict"] == "missing" and one.level != "two"]
    lines = ["confidence of a named effect    flights    right or in its class"]
    for low, high in itertools.pairwise(CONFIDENCES):
        some = [one for one in named if low <= one.said["confidence"] < high]
        if some:
            right = sum(one.level in ("catalogue", "below") and one.right_in_class for one in some)
            lines.append(f"  {low:.2f} to {min(high, 1):.2f} {len(some):22d} {100 * right / len(some):14.1f} %")
    sure = [one for one in named if one.said["confidence"] >= SURE]
    wrong = [one for one in sure if one.level not in ("catalogue", "below") or not one.right_in_class]
    lines.append(f"  named at {SURE:g} or more and wrong: {len(wrong)} of {len(sure)} so named, {len(flights)} flights")
    return lines


def _bins(known: Sequence[Flight]) -> list[str]:
    lines = ["explainable over noise          flights    right or in its class    harm above 10 %: right"]
    for low, high in itertools.pairwise(DETECTABLE):
        some = [one for one in known if low <= max(one.explainable, 0.0) < high]
        if some:
            harmful = [one for one in some if one.harm > HARM]
            lines.append(
                f"  {low:g} to {high:g}".ljust(32)
                + f"{len(some):7d}    {share(some, lambda one: one.right_in_class):22}   "
                + share(harmful, lambda one: one.right_in_class)
            )
    return lines


def _confusion(flights: Sequence[Flight]) -> list[str]:
    """Hidden by name, and what was said of it, how often."""
    said: dict[str, Counter[str]] = defaultdict(Counter)
    cost: dict[str, list[float]] = defaultdict(list)
    for one in flights:
        if one.level == "two":
            continue
        key = f"{one.hidden[0]['answer'] or '-'} : {one.name}"
        word = one.said["effect"] or one.said["verdict"]
        said[key][word + (" (stand-in)" if one.said["stands_in"] else "")] += 1
        cost[key].append(one.cost_points)
    lines = ["answer : hidden                                     points   said"]
    for key in sorted(said):
        told = ", ".join(f"{word} {count}" for word, count in said[key].most_common())
        points = f"{min(cost[key]):.1f}-{max(cost[key]):.1f}"
        lines.append(f"  {key:48} {points:>9}   {told}")
    return lines


def _wrong(flights: Sequence[Flight]) -> list[str]:
    lines = ["wrong"]
    for one in flights:
        good = one.both_found if one.level == "two" else one.right_in_class
        if not good:
            case = one.said["case"]
            top = ", ".join(
                f"{c['effect']} {c['delta_bic']:.0f} ({100 * (c['explained_share'] or 0):.0f} %)"
                for c in one.said["candidates"][:3]
            )
            lines.append(
                f"  {case['plant']} {one.name} x{case['scale']:g} gusts {case['gusts']:g} seed {case['seed']}: "
                f"{one.said['verdict']} {'+'.join(one.said['chain'])}, {one.cost_points:.1f} points, "
                f"confidence {one.said['confidence']:.2f}; {top}"
            )
    return lines


def report(flights: Sequence[Flight], by_size: bool = False) -> str:
    """What must be shown first, then everything else."""
    answered = [one for one in flights if not one.failed]
    blocks = [must_show.must_show(answered), must_show.sureness(answered), must_show.seconds(answered)]
    if any(one.strange for one in answered):
        blocks += [must_show.by_detectability(answered), must_show.base_errors(answered), must_show.alarms(answered)]
    if by_size:
        blocks.append(must_show.of_sizes(answered))
    return "\n\n".join(["\n".join(lines) for lines in blocks if lines] + [tables(flights)])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--by-size", action="store_true", help="what of each size is seen and named, and the curves")
    args = parser.parse_args()
    print(report(load(args.files), args.by_size))
    return 0


if __name__ == "__main__":
    sys.exit(main())

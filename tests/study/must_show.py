"""The table of what the diagnosis must show, each line against its limit, with its 95 % interval; sizes are stated
against each flight's own detectability. Then how sure answers are against how often they are right, what of each size
is found, and the seconds it took.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from intervals import Bin, area_under, reliability, share_of, threshold_at
from judged import SURE, Flight

ROC_SIZES = (0.0, 0.3, 1.0, 3.0, 10.0, 100.0, math.inf)
"""Times what is just detectable."""
FALSE_ALARMS = (0.01, 0.05)
ROC_LEAST = 6
"""Flights of an entry, to be listed."""
Z_FAR = 3.0
WHOLE = "all that shows told"
"""As `--matters` of hardly anything has it."""
LONGEST_S, MOST_SAMPLES = (2.0, 5.0), 60_000
"""CPU seconds of a diagnosis, median and 95th percentile, of runs that have so many samples together."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """One thing to show."""

    words: str
    flights: Sequence[Flight]
    counts: Callable[[Flight], bool]
    """Those that are counted: right ones, or wrong ones where a most is allowed."""
    least: float | None = None
    """Share that must be counted;"""
    most: float | None = None
    """or that may be."""
    wanted: int
    """Flights that the limit is meant for."""

    @property
    def text(self) -> str:
        count, of = sum(map(self.counts, self.flights)), len(self.flights)
        limit = f">= {100 * self.least:g} %" if self.least is not None else f"<= {100 * (self.most or 0.0):g} %"
        if of == 0:
            return f"  {self.words:46} no flight; {limit}, {self.wanted} wanted"
        share = count / of
        kept = share >= self.least if self.least is not None else share <= (self.most or 0.0)
        few = "" if of >= self.wanted else f", {self.wanted} wanted"
        return f"  {self.words:46} {share_of(count, of):38} {limit:8} {'pass' if kept else 'FAIL'}{few}"


def must_show(flights: Sequence[Flight]) -> list[str]:
    """The table."""
    seen = [one for one in flights if one.visible]
    clean = [one for one in flights if one.level == "none"]
    known = [one for one in seen if one.level in ("catalogue", "below")]
    beyond = [one for one in seen if one.level == "beyond"]
    two = [one for one in seen if one.level == "two"]
    named = [one for one in flights if one.level != "two" and one.said["verdict"] == "missing"]
    sure = [one for one in named if one.said["confidence"] >= SURE]
    lines = [
        *_with_and_without("alarms, nothing hidden", clean, lambda one: one.alarm, most=(0.0, 0.01), wanted=600),
        *_with_and_without(f"  {WHOLE}", clean, lambda one: one.unweighed.alarm, most=(0.0, 0.01), wanted=600),
        *_with_and_without("right or in class", known, _right, least=(0.97, 0.92), wanted=300),
        *_with_and_without("  with what matters little", known, _spared, least=(0.97, 0.92), wanted=300),
        *_with_and_without(f"  {WHOLE}", known, lambda one: _right(one.unweighed), least=(0.97, 0.92), wanted=300),
        Line(words="not in the catalogue, and so said", flights=beyond, counts=_right, least=0.92, wanted=200),
        Line(
            words="  or complete, and mattering little",
            flights=beyond,
            counts=_spared,
            least=0.92,
            wanted=200,
        ),
        Line(
            words=f"  {WHOLE}",
            flights=beyond,
            counts=lambda one: _right(one.unweighed),
            least=0.92,
            wanted=200,
        ),
        Line(words="two at once, both found", flights=two, counts=lambda one: one.both_found, least=0.9, wanted=60),
        Line(
            words="  or complete, and both mattering little",
            flights=two,
            counts=lambda one: one.both_found or one.spared,
            least=0.9,
            wanted=60,
        ),
        Line(words="named at 0.9 or more and wrong", flights=sure, counts=_wrong, most=0.01, wanted=100),
    ]
    return ["must show (count of flights, share with its 95 % interval, limit)", *(line.text for line in lines)]


def _right(one: Flight) -> bool:
    return one.right_in_class


def _spared(one: Flight) -> bool:
    """Right, or too small to matter and said to be."""
    return _right(one) or one.spared


def _wrong(one: Flight) -> bool:
    return not one.right_in_class


def _with_and_without(
    words: str,
    flights: Sequence[Flight],
    counts: Callable[[Flight], bool],
    *,
    least: tuple[float, float] | None = None,
    most: tuple[float, float] | None = None,
    wanted: int,
) -> list[Line]:
    """Two lines: flights whose excitation is logged, and those whose is not; each has its limit."""
    return [
        Line(
            words=told,
            flights=[one for one in flights if one.excitation_logged == logged],
            counts=counts,
            least=None if least is None else least[i],
            most=None if most is None else most[i],
            wanted=wanted,
        )
        for i, (told, logged) in enumerate(((f"{words}, excitation logged", True), ("  not logged", False)))
    ]


def sureness(flights: Sequence[Flight]) -> list[str]:
    """Confidence against the share that was right, of all verdicts that claim something, and of each."""
    lines = ["reliability: mean confidence, share right (95 %), kept where inside or within 0.05"]
    claims = [one for one in flights if one.level != "two" and one.said.get("reason") != "feedback"]
    for word, some in (
        ("all", claims),
        *((verdict, [one for one in claims if one.said["verdict"] == verdict]) for verdict in VERDICTS),
    ):
        answers = [(one.said["confidence"], one.answer_right) for one in some]
        lines += [f"  {word:12} {_bin(found)}" for found in reliability(answers)]
    return lines


VERDICTS = ("complete", "missing", "unexplained")


def _bin(found: Bin) -> str:
    told = share_of(found.right, found.answers)
    return f"{found.confidence:.3f}   {told:38} {'kept' if found.kept else 'NOT KEPT'}"


def of_sizes(flights: Sequence[Flight]) -> list[str]:
    """What is seen, and what is named, by size; and the curve: hits where so many clean flights would alarm."""
    clean = [one.shown for one in flights if one.level == "none" and one.strange]
    by_entry: dict[str, list[Flight]] = defaultdict(list)
    for one in flights:
        if one.strange and one.level == "catalogue":
            by_entry[one.name].append(one)
    lines = ["by size, in times of what is just detectable:   seen / right or in class / of"]
    ranges = [f"{low:g}-{high:g}" for low, high in itertools.pairwise(ROC_SIZES)]
    lines.append(" " * 24 + "".join(word.rjust(11) for word in ranges))
    for name, some in sorted(by_entry.items()):
        if len(some) >= ROC_LEAST:
            lines.append(f"  {name:22}" + "".join(_cell(some, *size) for size in itertools.pairwise(ROC_SIZES)))
    if len(clean) < 2 or not any(len(some) >= ROC_LEAST for some in by_entry.values()):
        return lines
    lines.append(f"hits where so many of {len(clean)} clean strangers would alarm; area under the curve")
    for name, some in sorted(by_entry.items()):
        if len(some) >= ROC_LEAST:
            hits = [one.shown for one in some]
            told = [
                f"at {100 * rate:g} %: {sum(hit > threshold_at(rate, clean) for hit in hits)} of {len(hits)}"
                for rate in FALSE_ALARMS
            ]
            lines.append(f"  {name:22} {', '.join(told)}; area {area_under(hits, clean):.2f}")
    return lines


def _cell(flights: Sequence[Flight], low: float, high: float) -> str:
    some = [one for one in flights if one.detectability is not None and low <= one.detectability < high]
    if not some:
        return ".".rjust(11)
    seen, right = sum(one.said["verdict"] != "complete" for one in some), sum(one.right_in_class for one in some)
    return f"{seen}/{right}/{len(some)}".rjust(11)


def seconds(flights: Sequence[Flight]) -> list[str]:
    """Of computing: diagnoses against their limit, and the flights, which are the study's own."""
    if not flights:
        return []
    few = [one for one in flights if one.samples is not None and one.samples <= MOST_SAMPLES]
    lines = []
    for told, some in (("a diagnosis", flights), (f"those of {MOST_SAMPLES:,} samples at most", few)):
        if some:
            median, late, longest = _quantiles([one.said["seconds"] for one in some])
            words = "pass" if median <= LONGEST_S[0] and late <= LONGEST_S[1] else "FAIL"
            lines.append(
                f"CPU seconds of {told}: median {median:.1f}, 95th percentile {late:.1f}, longest {longest:.1f} "
                f"(<= {LONGEST_S[0]:g}, {LONGEST_S[1]:g}: {words}), {len(some)} flights"
            )
    if flown := [one.said["flight_seconds"] for one in flights if "flight_seconds" in one.said]:
        median, late, longest = _quantiles(flown)
        lines.append(
            f"  of a flight:              median {median:.1f}, 95th percentile {late:.1f}, longest {longest:.1f}"
        )
    return lines


def _quantiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Median, 95th percentile, largest."""
    taken = sorted(values)
    return taken[len(taken) // 2], taken[min(len(taken) - 1, int(0.95 * len(taken)))], taken[-1]


def by_detectability(flights: Sequence[Flight]) -> list[str]:
    """What is right of each kind, by how well its flight shows it; known of strangers alone."""
    lines = ["right, by times of what is just detectable (in the catalogue: or in a declared class)"]
    for words, level, good in (
        ("in the catalogue", "catalogue", _right),
        ("not in the catalogue", "beyond", _right),
        ("two at once, both", "two", lambda one: one.both_found),
    ):
        for logged, told in ((True, "excitation logged"), (False, "not logged")):
            some = [one for one in flights if one.level == level and one.excitation_logged == logged]
            cells = [
                (low, high, [one for one in some if one.detectability is not None and low <= one.detectability < high])
                for low, high in itertools.pairwise(ROC_SIZES)
            ]
            lines += [
                f"  {words:20} {told:18} {f'{low:g} to {high:g}':>10}  {share_of(sum(map(good, here)), len(here))}"
                for low, high, here in cells
                if here
            ]
    return lines


def base_errors(flights: Sequence[Flight]) -> list[str]:
    """Whether standard errors of the base's numbers are honest where nothing is hidden: their z."""
    lines = ["z of the base's numbers where nothing is hidden: mean, rms (0.9 to 1.1), beyond 3 of values"]
    for logged, told in ((True, "excitation logged"), (False, "not logged")):
        by_name: dict[str, list[float]] = defaultdict(list)
        for one in flights:
            if one.excitation_logged == logged:
                for name, z in one.base_off().items():
                    by_name[name].append(z)
        every = [z for values in by_name.values() for z in values]
        for name, values in [("all", every), *sorted(by_name.items())] if every else []:
            mean, rms = sum(values) / len(values), math.hypot(*values) / math.sqrt(len(values))
            beyond = sum(abs(z) > Z_FAR for z in values)
            lines.append(f"  {told:18} {name:6} {mean:+6.2f} {rms:6.2f}   {beyond} of {len(values)}")
    return lines if len(lines) > 1 else []


def alarms(flights: Sequence[Flight]) -> list[str]:
    """Alarms where nothing is hidden, by what differs between flights."""
    clean = [one for one in flights if one.level == "none" and one.strange]
    lines = ["alarms on clean strangers"]
    for word in ("size", "loop", "gust_kind", "excitation_logged", "chirp_noise", "loop known", "log_hz"):
        by: dict[str, Counter[bool]] = defaultdict(Counter)
        for one in clean:
            told = one.loop_known if word == "loop known" else one.said["flight"][word]
            by[str(told)][one.alarm] += 1
        counts = ", ".join(f"{key} {count[True]} of {count.total()}" for key, count in sorted(by.items()))
        lines.append(f"  {word:18} {counts}")
    return lines

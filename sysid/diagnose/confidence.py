"""How sure an answer is."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from sysid.diagnose.candidates import SIGNIFICANT, Ranked
from sysid.diagnose.evidence import gain
from sysid.diagnose.likely import Class, misfit
from sysid.diagnose.score import log_chance

LEAD_SCALE = 20.0
"""Chi squared of lead or misfit that counts as none."""
CONFIDENCE = (-1.2, 2.8, -5.0)
"""Logit of being right: constant, per unit of lead, per share left unexplained; set on flights with seeds below 100."""
SINGLE = (1.0, 1.8, -3.0)
"""The same as it is told of a single effect that is named. What it leaves counts by power, too: what explains much by
the noise's measure and little by power often only resembles what is there. Set on all 424 such names on 764 strangers
that five judgements had spent; 404 were right, 256 of 257 from a lead of 1.5 on and 148 of 167 below it."""
EXCITED, NOT_EXCITED = 0.8, -1.0
"""Logit, beside that: where an excitation is logged 276 of 283 such names were right on 1,581 later strangers that two
judgements had spent, and surer by 1.0 +- 0.4 than was said; without one 85 of 97, less sure by 1.2 +- 0.3, for what the
catalogue does not have, and a second effect, pass for one more easily there. Of either four fifths are taken, for
they are known no better."""
UNEXPLAINED_RIGHT, COMPLETE_RIGHT = 0.96, 0.99
"""How often these verdicts are right, where nothing speaks against them: of the former 29 of 29 on 2,105 strangers that
three judgements had spent, where one flight in twelve hid what the catalogue does not have, 60 of 61 of six later ones
and 60 of 61 of two after those; of 671 strangers with a logged excitation that were called complete, and showed
nothing, 670."""
COMPLETE_IN_A_LOOP_RIGHT = 0.985
"""The same where no excitation is logged: all of 1,551. Either hangs on how many flights lack nothing, here three in
five: of 43 such answers 37 were right where one flight in three did."""
NOTHING_SHOWN, DOUBTFUL = math.log(0.05), math.log(0.02)
"""Logarithms of the chance of noise: down to the first those were rightly called complete, from the second on"""
NEARLY_TOLD = 0.96
"""so many: of 149 on 2,909 strangers that four later judgements had spent 145 were."""
VETO_RIGHT = 0.93
"""Of an effect that leaves noise, how likely a veto against it is right: of 159 such answers on strangers that eleven
judgements had spent, where one flight in five to twelve hid what the catalogue does not have, 136 were; of 120 of six
later ones, told at 0.81 to 0.9 with an excitation logged, 109; and of 53 of two judgements since simple terms take
names away 51."""
HARDLY, SURPRISE = 0.7, 4.0
"""How sure it is that something is there which is just significant, and powers of e beyond, that make it so much surer:
of 16 strangers that were called unexplained within ten of that, their excitation logged, 14 were right."""
IN_A_LOOP_RIGHT = 0.5
"""At most, where the loop alone could make what is left unexplained, or the model that was found, which is unstable: of
83 such answers on strangers 43 were right, of 68 of the former on later ones 38."""
UNSTABLE_RIGHT = 0.89
"""At most, where that is unstable and an excitation is logged: 9 of 9 on the later ones were right, and 37 of 38 that
six judgements after those spent."""
UNEXPLAINED_IN_A_LOOP_RIGHT = 0.9
"""At most, where more is left unexplained than loops make and no excitation was logged: of 73 and 25, 59 and 22 were
right, and of 17 since simple terms take names away, and less is asked of one, all."""
NAMED_IN_A_LOOP = 0.42
"""At least, to name what the loop alone could make: of the strangers of five judgements whose names were below 0.55,
and which explained enough and no simple term did more, eight of ten hid what was named, and one of the others nothing
at all (0.48), of 2,131 that hid nothing. (0.55 before simple terms were asked: products of rates had 0.50.)"""
TOLD_IN_A_LOOP, SHOWN_IN_A_LOOP = 0.5, 0.1
"""And as it is told, at least, where it explains less than the second by power: of strangers that judgements had spent
three of three below hid what the catalogue does not have (products of rates as hub_gyroscopics, a load as inflow), at
0.14 to 0.26; the two that explained more (0.12, 0.13) were right at 0.20 and 0.17."""
LEFT_OF_A_FORM = 0.1
"""Share of its chi squared that an entry may leave, to be named all the same where more shows than loops make: four of
four right names of strangers that judgements had spent left 0 to 0.08 (slipstream_wing, lag_per_axis); of 32 clean
flights in fourfold gusts and chirps of less than half, in a loop of double gain, five showed more, and the entry that
took up most left 0.13 and more of it."""
SURE_OF_A_MODE, NARROW = 0.85, 0.2
"""How sure it is at least, where values of that entry are doubtful, and the damping ratio of the mode that it brings
along: loops and slow gusts make nothing narrow. Of 128 clean flights in loops of double gain and up to fourfold gusts
speed stability of doubtful values explained 31, at up to 1.00, a mode one, at 0.04, and of 1,016 strange ones one, at
0.35; of strangers that hid one three of three were right."""
COMES_OUT, IS_TOLD = (0.0, 0.5, 0.6, 0.86, 0.88, 0.965, 1.0), (0.0, 0.5, 0.8, 0.86, 0.93, 0.965, 1.0)
"""What is told of a single name, by what comes out, with an excitation logged: of 1,223 such names of four judgements
26 of 32 were right from 0.5 to 0.88, 298 of 302 from there to 0.965, tethers that the class has since then among them,
and 872 of 876 above;"""
COMES_OUT_NOT_EXCITED = (0.0, 0.5, 0.6, 0.68, 0.7, 0.95, 1.0)
IS_TOLD_NOT_EXCITED = (0.0, 0.5, 0.88, 0.89, 0.945, 0.955, 1.0)
"""and without one: of 861, 36 of 39 from 0.6 to 0.7, 289 of 291 from there to 0.95, and 517 of 520 above. Where that is
not known, as below 0.5, it is told as it comes out."""

CHAIN_NAMED = 0.5
"""At least, to name a chain of two: of 22 training strangers from 3000 to 9020, four of four below were wrong, and
right ones began at 0.90, unstable ones apart; of hundreds of chains one resembles nearly anything."""
CHAIN_TOLD = 0.4
"""And told of a chain that is named, at least: below it is likelier to be wrong. Of strangers that judgements had spent
and that no simple term explains better three chains were told between this and 0.5, and two a little less; all five
were right, and what the catalogue does not have was told at 0.01."""
CHAIN_LEAVES, BEYOND_CHANCE = 0.04, 2.5
"""Share of chi squared that a chain leaves beyond noise, from which on, where that is so many standard deviations more
than noise, it names nothing: of 49 chains that were named on the 764 strangers of SINGLE the six that left so much all
stood for what the catalogue does not have; right ones left 0.07 within 2.1 deviations, or 0.01 at 4."""
CHAIN_CONFIDENCE, CHAIN_RIGHT = (-1.9, 1.3, -5.0), 0.9
"""Logit as above, of two right halves, and its most: leads of a chain are over single effects alone, and of all that
its halves could be exchanged for only a few are fitted. Of 27 named on training strangers below 40,000 at 0.8 and more
20 were right; below a lead of 1.8 two of five, the others lazy servos; above 2.7 all but two of 18, which had a
lateness under another name."""
CHAIN_EXCITED, CHAIN_NOT_EXCITED = 0.9, 0.2
"""Logit, beside that: of 115 chains that were named with an excitation logged on the strangers of five judgements 95
were right, and of 44 without one 39; those told below 0.8 were surer by 0.7 and by 0.8 than with 0.4 and -0.4."""


def lead(winner: Ranked, alike: Collection[str], singles: Sequence[Ranked]) -> float:
    """How far the winner is ahead of the best rival, beside what it leaves itself; with what it foretells more than a
    half that was named before all of them."""
    assert winner.stepped is not None
    left = misfit(winner)
    leads = [
        gain(winner.stepped, one.stepped)[0] + one.added - winner.added
        for one in singles
        if one.stepped is not None and not set(one.effects) & {*winner.effects, *alike} and not one.implausible
    ]
    least = max(0.0, winner.foretells + min([*leads, winner.chi_squared]))
    return math.log((left + least + LEAD_SCALE) / (left + LEAD_SCALE))


def of_named(ratio: float, short: float, among: Class) -> float:
    """That the effect named is right, or one of its class where that is short enough: by its lead, and by how far it is
    `short` of explaining all."""
    return _logistic(CONFIDENCE, ratio, short) * among.right


def of_single(ratio: float, left: float, among: Class, excited: bool) -> float:
    """The same as it is told of a single effect; `left` is the share of what can be explained that it leaves by any
    measure, `excited` whether an excitation of every command is logged."""
    right = _logistic(SINGLE, ratio, left, EXCITED if excited else NOT_EXCITED) * among.right
    told = (COMES_OUT, IS_TOLD) if excited else (COMES_OUT_NOT_EXCITED, IS_TOLD_NOT_EXCITED)
    return float(np.interp(right, *told))


def of_chain(ratio: float, short: float, among: Class, excited: bool) -> float:
    """That both of two effects are right; `excited` as of a single one."""
    beside = CHAIN_EXCITED if excited else CHAIN_NOT_EXCITED
    return CHAIN_RIGHT * _logistic(CHAIN_CONFIDENCE, ratio, short, beside) * among.right


def leaves_more(winner: Ranked) -> bool:
    """Whether two effects surely leave so much that they only resemble what is there."""
    surely = misfit(winner, BEYOND_CHANCE) > 0
    left = misfit(winner)
    return surely and left > CHAIN_LEAVES * (winner.chi_squared + left)


def of_complete(chance: float, measured: bool) -> float:
    """That nothing is missing that a flight like this could show, where `chance`, a logarithm, is that noise shows as
    much, and the noise is `measured` where excitation is logged: what is not quite enough to be told is doubt."""
    told = (NOTHING_SHOWN - chance) / (NOTHING_SHOWN - DOUBTFUL)
    most = COMPLETE_RIGHT if measured else COMPLETE_IN_A_LOOP_RIGHT
    return most - (most - NEARLY_TOLD) * min(1.0, max(0.0, told))


def of_unexplained(winner: Ranked | None, chance: float, named: float) -> float:
    """That nothing in the catalogue is the answer, where `chance`, a logarithm, is that noise shows as much, and
    `named` the confidence with which the winner would be named.

    It stands on what the likeliest candidate leaves. Where that is noise, a veto stands alone against an effect that
    explains the fitted runs: mostly there is one in the catalogue.
    """
    most = UNEXPLAINED_RIGHT * _surely(chance)
    if winner is None or winner.fit is None:
        return most
    left = winner.fit.division
    rest = _surely(log_chance(left.chi_squared, left.degrees))
    if winner.implausible:
        rest = max(rest, VETO_RIGHT)
    return min(most, 1 - (1 - VETO_RIGHT) * named, most * rest + VETO_RIGHT * (1 - rest))


def _surely(chance: float) -> float:
    """That something is there, by the logarithm of the chance that noise shows as much."""
    return 1 - (1 - HARDLY) * math.exp(min(0.0, chance - SIGNIFICANT) / SURPRISE) if chance < SIGNIFICANT else 0.0


def _logistic(weights: Sequence[float], lead: float, short: float, beside: float = 0.0) -> float:
    return 1 / (1 + math.exp(-(weights[0] + beside + weights[1] * lead + weights[2] * short)))

"""Which candidate is named: the likeliest that is plausible, and of those that the runs cannot tell the most usual."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sysid.diagnose.candidates import REMAINDER, Ranked
from sysid.diagnose.evidence import gain
from sysid.diagnose.foretold import foretells_better_by
from sysid.diagnose.likely import CHANCE, SAME, doubtful, impossible, misfit, rest_otherwise
from sysid.diagnose.shares import contradicted, least

EVIDENCE, EVIDENCE_IN_A_LOOP = 6.0, 15.0
"""By which an entry must lower BIC to be an answer: less is chance among so many entries. Where no excitation is logged
more is asked: there a tilted wake took 6.6 of what a load did that swung; of 40 right names the least was 27."""
ALMOST = 0.05
"""Of what can be explained, by which a simpler entry may explain less than one of doubtful values and be named."""
TIED = 1.0
"""Chi squared below which the more usual one of two is named first,"""
APART = 4.0
"""where what they predict is no further apart than that."""
PLAINLY_MORE = 0.1
"""Of what can be explained, on fitted and on validation runs, by which play, a dead band or a limit explains more than
another that is likelier, or on validation runs alone, where both explain all of the fitted ones: where it swallows most
of the gusts, too, answers to the imposed commands are least exact. (A dead band passed for play there, and play for a
dead band; both explained 0.16 and 0.3 more. Of a thinned log, where either was fitted to every fourth command, a dead
band explained 0.74 of the validation runs, and play all.)"""
SURELY = 2.0
"""Times what chance may make of the validation runs, by which it does so there at least."""
HARDLY = 0.01
"""Of its own chi squared, by which a chain is hardly likelier than a single effect: late motors in a loop, of which
least squares left more power than their model did, were named beside a delay of 0.07 ms that added 18 to 386,000."""
SURELY_BOTH = 30.0
"""By which a chain of no doubtful values lowers BIC more, in a loop whose excitation is not logged, to be named however
little it explains more: of 57 right single names of strangers that a judgement had spent the most was 23 (a play beside
which lags scored); of six names of one half of two five had 40 to 114."""
RESTS_ALIKE, FORETELLS = 30.0, 50.0
"""Chi squared by which play may be behind a dead band, or the other way round, and be named where it foretells better
by the second. Of 19 strangers with a logged excitation the right one did by 9 to 1,384 in 17, in two of which it was
behind, by up to 18; of the others one foretold as well, one less well by 45."""
SURELY_FORETELLS = 60.0
"""Chi squared by which what acts on samples, beside an effect that is named, foretells more, to be named with it, an
excitation logged: of 246 names of one effect of strangers that judgements had spent none was two by it, and of names of
one half of two three had 137 to 638."""
INEXACT = 0.01
"""Of the chi squared of an implausible winner, by which a plausible one may be behind for the steps' sake alone: what
predicts the same ended by so much apart in slow gusts."""
AS_MUCH = 0.8
"""Of an effect's chi squared, that one which explains as much has at least."""


def winner(singles: Sequence[Ranked], pairs: Sequence[Ranked]) -> Ranked | None:
    """The likeliest effect; a chain of two only where it explains clearly more."""
    single = next(filter(_evident, singles), None)
    if single is None:
        foretelling = [one for one in singles if one.foretells >= SURELY_FORETELLS and not one.outside]
        single = max(foretelling, key=lambda one: one.foretells, default=None)
    pair = next(filter(_evident, pairs), None)
    if single is None:
        return pair
    single = _likeliest_in_practice(single, singles)
    surely = max((one for one in pairs if _foretells_surely(one, single)), key=lambda one: one.foretells, default=None)
    if surely is not None:
        instead_of_it = [one for one in pairs if _in_its_place(one, surely, single)]
        return min(instead_of_it, key=lambda one: one.delta_bic, default=surely)
    if pair is None or pair.delta_bic >= single.delta_bic:
        return single
    named = _likeliest_in_practice(pair, pairs, singles)
    instead = bool(impossible(single)) and not impossible(named)  # what only stands in is no simpler answer
    if instead or both_surely(named, single) or max(_more(pair, single), _more(named, single)) > REMAINDER:
        return named
    return single


def _evident(one: Ranked) -> bool:
    if one.fit is None:
        return False
    return one.delta_bic < -(EVIDENCE if one.fit.division.measured else EVIDENCE_IN_A_LOOP)


def both_surely(pair: Ranked, single: Ranked) -> bool:
    """Whether likelihood alone tells that a second effect is there, where powers tell little: in a loop."""
    assert pair.fit is not None
    likelier = pair.chi_squared - single.chi_squared
    if pair.fit.division.measured or pair.outside or likelier < HARDLY * pair.chi_squared:
        return False
    return single.delta_bic - pair.delta_bic > SURELY_BOTH


def _foretells_surely(pair: Ranked, single: Ranked) -> bool:
    """Whether a second effect is there by what it foretells, whatever was imposed tells of it. Where that alone has
    become the likeliest since, nothing speaks for the first: a dead band explained more than the lags that passed for
    it."""
    return pair.foretells >= SURELY_FORETELLS and not pair.outside and single.effect == pair.effects[0]


def _in_its_place(one: Ranked, foretelling: Ranked, single: Ranked) -> bool:
    """Whether a chain with another linear half than the one that was named alone is likelier than that which surely
    foretells, with no more numbers: alone a tether looked like what is plausible, or a lag like one of each axis."""
    if single.effect in one.effects or not _evident(one) or impossible(one) or one.delta_bic >= foretelling.delta_bic:
        return False
    return _measured_by_samples(one) and len(one.names) <= len(foretelling.names)


def _more(pair: Ranked, single: Ranked) -> float:
    """Share of what can be explained, by which a chain explains more on the fitted or, chance taken off, on the
    validation runs: by power, or by likelihood, where noise is small. What has doubtful values that the single effect
    has not is likelier by what it only resembles. In a loop powers tell nothing that is hardly likelier."""
    assert pair.fit is not None
    likelier = (pair.chi_squared - single.chi_squared) / max(pair.chi_squared + misfit(pair), 1e-300)
    more = [likelier] if doubtful(pair) <= set(single.outside) else [0.0]
    if pair.fit.division.measured or likelier > HARDLY:
        more.append((pair.explained_share or 0.0) - (single.explained_share or 0.0))
    if pair.validation_share is not None and single.validation_share is not None:
        more.append(pair.validation_share - single.validation_share - single.validation_slack)
    return max(more)


def _likeliest_in_practice(winner: Ranked, others: Sequence[Ranked], halves: Sequence[Ranked] = ()) -> Ranked:
    """Of candidates that the data cannot tell from the winner: a plausible one, of the most usual size; else a simpler
    one that is plainly plausible and explains as much; and one that explains what can be explained, and is not
    contradicted by the validation runs, before one that is likelier by a hair and does not, or is. `halves` of chains
    are what they explain alone."""
    assert winner.stepped is not None
    stepped = winner.stepped
    near = max(SAME, 2 * misfit(winner, CHANCE))
    alike = [
        one
        for one in others
        if one.stepped is not None and _stands_beside(one, winner, *gain(stepped, one.stepped), near)
    ]
    best = _most_usual(alike) if len(alike) > 1 else winner  # what is usual takes numbers told, which are dear
    fuller = [one for one in others if _explains_instead(one, best, near)] if not _explains(best) else []
    best = min(fuller, key=lambda one: one.delta_bic, default=best)
    more = [one for one in others if _explains_more(one, best, near)]
    best = min(more, key=lambda one: one.delta_bic, default=best)
    best = min((one for one in others if _shows_plainly_more(one, best)), key=lambda one: one.delta_bic, default=best)
    best = min((one for one in others if _foretells_at_rest(one, best)), key=lambda one: one.delta_bic, default=best)
    if not best.outside:
        return best
    simpler = [one for one in others if _explains_as_much(one, best, halves)]
    return min(simpler, key=lambda one: one.delta_bic, default=best)


def _explains(one: Ranked) -> bool:
    assert one.fit is not None
    return (one.explained_share or 0.0) >= least(one.fit.division) and not contradicted(one)


def _explains_instead(one: Ranked, winner: Ranked, near: float) -> bool:
    """Whether it explains what the winner does not, and is plausible and nearly as likely."""
    if one.stepped is None or winner.stepped is None or one.implausible or one.delta_bic >= 0 or not _explains(one):
        return False
    return gain(winner.stepped, one.stepped)[0] < near


def _explains_more(one: Ranked, winner: Ranked, near: float) -> bool:
    """Whether it explains more of what can be explained with as few parameters, where it is hardly less likely: a
    filter of 1.5 ms on the gyro for a delay of the commands, on a real autopilot's simulator. In a loop powers tell
    less than that."""
    assert winner.fit is not None
    if not winner.fit.division.measured:
        return False
    if one.stepped is None or winner.stepped is None or one.implausible or one.added > winner.added:
        return False
    if (one.explained_share or 0.0) <= (winner.explained_share or 0.0) + ALMOST:
        return False
    return set(one.outside) <= set(winner.outside) and 0 <= gain(winner.stepped, one.stepped)[0] < near


def _shows_plainly_more(one: Ranked, winner: Ranked) -> bool:
    """Whether powers tell it from the winner, where both act on samples and no feedback makes powers."""
    if one.validation_share is None or winner.validation_share is None:
        return False
    if (one.explained_share or 0.0) < min(1.0, (winner.explained_share or 0.0) + PLAINLY_MORE):
        return False
    if one.validation_share < winner.validation_share + max(PLAINLY_MORE, SURELY * winner.validation_slack):
        return False
    if one.implausible or one.delta_bic >= -EVIDENCE:
        return False
    return _measured_by_samples(one) and _measured_by_samples(winner)


def _foretells_at_rest(one: Ranked, winner: Ranked) -> bool:
    """Whether it is play for a dead band, or the other way round, which what was imposed hardly tells apart, and which
    foretells better; of plausible ones, where an excitation is logged: else all are told by what they foretell."""
    if one.fit is None or winner.fit is None or one.stepped is None or winner.stepped is None or one.implausible:
        return False
    if rest_otherwise(one, winner) is None or not winner.fit.division.measured:
        return False
    near = gain(winner.stepped, one.stepped)[0] < RESTS_ALIKE
    return near and foretells_better_by(one.fit, winner.fit) > FORETELLS


def _measured_by_samples(one: Ranked) -> bool:
    """Whether it acts on samples, on runs whose excitation is logged."""
    assert one.fit is not None
    return one.fit.division.measured and any(effect.samples is not None for effect in one.own)


def _explains_as_much(one: Ranked, winner: Ranked, halves: Sequence[Ranked]) -> bool:
    """Whether it does, or no evidence tells that it does not, with fewer parameters and none that is not plausible:
    physics weighs more than a hair. Of two, beside a half that both have: with the larger anything explains nearly as
    much."""
    if one.fit is None or len(one.names) >= len(winner.names) or one.explained_share is None:
        return False
    if not set(one.outside) < set(winner.outside) or one.delta_bic >= 0:
        return False
    common = _explained_anyway(one, winner, halves)
    anyway = common or 0.0
    if one.chi_squared - anyway < AS_MUCH * (winner.chi_squared - anyway):
        return False
    if not contradicted(one) and one.delta_bic < winner.delta_bic + EVIDENCE:
        return True
    if common is None:
        return False
    shares = [(one.explained_share, winner.explained_share), (one.validation_share, winner.validation_share)]
    return all(his is None or (own is not None and own >= his - ALMOST) for own, his in shares)


def _explained_anyway(one: Ranked, winner: Ranked, halves: Sequence[Ranked]) -> float | None:
    """Chi squared of what a chain and another have in common; None where that is not known."""
    if len(winner.effects) == 1:
        return 0.0
    common = set(one.effects) & set(winner.effects)
    return next((half.chi_squared for half in halves if {half.effect} == common and half.fit is not None), None)


def _stands_beside(one: Ranked, winner: Ranked, behind: float, apart: float, near: float) -> bool:
    """Whether it may be named instead: as likely with as many parameters, or nearly so where only it is plausible."""
    if winner.implausible and not one.implausible:
        return behind < max(near, INEXACT * winner.chi_squared)
    return abs(behind) < TIED and apart < APART and one.added == winner.added


def _most_usual(alike: Sequence[Ranked]) -> Ranked:
    """Of the plausible ones that are as likely as the likeliest of them the one of the most usual size: how far behind
    an implausible one they may be tells nothing of which of them it is."""
    plausible = [one for one in alike if not one.implausible] or alike
    likeliest = min(plausible, key=lambda one: one.delta_bic)
    assert likeliest.stepped is not None
    tied = [one for one in plausible if one.stepped is not None and gain(likeliest.stepped, one.stepped)[0] < SAME]
    return min(tied, key=_unusual)


def _unusual(one: Ranked) -> tuple[bool, float]:
    """Implausible ones last; then how far, in powers of e, the sizes are from those met in practice."""
    assert one.fit is not None
    model = one.fit.model
    usual = {parameter.name: parameter.typical for parameter in model.structure.parameters}
    off = [
        abs(math.log(max(abs(value), 1e-300) / abs(usual[name])))
        for name, value in one.values.items()
        if usual.get(name) and math.isfinite(value)
    ]
    return bool(one.implausible), max(off, default=0.0)


def larger_first(winner: Ranked, singles: Sequence[Ranked]) -> tuple[str, ...]:
    """By what each explains alone; by its score, where it could not be fitted alone."""
    alone = {one.effect: one.chi_squared for one in singles if one.fit is not None}
    scored = {one.effect: one.score.chi_squared for one in singles if one.score is not None}
    return tuple(sorted(winner.effects, key=lambda name: -alone.get(name, scored.get(name, 0.0))))

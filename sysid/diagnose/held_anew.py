"""How long a loop that nobody told of held commands, asked once more beside what explains the runs best.

A parent that lacks something answers early or late, and the hold that it shows is wrong by as much: 1 ms where a loop
of 250 Hz had held 4. By that an effect that would explain all explains a quarter, and all of it with a delay beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from sysid.diagnose.candidates import Ranked, Reference
from sysid.diagnose.halves import half
from sysid.fit.clocks import Hold, hold_beside, untold_sample_s
from sysid.model.structure import Model

FEW, FEW_PAIRS = 3, 2
"""How many of the likeliest are asked, and of how many pairs each half."""


def held_anew(
    singles: Sequence[Ranked], pairs: Sequence[Ranked], reference: Reference, fixed: Mapping[str, float]
) -> tuple[Hold, tuple[str, ...]] | None:
    """The hold that the first of the likeliest shows to be another than the runs are taken by, and its effects; None
    where the log tells its loop, or none does. Candidates and pairs best first."""
    runs = reference.parent.dataset
    if untold_sample_s(runs) is None:
        return None
    for effects, model in _likeliest(singles, pairs, reference):
        found = hold_beside(model, runs, fixed)
        if found is not None:
            return found, effects
    return None


def _likeliest(
    singles: Sequence[Ranked], pairs: Sequence[Ranked], reference: Reference
) -> Iterator[tuple[tuple[str, ...], Model]]:
    """Models of the halves of pairs that are ahead of all single effects, then of these."""
    fitted = [one for one in singles if one.fit is not None][:FEW]
    best = min((one.delta_bic for one in fitted), default=0.0)
    for pair in [one for one in pairs if one.fit is not None and one.delta_bic < best][:FEW_PAIRS]:
        for effect in pair.effects:
            alone = half(pair, effect, reference)
            if alone is not None:
                yield (effect,), alone
    for one in fitted:
        assert one.fit is not None
        yield one.effects, one.fit.model

"""Which physical effect is missing: every testable entry of the catalogue asked, the serious refitted, one verdict.

`complete`: what the model leaves is noise, as far as these runs can tell. `missing`: one effect, or a chain of two,
explains at least EXPLAINED of what can be explained, on fitted and validation runs, at plausible values. `unexplained`:
there is something to explain, and nothing known does it; an effect that does so at values that physics does not allow
stands in for something else.

Ranking is by how much more likely an effect makes the data under the noise's own spectrum (`sysid.diagnose.evidence`),
less a penalty for its parameters. The thresholds below were set on flights with known answers and are frozen (`make
study`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache

from sysid.data.dataset import dataset
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.diagnose.candidates import (
    QUESTIONS,
    SIGNIFICANT,
    Progress,
    chance_of_noise,
    rank,
    ranked,
    refit_serious,
    score_effects,
    silent,
)
from sysid.diagnose.chains import chains_of_two
from sysid.diagnose.evidence import Candidate, candidate, instrumental_step
from sysid.diagnose.term_search import Selection, search, select
from sysid.diagnose.verdict import Diagnosis, verdict_on
from sysid.diagnose.whitening import noise_whitening
from sysid.fit.estimate import estimate
from sysid.model.effect import Effect
from sysid.model.structure import Model, Structure


def diagnose(
    structure: Structure,
    records: Sequence[Record],
    validation: Sequence[Record] = (),
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    *,
    effects: Sequence[Effect] = (),
    fixed: Mapping[str, float] | None = None,
    begin: Model | None = None,
    say: Progress = silent,
    chains: bool = True,
) -> Diagnosis:
    """Diagnose a structure on runs. `effects` are a user's own, asked beside the catalogue's; `chains` of two too.

    `begin` is where the structure was fitted to, if it was. Raises FitError where the runs do not identify the
    structure itself.
    """
    on = dataset(records, band_hz)
    judging = dataset(validation, band_hz, on) if validation else None
    held = dict(fixed or {})
    if begin is not None:
        begin = Model(structure, begin.values) if begin.structure.names == structure.names else None
    found = estimate(structure, on.viewed(structure.inputs), begin, held)
    parent = candidate(found, tuple(held), on)
    whitening = noise_whitening(parent.model, on.stacks, parent.division)
    stepped = instrumental_step(parent, whitening)
    say("the structure as it is")

    asked = score_effects(parent, stepped, whitening, effects, say)
    chance = chance_of_noise(parent.division, [one.score for one in asked if one.score is not None])
    if chance >= SIGNIFICANT:
        simple = search(parent, stepped, whitening, most=1)
        chance = min([chance, *(one.log_p + math.log(QUESTIONS) for one in simple)])
        say("simple terms")
    refitted = refit_serious(asked, parent, effects, say) if chance < SIGNIFICANT else asked
    fits = [one for one in refitted if one.fit is not None]
    best_fit = min([parent, *(one.fit for one in fits if one.fit is not None)], key=lambda one: one.error_share)
    whitening = noise_whitening(best_fit.model, on.stacks, best_fit.division)
    stepped = instrumental_step(parent, whitening)
    refitted = [ranked(one, parent, stepped, whitening, judging) for one in refitted]
    refitted.sort(key=rank)

    @cache
    def beside(one: Candidate) -> Selection:
        return select(one, whitening)

    pairs = []
    if chains and chance < SIGNIFICANT:
        pairs = chains_of_two(
            refitted, parent, stepped, whitening=whitening, users=effects, judging=judging, simple=beside, say=say
        )
    return verdict_on(
        parent, stepped, whitening, singles=refitted, pairs=pairs, chance=chance, judging=judging, simple=beside
    )

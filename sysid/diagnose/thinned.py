"""A log slower than a loop that it does not tell of: how long commands were held is found before effects are asked.

Taken as held from sample to sample, commands act up to half a sample early, which many effects explain. So that much
is no evidence: the hold follows from the runs themselves, and effects are asked for what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from sysid.data.dataset import Dataset
from sysid.diagnose.evidence import Candidate
from sysid.fit.check_kinds import CommandsThinned
from sysid.fit.clocks import loop_held_s, thinned_loop
from sysid.model.structure import Model

TOLD_BY = "by these runs"
Fitted = Callable[[Dataset, Model], Candidate]


def as_held(
    parent: Candidate, fixed: Mapping[str, float], fitted: Fitted
) -> tuple[Candidate, CommandsThinned | None, float | None]:
    """The parent on its runs as the loop held their commands, fitted anew (`fitted`); what thinned them; and how long
    each was held, s. The parent itself, and None, where they tell of no other loop."""
    thinned = thinned_loop(parent.model, parent.dataset, fixed)
    if thinned is None:
        return parent, None, None
    what, loop_s = thinned
    nearly = fitted(held(parent.dataset, loop_s), parent.model)
    loop_s = loop_held_s(nearly.model, nearly.dataset, fixed) or loop_s
    return fitted(held(parent.dataset, loop_s), nearly.model), what, loop_s


def held(runs: Dataset, loop_s: float) -> Dataset:
    """The runs, with commands held so long, s."""
    records = tuple(replace(one, loop_dt_s=loop_s, loop_told_by=TOLD_BY) for one in runs.records)
    return Dataset(records=records, band_hz=runs.band_hz, like=runs.like, outputs=runs.outputs)

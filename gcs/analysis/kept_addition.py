"""An effect that was added in an earlier session: what its fit's file tells of its placebo and its signs."""

from __future__ import annotations

from pathlib import Path

from gcs import documents
from gcs.analysis.addition import Addition, Placebo, Sign
from gcs.errors import TippathError
from sysid.data.dataset import Dataset
from sysid.fit.checks import EIGENFREQUENCY, fit_checks
from sysid.fit.result import Fit


class _Sign(documents.Open, frozen=True, kw_only=True):
    key: str
    name: str
    text: str
    seen: bool | None


class _Placebo(documents.Open, frozen=True, kw_only=True):
    effect: str
    nrmse_percent: dict[str, float]
    validation_nrmse_percent: dict[str, float] | None = None


class _Added(documents.Open, frozen=True, kw_only=True):
    noise_floor_percent: dict[str, float]
    signs: tuple[_Sign, ...]
    placebo: _Placebo | None = None


def kept_addition(path: Path, before: Fit, after: Fit, runs: Dataset) -> Addition | None:
    """The addition that made a kept fit of the one before; None where its file does not tell, or not of these two."""
    new = [name for name in after.model.structure.effects if name not in before.model.structure.effects]
    if len(new) != 1:
        return None
    try:
        told = documents.read_json(path, _Added, what="a fit that was added to")
    except TippathError:
        return None
    outputs = after.nrmse_percent.keys()
    wrong = told.placebo
    numbers = [told.noise_floor_percent, *([] if wrong is None else [wrong.nrmse_percent])]
    keys = {one.key for one in told.signs}
    if any(one.keys() != outputs for one in numbers) or keys != {"validation", "agreement", "plausible"}:
        return None
    return Addition(
        named=new[0],
        before=before,
        after=after,
        runs=runs,
        noise_floor_percent=told.noise_floor_percent,
        checks=fit_checks(after.model, runs, after.band_hz, after.fixed, after.weights)[0][:EIGENFREQUENCY],
        placebo=None
        if wrong is None
        else Placebo(tuple(wrong.effect.split("+")), wrong.nrmse_percent, wrong.validation_nrmse_percent),
        signs=tuple(Sign(one.key, one.name, one.seen, one.text) for one in told.signs),
    )

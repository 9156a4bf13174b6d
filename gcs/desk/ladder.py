"""Fits as they are shown: side by side, as rungs; and what may be the next rung."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gcs.analysis.fits import Identification
from gcs.analysis.ladder import added, rung_names
from gcs.analysis.text.fit import another_band, checks_text, modes_table, nrmse_table, parameter_table
from gcs.desk.state import Fitted, Rung
from gcs.errors import UsageError
from sysid.fit.result import Fit
from sysid.model.effect import Effect, EffectError, find


def effect_to_add(fit: Fit, word: str, name: str = "the fit") -> Effect:
    """The effect that a word names: a catalogue id, or the path of a user's file, whose code runs.

    Raises UsageError for an unknown id and for what the fit has already, EffectError for a file that is no effect.
    """
    try:
        effect = find(word)
    except EffectError as error:
        if word.endswith(".py"):
            raise
        raise UsageError(str(error)) from error
    present = {one.id for one in fit.model.structure.composed}
    if effect.id in present or effect.id in fit.model.structure.base_.contains:
        raise UsageError(f"{name} has {word} already")
    return effect


def tables(found: Identification, kept: tuple[Path, Path] | None = None) -> Fitted:
    """TPP, CD and the reduced CD in the paper's tables; `kept` are the files of TPP and CD."""
    # The checks before the long table of parameters: they say whether to read it.
    checks = checks_text(found.checks)
    shown = (*another_band(found.tpp), nrmse_table(found), modes_table(found), checks, parameter_table(found))
    text = "\n\n".join(shown)
    return Fitted(
        found=found,
        tables=text,
        runs=tuple(one.id for one in found.tpp.records),
        validation=tuple(one.id for one in found.tpp.validation),
        warnings=tuple(dict.fromkeys((*found.tpp.warnings, *found.cd.warnings))),
        tpp_path=None if kept is None else kept[0],
        cd_path=None if kept is None else kept[1],
        commands=(),
    )


def named(ladder: Sequence[Rung]) -> tuple[Rung, ...]:
    """The rungs with their names, and what each added."""
    if not ladder:
        return ()
    base = ladder[-1].fit.model.structure.base_
    effects = [one.fit.model.structure.effects for one in ladder]
    names = rung_names(base, effects)
    brought = [None, *added(base, effects)]
    return tuple(
        replace(one, name=name, effect=one.effect or its_own)
        for one, name, its_own in zip(ladder, names, brought, strict=True)
    )


def full_name(fit: Fit) -> str:
    """`TPP + servo_lag`."""
    return fit.model.structure.title

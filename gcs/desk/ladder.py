"""Fits as they are shown: side by side, as rungs; and what may be the next rung."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gcs.analysis.diagnosis import rung_names
from gcs.analysis.fits import Identification, checks_text, modes_table, nrmse_table, parameter_table
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
    if effect.id in present or (effect.id == "flapping" and fit.model.structure.base == "tpp"):
        raise UsageError(f"{name} has {word} already")
    return effect


def tables(found: Identification, kept: tuple[Path, Path] | None = None) -> Fitted:
    """TPP, CD and the reduced CD in the paper's tables; `kept` are the files of TPP and CD."""
    # The checks before the long table of parameters: they say whether to read it.
    text = "\n\n".join((nrmse_table(found), modes_table(found), checks_text(found.checks), parameter_table(found)))
    return Fitted(
        found,
        text,
        tuple(one.id for one in found.tpp.records),
        tuple(one.id for one in found.tpp.validation),
        tuple(dict.fromkeys((*found.tpp.warnings, *found.cd.warnings))),
        None if kept is None else kept[0],
        None if kept is None else kept[1],
        (),
    )


def named(ladder: Sequence[Rung]) -> tuple[Rung, ...]:
    """The rungs with their names, and what each added."""
    if not ladder:
        return ()
    structures = [one.fit.model.structure for one in ladder]
    names = rung_names(structures[-1].base, [one.effects for one in structures])
    found = [replace(one, name=name) for one, name in zip(ladder, names, strict=True)]
    return tuple(
        one if k == 0 or one.effect is not None else replace(one, effect=one.name.removeprefix("+ "))
        for k, one in enumerate(found)
    )


def full_name(fit: Fit) -> str:
    """`TPP + servo_lag`."""
    structure = fit.model.structure
    return " + ".join([structure.base.upper(), *(Path(one).name for one in structure.effects)])

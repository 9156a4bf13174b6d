"""A structure, and a model of it, as they are kept in JSON; a user's own files are code and come by their paths."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sysid.document import Open, converted
from sysid.errors import SysidError
from sysid.fit.document import StructureDocument
from sysid.model.base import Base, load_base
from sysid.model.compose import compose
from sysid.model.effect import Effect, EffectError, load
from sysid.model.structure import Model, Structure


class ResultError(SysidError):
    """A result file that cannot be read; the message says why."""


class ModelDocument(Open, frozen=True, kw_only=True):
    """What a saved model must hold."""

    structure: StructureDocument
    parameters: dict[str, float]


def model_json(model: Model, relative_to: Path) -> dict[str, Any]:
    """`structure` as a fit keeps it, and `parameters` by name."""
    names = model.structure.names
    return {
        "structure": structure_json(model.structure, relative_to),
        "parameters": {name: float(value) for name, value in zip(names, model.values, strict=True)},
    }


def model_of(document: Any, directory: Path, named: Sequence[str] = ()) -> Model:
    """Read what `model_json` wrote. Raises ResultError."""
    try:
        saved = converted(document, ModelDocument)
    except ValueError as error:
        raise ResultError(f"not a saved model ({error})") from error
    return saved_model(saved, directory, named)


def saved_model(saved: ModelDocument, directory: Path, named: Sequence[str] = ()) -> Model:
    """The model of a document that was read already. Raises ResultError."""
    try:
        structure = structure_of(saved.structure, directory, named)
        return Model(structure, structure.vector(saved.parameters))
    except EffectError as error:
        raise ResultError(f"its structure cannot be composed: {error}") from error
    except KeyError as error:
        raise ResultError(f"a saved model lacks its parameter {error}") from error
    except ValueError as error:
        raise ResultError(f"not a saved model ({error})") from error


def structure_json(structure: Structure, relative_to: Path) -> dict[str, Any]:
    """As a fit keeps it; paths relative to the directory it will stand in."""
    return {
        "base": relative(structure.base, relative_to) if structure.base_.path else structure.base,
        "effects": effect_names(structure.effects, relative_to),
        "user_effects": {
            relative(one.path, relative_to): one.sha256 for one in structure.composed if one.path is not None
        },
        **_own_base_json(structure.base_, relative_to),
        **({} if structure.outputs == structure.base_.outputs else {"outputs": list(structure.outputs)}),
        "channels": list(structure.inputs),
        "constants": dict(structure.constants),
    }


def structure_of(saved: StructureDocument, directory: Path, named: Sequence[str]) -> Structure:
    """Read what `structure_json` wrote. Raises ResultError, EffectError."""
    return compose(
        _base(saved, directory, named),
        _effects(saved, directory, named),
        [*saved.channels],
        saved.constants,
        outputs=saved.outputs,
    )


def _base(saved: StructureDocument, directory: Path, named: Sequence[str]) -> str | Base:
    """The base of a saved structure; a user's file only where it is named and unchanged."""
    sha256 = saved.user_base.get(saved.base)
    return saved.base if sha256 is None else load_base(_named_file(directory / saved.base, "base", named), sha256)


def _effects(saved: StructureDocument, directory: Path, named: Sequence[str]) -> list[str | Effect]:
    """The effects of a saved structure; users' files only where they are named and unchanged."""
    hashes = saved.user_effects
    return [
        load(_named_file(directory / word, "effect", named), hashes[word]) if word in hashes else word
        for word in saved.effects
    ]


def _named_file(path: Path, kind: str, named: Sequence[str]) -> Path:
    """The path, where it is among those that may run. Raises ResultError."""
    if path.resolve() not in {Path(word).resolve() for word in named}:
        raise ResultError(f"it uses the {kind} file {path}, which is code: name it with --with {path} to run it")
    return path


def _own_base_json(base: Base, directory: Path) -> dict[str, Any]:
    """A user's base by its path, with its file's hash; nothing for one of the folder."""
    return {} if base.path is None else {"user_base": {relative(base.path, directory): base.sha256}}


def effect_names(effects: Sequence[str], directory: Path) -> list[str]:
    """Ids; a user's files by their path from the directory."""
    return [relative(one, directory) if one.endswith(".py") else one for one in effects]


def relative(path: str, directory: Path) -> str:
    if not path:
        return ""
    try:
        return Path(os.path.relpath(Path(path).resolve(), directory.resolve())).as_posix()
    except ValueError:  # another drive
        return Path(path).resolve().as_posix()

"""A question that was answered is not worked out again: the same model, runs and effects give the answer they gave.

For tests of what is done with an answer: its words, its documents, its pictures, the next command. The product works
out every question that is new, from the words of the command to the answer; only of a second one the answer is taken
from the first. What the commands read of a log is kept beside it, as it is for users.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gcs.analysis.addition
import gcs.analysis.diagnosis
import gcs.analysis.pages.diagnosis
import gcs.analysis.pages.report
import gcs.desk.calculations
import gcs.logs.reading
import sysid.compare.compare
from gcs.logs.cache import Content, digest_of
from gcs.logs.reading import Reading
from sysid.data.dataset import Dataset
from sysid.data.record import Record
from sysid.fit.result import Fit
from sysid.model.effect import Effect, catalogue
from sysid.model.structure import Model

ASKING = {
    "diagnose_fit": (gcs.analysis.diagnosis, gcs.analysis.pages.report, gcs.desk.calculations),
    "add_effect": (gcs.analysis.addition, gcs.desk.calculations),
    "compare": (
        *(sysid.compare.compare, gcs.analysis.diagnosis, gcs.analysis.pages.diagnosis, gcs.analysis.pages.report),
        gcs.desk.calculations,
    ),
}
"""Function -> the modules that call it by that name."""


def asked(what: Any) -> Any:
    """All that an answer depends on, as something to look it up by."""
    match what:
        case Fit():
            rest = [repr(getattr(what, one.name)) for one in fields(what) if one.name not in ("model", "covariance")]
            return asked(what.model), what.covariance.tobytes(), *rest
        case Model():
            structure = what.structure
            return structure.base, asked(structure.composed), structure.inputs, structure.outputs, what.values.tobytes()
        case Dataset():
            return asked(what.records), what.band_hz, what.outputs, asked(what.like)
        case Record():
            samples = hashlib.sha256()
            for name in sorted(what.channels):
                samples.update(name.encode() + np.ascontiguousarray(what.channels[name]).tobytes())
            flown = what.maneuver, what.axis, what.airframe
            return what.id, what.path, what.sha256, *flown, what.notes, samples.digest()
        case Effect():
            return what.id, what.path, what.sha256
        case list() | tuple():
            return tuple(map(asked, what))
    return what


class Once:
    """The function, called once for every question."""

    def __init__(self, work_out: Callable[..., Any]) -> None:
        self.work_out = work_out
        self.signature = inspect.signature(work_out)
        self.answers: dict[Any, Any] = {}

    def question(self, about: tuple[Any, ...], how: dict[str, Any]) -> Any:
        """All that it depends on: what is left out is asked with its default."""
        bound = self.signature.bind(*about, **how)
        bound.apply_defaults()
        depends = tuple((name, asked(value)) for name, value in bound.arguments.items() if name != "say")
        return tuple(catalogue()), depends

    def knows(self, *about: Any, **how: Any) -> bool:
        return self.question(about, how) in self.answers

    def __call__(self, *about: Any, **how: Any) -> Any:
        key = self.question(about, how)
        if key not in self.answers:
            self.answers[key] = self.work_out(*about, **how)
        return self.answers[key]


def with_suggestion(diagnose_fit: Once) -> Callable[..., Any]:
    """Diagnoses of which a suggestion is a part, so that one serves with it and, once it is there, without."""

    def diagnosed(*about: Any, suggesting: bool = False, **how: Any) -> Any:
        if not suggesting and not diagnose_fit.knows(*about, suggesting=True, **how):
            return diagnose_fit(*about, suggesting=False, **how)
        answer = diagnose_fit(*about, suggesting=True, **how)
        return answer if suggesting else replace(answer, suggestion=None)

    return diagnosed


@contextlib.contextmanager
def answers_kept(functions: Sequence[str] = tuple(ASKING)) -> Iterator[None]:
    """While this lasts, these functions work out a question once, and logs are read once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TIPPATH_CACHE", "on")
        for name in functions:
            kept = Once(getattr(ASKING[name][0], name))
            for module in ASKING[name]:
                patch.setattr(module, name, with_suggestion(kept) if name == "diagnose_fit" else kept)
        yield


@contextlib.contextmanager
def logs_kept() -> Iterator[None]:
    """While this lasts, the same bytes at the same place are read once for every way of reading them."""
    contents: dict[Any, Content] = {}
    parse = gcs.logs.reading._parse

    def parsed(path: Path, how: Reading) -> Content:
        if not path.is_file():
            return parse(path, how)
        beside = tuple((other, digest_of(other)) for other in how.beside.get(path, ()) if other.is_file())
        key = path, digest_of(path), beside, repr(replace(how, beside={}))
        if key not in contents:
            contents[key] = parse(path, how)
        return contents[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gcs.logs.reading, "_parse", parsed)
        yield

"""How a fit stands: what its diagnosis said of it, and the models that this leaves open.

A diagnosis is kept beside its fit, under the fit's name or another one, and knows it by a digest of its numbers and
runs. Gains are judged on every model that it leaves open: what is missing, and what could not be told from that.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from gcs.analysis.diagnosis import FitDiagnosis
from sysid.control.judgement import Role
from sysid.diagnose.verdict import FORMAT
from sysid.document import Open, converted, parsed
from sysid.errors import SysidError
from sysid.fit.result import Fit, finite
from sysid.fit.saved_model import model_json, model_of
from sysid.model.structure import Model

MOST_FILES = 500
MOST_BYTES = 4 << 20
State = Literal["not asked", "complete", "missing", "unexplained"]


@dataclass(frozen=True, kw_only=True)
class Standing:
    """What is known of what a fit lacks."""

    state: State = "not asked"
    effects: tuple[str, ...] = ()
    """What is missing."""
    confidence: float | None = None
    models: tuple[tuple[Role, Model], ...] = ()
    """The fit completed, and what could not be told from that."""
    not_modelled: tuple[str, ...] = ()
    """Effects that are as likely and of which there is no model here to judge by."""

    @property
    def complete(self) -> bool:
        return self.state == "complete"

    def to_json(self) -> dict[str, Any]:
        """`state`, `effects`, `confidence`, `not_modelled`."""
        return {
            "state": self.state,
            "effects": list(self.effects),
            "confidence": self.confidence,
            "not_modelled": list(self.not_modelled),
        }


NOT_ASKED = Standing()


class _Model(Open, frozen=True, kw_only=True):
    role: str
    effects: tuple[str, ...]
    model: dict[str, Any] | None


class _Saved(Open, frozen=True, kw_only=True):
    """What is read of a kept diagnosis."""

    verdict: str
    chain: tuple[str, ...] = ()
    confidence: float | None = None
    models: tuple[_Model, ...] = ()


def digest(fit: Fit) -> str:
    """SHA-256 of a fit's structure, numbers and runs, wherever its files stand."""
    structure = fit.model.structure
    about = {
        "base": structure.base_.sha256 or structure.base,
        "effects": [one.sha256 or one.id for one in structure.composed],
        "outputs": structure.outputs,
        "parameters": [float(value).hex() for value in fit.model.values],
        "band_hz": fit.band_hz,
        "runs": [(one.id, one.sha256, one.samples) for one in (*fit.records, *fit.validation)],
    }
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()


def open_models(found: FitDiagnosis, folder: Path) -> list[dict[str, Any]]:
    """What a diagnosis leaves open, as a folder keeps it: `role`, `effects`, `model` (null where none was made)."""
    last = found.last
    if last.verdict != "missing":
        return []
    singles = {one.effect: one for one in last.candidates}
    each = [("missing", last.chain, last.winner)]
    each += [("not told apart", (name,), singles.get(name)) for name in last.not_told]
    pairs = {one.effects: one for one in last.pairs}
    each += [("not told apart", pair, pairs.get(pair)) for pair in last.indistinguishable_pairs]
    return [
        {
            "role": role,
            "effects": list(effects),
            "model": None if one is None or one.fit is None else model_json(one.fit.model, folder),
        }
        for role, effects, one in each
    ]


def beside(folder: Path, fit: Fit, named: Sequence[str] = ()) -> Standing:
    """How a fit stands by the newest diagnosis of it in a folder; `named`: files of the user's, whose code may run."""
    document = diagnosis_beside(folder, fit)
    return NOT_ASKED if document is None else standing_of(document, folder, named)


def diagnosis_beside(folder: Path, fit: Fit) -> dict[str, Any] | None:
    """The newest `tippath.diagnosis/1` document of a fit in a folder; None where there is none."""
    own, found = digest(fit), []
    try:
        for path in sorted(folder.glob("*.json"))[:MOST_FILES]:
            if path.stat().st_size <= MOST_BYTES:
                document = _document(path)
                if document is not None and document.get("fit_sha256") == own:
                    found.append((path.stat().st_mtime_ns, document))
    except OSError:
        return None
    newest = max(found, key=lambda one: one[0], default=None)
    return None if newest is None else newest[1]


def standing_of(document: Any, folder: Path, named: Sequence[str] = ()) -> Standing:
    """By a `tippath.diagnosis/1` document that is kept in a folder; what cannot be read of it was not asked."""
    try:
        saved = converted(document, _Saved)
    except ValueError:
        return NOT_ASKED
    if saved.verdict not in get_args(State):
        return NOT_ASKED
    models: list[tuple[Role, Model]] = []
    lost: list[str] = []
    for one in saved.models:
        try:
            role: Role = "missing" if one.role == "missing" else "not told apart"
            models.append((role, model_of(one.model, folder, named)))
        except SysidError:
            lost.append(" + ".join(one.effects))
    return Standing(
        state=saved.verdict,  # type: ignore[arg-type]
        effects=saved.chain if saved.verdict == "missing" else (),
        confidence=None if saved.confidence is None else finite(saved.confidence),
        models=tuple(models),
        not_modelled=tuple(lost),
    )


def _document(path: Path) -> dict[str, Any] | None:
    try:
        document = parsed(path)
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and document.get("format") == FORMAT else None

"""JSON documents that hold sentences beside their numbers: a comparison's and a diagnosis's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gcs.analysis.answer import shown_document
from gcs.analysis.diagnosis import ClocksDiffer, FitDiagnosis
from gcs.analysis.fits import assess
from gcs.analysis.standing import digest, open_models
from gcs.analysis.text.beyond import beyond_sentences
from gcs.analysis.text.explanation import explanation_document
from gcs.analysis.text.findings import finding_text, suspicion_text
from gcs.analysis.text.fit import judgement_document
from gcs.analysis.text.hidden import hidden_sentences
from gcs.analysis.text.maneuvers import how_text, maneuver_text, why_text
from gcs.analysis.text.remarks import remark_text
from sysid.compare.finding_kinds import Suspicion
from sysid.compare.values import Comparison
from sysid.data.record import Record
from sysid.diagnose.next_maneuver import NextManeuver
from sysid.diagnose.proposals import FitRuns
from sysid.fit.result import finite


def comparison_document(compared: Comparison, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """The `tippath.compare/1` document; `warnings` stand against all of it."""
    shares, floor, ratio = compared.noise_share, compared.noise_floor_percent, compared.quiet_ratio
    return {
        "format": "tippath.compare/1",
        "nrmse_percent": _numbers(compared.nrmse_percent),
        "bands": [band.to_json() for band in compared.bands],
        "windows": [asdict(window) for window in compared.windows],
        "noise_share": dict.fromkeys(compared.outputs) if shares is None else _numbers(shares),
        "noise_share_is": compared.noise_share_is,
        "noise_from": compared.noise_from,
        "noise_floor_percent": None if floor is None else _numbers(floor),
        "distortion": dict(compared.distortion),
        "quiet_ratio": None if ratio is None else _numbers(ratio),
        "more_than_noise": compared.explained,
        "findings": [finding_text(finding) for finding in compared.findings],
        "band_hz": list(compared.band_hz),
        "references": dict(zip(compared.commands, compared.references, strict=True)),
        "responses": [response.to_json() for response in compared.responses],
        "amplitude": {
            "levels": [asdict(level) for level in compared.levels],
            "growth": [growth.to_json() for growth in compared.growth],
        },
        "conditions": [asdict(level) for level in compared.conditions],
        "trends": [asdict(trend) for trend in compared.trends],
        "controls": {name: _numbers(each) for name, each in compared.controls.items()},
        "runs": [run.to_json() for run in compared.runs],
        "suspicions": [suspicion_document(suspicion) for suspicion in compared.suspicions],
        "remarks": list(compared.remarks),
        "warnings": list(warnings),
    }


def diagnosis_document(found: FitDiagnosis, warnings: Sequence[str] = (), folder: Path | None = None) -> dict[str, Any]:
    """The `tippath.diagnosis/1` document with all that is told beside the diagnosis, and what stands against it.

    `folder` is where it will be kept; the working directory where it is printed.
    """
    comparison, structure, terms = found.comparison, found.fit.model.structure, found.last.terms
    return {
        **found.last.to_json(),
        "fit_sha256": digest(found.fit),
        "models": open_models(found, folder or Path()),
        **({"within_points": None, "remainder": None} if found.remainder is None else found.remainder.to_json()),
        "slight": None if found.slight is None else found.slight.to_json(),
        "warnings": list(warnings),
        "reason": "clocks" if any(isinstance(remark, ClocksDiffer) for remark in found.remarks) else found.last.reason,
        "character": {
            "findings": [finding_text(finding) for finding in comparison.findings],
            "bands": [band.to_json() for band in comparison.bands],
            "responses": [response.to_json() for response in comparison.responses],
            "growth": [growth.to_json() for growth in comparison.growth],
            "controls": {name: dict(shares) for name, shares in comparison.controls.items()},
        },
        "explanation": explanation_document(found.explanation),
        "could_hide": list(hidden_sentences(found.hiding)),
        "next_maneuver": None if found.next is None else next_maneuver_document(found.next, found.runs.records),
        "terms": [
            {"equation": term.entry.equation, "error_share": term.error_share, "as_well": len(term.as_well)}
            for term in (() if terms is None else terms.terms)
        ],
        "beyond": list(beyond_sentences(found.last)),
        "suspicions": [suspicion_document(suspicion) for suspicion in comparison.suspicions],
        "structure": {"base": structure.base, "effects": list(structure.effects)},
        "rungs": [rung.to_json() for rung in found.rungs],
        "remarks": [remark_text(remark) for remark in found.remarks],
        **shown_document(found),
    }


def grown_document(found: FitDiagnosis, folder: Path) -> dict[str, Any] | None:
    """The fit with what was found added, as `tippath add` would write it; None where nothing was."""
    grown = found.grown
    return None if grown is None else {**grown.to_json(folder), **judgement_document(assess(grown, found.runs))}


def next_maneuver_document(next_maneuver: NextManeuver, records: Sequence[Record] = ()) -> dict[str, Any]:
    """`maneuver`, `separates`, `why`, `sigma`, `card`, and `how` it is flown where no card does it, by these runs;
    `fit_runs`, ids, where nothing is to be flown but runs are to be fitted that only judged."""
    proposal, card = next_maneuver.proposal, next_maneuver.card
    return {
        "maneuver": maneuver_text(next_maneuver),
        "separates": list(next_maneuver.separates),
        "why": why_text(next_maneuver.why),
        "sigma": None if next_maneuver.sigma is None else finite(next_maneuver.sigma),
        "card": None if card is None else dict(card),
        "how": how_text(proposal, records) if card is None else None,
        "fit_runs": list(proposal.runs) if isinstance(proposal, FitRuns) else [],
    }


def suspicion_document(suspicion: Suspicion) -> dict[str, Any]:
    """`kind`, `runs`, `text`."""
    return {"kind": suspicion.kind, "runs": list(suspicion.runs), "text": suspicion_text(suspicion)}


def _numbers(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: finite(x) for name, x in values.items()}

"""What the demonstration designs on its discovery, and what it leaves in the flight's folder, as commands leave it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.flight.folder import FlightFolder

if TYPE_CHECKING:  # as in `gcs.demo.demo`
    from gcs.analysis.clearance import Clearance
    from gcs.analysis.fits import Identification
    from gcs.analysis.standing import Standing
    from gcs.demo.discovery import Discovery
    from gcs.flight.identified import Identified
    from sysid.control.regulator import Gains
    from sysid.fit.result import Fit


@dataclass(frozen=True, eq=False)
class Design:
    """Gains, what they are worth, and what is known of the vehicle that they are for."""

    gains: Gains
    clearance: Clearance
    identified: Identified


def design_on(found: Discovery, input_cost: float, folder: Path) -> Design:
    """The paper's LQR on the best fit of a discovery, judged by what the diagnosis leaves open of that fit.

    Raises DesignError for gains that do not hold it.
    """
    from gcs.analysis.standing import NOT_ASKED, standing_of
    from gcs.analysis.text.documents import diagnosis_document
    from sysid.control.regulator import design

    fit, asked = found.best, found.diagnosis
    known = standing_of(diagnosis_document(asked, folder=folder), folder) if asked.fit is fit else NOT_ASKED
    return judged(design(fit.model, input_cost), fit, known)


def cleared_design(found: Discovery, input_costs: Sequence[float], folder: Path, tell: Callable[[str], None]) -> Design:
    """At the first of these costs whose gains may be pushed, else at the last, which a push then refuses.

    Raises DesignError as `design_on` does, for the last.
    """
    from sysid.control.regulator import DesignError

    *earlier, last = input_costs
    for cost in earlier:
        try:
            made = design_on(found, cost, folder)
        except DesignError as error:
            tell(str(error))
            continue
        if not made.clearance.judgement.refused:
            return made
        tell(f"input cost {cost:g} is not cleared: {made.gains.margins.words}; a higher one leaves more")
    return design_on(found, last, folder)


def judged(gains: Gains, fit: Fit, known: Standing) -> Design:
    """Gains that were designed on a fit, with what they are worth."""
    from gcs.analysis.clearance import clearance
    from gcs.analysis.identified import identified

    return Design(gains, clearance(gains, fit, known), identified(fit))


def keep_results(folder: FlightFolder, found: Identification, discovery: Discovery, made: Design) -> None:
    """The fits, the diagnosis, the effect that was added, the gains and the page of all that, beside the log."""
    from gcs.analysis.clearance import gains_document
    from gcs.analysis.pages.page import page
    from gcs.analysis.pages.report import flight_document
    from gcs.analysis.text.addition import addition_document
    from gcs.analysis.text.documents import diagnosis_document

    where, grown = folder.path, discovery.addition
    fits = {"tpp.json": found.tpp.to_json(where), "cd.json": found.cd.to_json(where)}
    if grown is not None:
        fits[f"tpp-{grown.named}.json"] = addition_document(grown, where)
    gains = gains_document(made.gains, made.clearance, made.identified, where)
    for name, document in fits.items():
        _keep(where / name, document)
    _keep(where / "tpp-diagnosis.json", diagnosis_document(discovery.diagnosis, folder=where))
    _keep(where / "gains.json", gains)
    shown = flight_document([where / name for name in fits], (), where / "gains.json")
    (where / "report.html").write_text(page(shown), "utf-8")


def _keep(path: Path, document: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", "utf-8")

"""Gains on a page: designed again on the fit that they are from, what they are worth, and the answer they promise."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs import documents
from gcs.analysis.clearance import clearance, gains_in
from gcs.analysis.pages.flown import following_figure
from gcs.analysis.pages.parts import Listing, Picture, Section
from gcs.analysis.rungs import KeptFit
from gcs.analysis.standing import beside
from gcs.analysis.text.clearance import VERDICTS, clearance_text
from gcs.analysis.text.gains import gains_text
from gcs.flight.gains import GainsDocument, GainsError, checksum, load_gains
from sysid.control.loop import following
from sysid.control.regulator import Gains, lqr, not_held
from sysid.control.stability import closed_loop
from sysid.errors import SysidError
from sysid.fit.result import Fit

SAME = 1e-9
"""Relative: gains designed again on another machine."""


def gains_section(path: Path, fits: Sequence[KeptFit], warn: Callable[[str], None]) -> tuple[Section, str]:
    """The gains designed again on the fit that they are from, and what they come to in a line.

    Raises GainsError, with the reason for each fit, where they are from none of them.
    """
    crc = load_gains(path).crc
    document = json.loads(path.read_text(encoding="utf-8"))
    reasons = []
    for one in reversed(fits):
        gains = _designed_again(document, one.fit)
        if isinstance(gains, str):
            reasons.append(f"{one.path.name}: {gains}")
            continue
        text = f"{gains_text(gains)}\n  checksum      {checksum(crc)}"
        if gains.loop.stable:
            cleared = clearance(gains, one.fit, beside(one.path.parent, one.fit, one.fit.model.structure.files))
            drawn = Picture(
                following_figure(following(gains, one.fit.model)),
                "Predicted answer of the closed loop to doublets of the rate commands, in small motion.",
            )
            parts = (Listing(f"{text}\n{clearance_text(cleared)}"), drawn)
            return Section(f"Gains, {path.name}", parts), VERDICTS[cleared.judgement.verdict]
        refused = f"{not_held(gains, one.fit.model)}. Do not push it; design again, `tippath design` says what holds"
        warn(f"{path}: {refused}")
        heading = f"Gains, {path.name}, which do not hold {one.path.name}"
        return Section(heading, (Listing(f"{refused}.\n\n{text}"),)), f"they do not hold {one.path.name}"
    raise GainsError(f"{path} was designed on none of these fits: {'; '.join(reasons)}")


def _designed_again(document: dict[str, Any], fit: Fit) -> Gains | str:
    """The gains of a document, with the loop that they make with this fit; or why they are not from it.

    K and the steady prefilter follow from the model and the weights; observer and dynamic prefilter may be others.
    """
    weights = document.get("weights")
    cost, flapping = (weights.get(name) if isinstance(weights, dict) else None for name in ("inputs", "flapping"))
    if not (isinstance(cost, int | float) and isinstance(flapping, int | float)):
        return "the gains do not say with which weights they were designed"
    try:
        held = gains_in(documents.convert(document, GainsDocument, "the gains"))
        gains = lqr(fit.model, float(cost), elevator=len(held.K) > 2, flapping_cost=float(flapping))
    except SysidError as error:
        return f"no gains can be designed on it: {error}"
    own = gains.model.by_name
    theirs = document["model"]["parameters"]
    moved = [name for name, value in own.items() if theirs.get(name) != value]
    if moved:
        return f"its model is another ({', '.join(moved)} differ)"
    for name, here, value in (("K", held.K, gains.K), ("prefilter", held.prefilter, gains.prefilter)):
        if not np.allclose(here, value, rtol=0, atol=SAME * float(np.max(np.abs(value)))):
            return f"{name} is not what `tippath design` makes of its model"
    return replace(
        held, input_cost=gains.input_cost, flapping_cost=gains.flapping_cost, loop=closed_loop(held, fit.model)
    )

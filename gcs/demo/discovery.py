"""What the demonstration is about: which effect TPP lacks on what was flown, and the error with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # as in `gcs.demo.demo`
    from gcs.analysis.addition import Addition
    from gcs.analysis.diagnosis import FitDiagnosis
    from sysid.data.record import Record
    from sysid.fit.result import Fit

SHOWN = ("answer", "measures", "ladder")
"""Blocks of the diagnosis and of the added effect."""


@dataclass(frozen=True, eq=False)
class Discovery:
    """What the fit lacked, and what became of it."""

    diagnosis: FitDiagnosis
    addition: Addition | None
    """None where nothing was missing that could be added."""

    @property
    def text(self) -> str:
        """The answer, why, and the ladder."""
        from gcs.analysis.text.addition import addition_blocks
        from gcs.analysis.text.blocks import text_of
        from gcs.analysis.text.diagnosis import diagnosis_blocks

        blocks = [*diagnosis_blocks(self.diagnosis), *([] if self.addition is None else addition_blocks(self.addition))]
        return text_of([one for one in blocks if one.key in SHOWN])

    @property
    def best(self) -> Fit:
        """With what was missing, where that is to be kept; else the fit that was asked. Gains are designed on it."""
        from gcs.analysis.text.addition import outcome

        grown = self.addition
        return self.diagnosis.fit if grown is None or not outcome(grown)[0] else grown.after

    def to_json(self) -> dict[str, Any]:
        last = self.diagnosis.last
        grown = None if self.addition is None else self.addition.after
        return {
            "verdict": last.verdict,
            "effect": last.effect,
            "confidence": last.confidence,
            "nrmse_percent_with_it": None if grown is None else dict(grown.nrmse_percent),
            "validation_nrmse_percent_with_it": None if grown is None else grown.validation_nrmse_percent,
        }


def discover(
    fit: Fit, records: Sequence[Record], validation: Sequence[Record], tell: Callable[[str], None]
) -> Discovery:
    """Ask the fit of a flight what it lacks, and add it. Raises what the diagnosis has to say."""
    from gcs.analysis.addition import add_effect
    from gcs.analysis.diagnosis import diagnose_fit
    from gcs.analysis.text.addition import outcome
    from gcs.analysis.text.blocks import whole
    from sysid.model.effect import find

    tell("asking which physical effect TPP lacks, and trying each on the doublets")
    diagnosis = diagnose_fit(fit, records, validation)
    last = diagnosis.last
    if last.verdict != "missing" or last.effect is None:
        tell(f"{last.verdict}, confidence {last.confidence:.2f}")
        return Discovery(diagnosis, None)
    tell(f"missing: {last.effect}, confidence {last.confidence:.2f}; adding it")
    addition = add_effect(fit, find(last.effect), records, validation)
    tell(whole(outcome(addition)[1], {}))
    return Discovery(diagnosis, addition)

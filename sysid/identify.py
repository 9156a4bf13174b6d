"""From records to a fit: several runs together, validated on others, with what the user should be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.checks import explain_instability
from sysid.fit import AXIS_OF, Estimate, FitError, OutputError, estimate, output_error
from sysid.model import Model, Structure
from sysid.preprocess import DEFAULT_BAND_HZ, Spectrum, spectra
from sysid.record import Record
from sysid.result import Fit, RecordUsed


def identify(
    structure: Structure,
    records: Sequence[Record],
    validation: Sequence[Record] = (),
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    profile: str | None = None,
    window_s: tuple[float | None, float | None] | None = None,
) -> Fit:
    """Fit a structure to all records together; validation records only judge.

    `profile` and `window_s` say how the records were cut from their logs and are kept with the fit.

    Raises FitError where an axis is not identifiable; the message says which and what to do.
    """
    refuse_mixed_sources([*records, *validation])
    if not 0 <= band_hz[0] < band_hz[1]:
        raise FitError(f"the band {band_hz[0]:g}:{band_hz[1]:g} Hz is empty")
    fitted, warnings = spectra(records, structure.inputs, structure.outputs, band_hz)
    found: Estimate = estimate(structure, fitted)
    warnings += _resampling(fitted)
    warnings += _suspicious_signs(found.model)
    if not found.model.stable:
        warnings += explain_instability(found.model, fitted)
    judged: Mapping[str, float] | None = None
    if validation:
        judging, remarks = spectra(validation, structure.inputs, structure.outputs, band_hz)
        warnings += remarks
        if not judging:
            raise FitError("no validation run has 2 s of gap-free samples")
        judged = by_output(structure, output_error(found.model, judging))
    return Fit(
        found.model,
        found.covariance,
        by_output(structure, found.error),
        judged,
        tuple(RecordUsed.of(record, band_hz[1]) for record in records),
        tuple(RecordUsed.of(record, band_hz[1]) for record in validation),
        band_hz,
        tuple(warnings),
        profile,
        window_s,
    )


def judge(model: Model, records: Sequence[Record], band_hz: tuple[float, float] = DEFAULT_BAND_HZ) -> dict[str, float]:
    """NRMSE by output of a model on records; only trims and end states are estimated."""
    found, _ = spectra(records, model.structure.inputs, model.structure.outputs, band_hz)
    if not found:
        raise FitError("no run has 2 s of gap-free samples: nothing to judge by")
    return by_output(model.structure, output_error(model, found))


def by_output(structure: Structure, error: OutputError) -> dict[str, float]:
    return {name: float(x) for name, x in zip(structure.outputs, error.nrmse_percent, strict=True)}


def refuse_mixed_sources(records: Sequence[Record]) -> None:
    """p and q of all runs of one fit come from the same kind of message: two kinds differ in their filters."""
    sources = sorted({record.rate_source for record in records})
    if len(sources) > 1:
        raise FitError(
            f"the runs take p and q from different messages ({', '.join(sources)}), which differ by milliseconds; "
            "fit runs of one kind together"
        )


def _resampling(found: Sequence[Spectrum]) -> list[str]:
    moved = sum(one.segment.resampled for one in found)
    total = sum(one.samples for one in found)
    if moved <= 0.01 * total:
        return []
    return [f"time stamps are irregular: {moved} of {total} samples were put on a uniform clock"]


def _suspicious_signs(model: Model) -> list[str]:
    """Positive commands give positive steady rates by convention; a model that says otherwise met other signs."""
    A, B, C, D = model.matrices
    if not model.stable:
        return []
    steady = D - C @ np.linalg.solve(A, B)
    said = []
    for index, (command, rate) in enumerate(zip(model.structure.inputs[:2], model.structure.outputs, strict=True)):
        if steady[index, index] < 0:
            said.append(
                f"the steady {rate} answers {command} with the opposite sign: "
                f"check the sign of {command} or of {rate} ({AXIS_OF[command]} axis)"
            )
    for parameter, value in zip(model.structure.parameters, model.values, strict=True):
        if parameter.implausible(float(value)):
            low, high = parameter.plausible
            said.append(f"{parameter.name} = {value:.4g} is outside what physics allows ({low:g} to {high:g})")
    return said

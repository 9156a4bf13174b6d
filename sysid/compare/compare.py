"""Where a model fails on flown runs: its error divided by frequency, time, amplitude and flight condition.

The error is what the fit's own criterion leaves: the residual in the band, trims and end states taken out, every sample
of every run counting the same. By Parseval its power is the same over frequency and over time, so all divisions add up
to one. Noise is told from error by what was recorded (`sysid.fit.noise`), and by quiet hover where it was flown: there
no command moves, and the residual is noise alone. What quiet hover does not show and the commands do not explain
linearly is the work of a nonlinearity, or of rougher air.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.compare.by_frequency import band_errors, response_errors
from sysid.compare.by_run import RunsAlone, growth_with_amplitude
from sysid.compare.by_time import amplitudes, level_errors, trace_of, trends, varied_conditions, window_errors
from sysid.compare.data_checks import clipped, mistaken_axes, mixed, not_separable
from sysid.compare.findings import findings
from sysid.compare.noise import Levels, NoiseShare, densities, other_controls, power_of_bins, quiet_levels
from sysid.compare.values import Comparison
from sysid.data.instrument import causes
from sysid.data.preprocess import spectra
from sysid.data.record import Record
from sysid.data.stacks import stack
from sysid.errors import SysidError
from sysid.fit.noise import divide
from sysid.fit.output_error import output_error
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model


class CompareError(SysidError):
    """Runs that a model cannot be compared on; the message says why and what to do."""


def compare(
    model: Model,
    records: Sequence[Record],
    band_hz: tuple[float, float],
    quiet: Sequence[Record] = (),
    *,
    own_runs: bool = True,
) -> Comparison:
    """Compare a model with flown runs.

    Runs of quiet hover, among the records or in `quiet`, measure the noise and are not compared on. `own_runs` says
    that the model was fitted to these records, so that what is left is not for its numbers to mend. Raises
    CompareError where nothing can be compared.
    """
    try:
        return _compared(model, records, band_hz, quiet, own_runs)
    except (RelaxationError, np.linalg.LinAlgError) as failure:
        raise CompareError(f"the model's response does not settle on these runs ({failure})") from failure


def _compared(
    model: Model, records: Sequence[Record], band_hz: tuple[float, float], quiet: Sequence[Record], own_runs: bool
) -> Comparison:
    structure = model.structure
    flown = [record for record in records if record.maneuver != "quiet"]
    still = [*quiet, *(record for record in records if record.maneuver == "quiet")]
    if not flown:
        raise CompareError("no run to compare on: quiet hover alone tells of noise only; name a chirp")
    _refuse_missing_channels(model, [*flown, *still])
    found, remarks = spectra(flown, structure.inputs, structure.outputs, band_hz)
    if not found:
        raise CompareError(f"no run has 2 s of gap-free samples: nothing to compare on. {'; '.join(remarks)}".strip())
    found = [one for one in found if one.frequency_hz.size]
    if not found:
        raise CompareError(f"no frequency lies in {band_hz[0]:g}-{band_hz[1]:g} Hz: widen the band or take longer runs")
    stacks = stack(found)
    parts = [one for group in stacks for one in group.spectra]
    error = output_error(model, stacks)
    if not np.all(error.measured_power > 0):
        dead = ", ".join(name for name, x in zip(structure.outputs, error.measured_power, strict=True) if not x > 0)
        raise CompareError(f"{dead} does not move at all in these runs: check the gyro's channel")
    by = causes(stacks, structure.commands)
    commanded = divide(error, stacks, by)
    alone = RunsAlone(model, parts, error)
    responses, suspected = response_errors(model, found)
    power = power_of_bins(error, stacks)
    whole = np.maximum(error.residual_power, 1e-300)
    controls, division = other_controls(model, flown, band_hz, stacks=stacks, error=error, division=commanded)
    levels = Levels.of(division, stacks)
    calm = quiet_levels(model, still, band_hz, division.edges_hz, remarks)
    noise = NoiseShare.of(division, commanded.measured, levels, calm, power)
    runs = alone.runs()
    growth = growth_with_amplitude(runs, alone, structure.outputs) if commanded.measured else ()
    mixture = mixed(
        alone.ids,
        [(one.axis, one.maneuver) for one in runs],
        alone.power,
        alone.explained,
        across=commanded.measured,
        amplitudes=bool(growth),
    )
    if mixture:
        # what a response of their own explains of the runs is no noise
        noise = noise.at_most(1 - np.sum([alone.explained([i]) for i in range(len(runs))], axis=0) / whole)
    bands = band_errors(model, flown, band_hz, stacks=stacks, power=power, division=division, noise=noise)
    traces = tuple(
        trace_of(structure.commands, one, residual) for one, residual in zip(parts, error.residuals, strict=True)
    )
    in_time = window_errors(traces, structure.outputs)
    suspicions = [
        *clipped(flown),
        *mistaken_axes(flown),
        *suspected,
        *mixture,
        *not_separable(structure, found),
    ]
    outputs = structure.outputs
    shares = None if noise.share is None else dict(zip(outputs, map(float, noise.share), strict=True))
    left = whole / error.measured_power
    floor = None if noise.share is None else 100 * (1 - np.sqrt(noise.share * left))
    result = Comparison(
        outputs=outputs,
        commands=structure.commands,
        references=by.references,
        band_hz=band_hz,
        nrmse_percent=dict(zip(outputs, map(float, error.nrmse_percent), strict=True)),
        noise_share=shares,
        noise_floor_percent=None if floor is None else dict(zip(outputs, map(float, floor), strict=True)),
        noise_share_is="measured" if commanded.measured or calm is not None else "upper bound, closed loop",
        noise_from=noise.source,
        quiet_ratio=None if noise.ratio is None else dict(zip(outputs, map(float, noise.ratio), strict=True)),
        distortion=dict(zip(outputs, map(float, noise.distortion), strict=True)),
        more=dict(zip(outputs, map(bool, noise.more), strict=True)),
        explained=noise.explained,
        bands=bands,
        windows=in_time,
        levels=level_errors(traces, parts, amplitudes(outputs)),
        conditions=level_errors(traces, parts, varied_conditions(flown)),
        trends=trends(traces, parts, varied_conditions(flown)),
        runs=runs,
        growth=growth,
        controls=controls,
        responses=responses,
        densities=densities(stacks, error, levels, noise),
        traces=traces,
        suspicions=tuple(suspicions),
        remarks=tuple(dict.fromkeys(remarks)),
        findings=(),
    )
    return replace(result, findings=findings(result, own_runs))


def _refuse_missing_channels(model: Model, records: Sequence[Record]) -> None:
    for record in records:
        missing = [name for name in model.structure.inputs if name not in record.channels]
        if missing:
            needs = ", ".join(one.id for one in model.structure.composed if set(one.channels) & set(missing))
            raise CompareError(
                f"{record.id}: {', '.join(missing)} is not logged, which the fit's {needs or 'structure'} needs; "
                "compare on runs that have it, or fit without"
            )

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
from sysid.compare.data_checks import clipped, mistaken_axes, not_separable
from sysid.compare.findings import findings
from sysid.compare.noise import Levels, NoiseShare, densities, other_controls, quiet_levels
from sysid.compare.on_runs import CompareError, ModelOnRuns
from sysid.compare.values import Comparison
from sysid.data.dataset import Dataset, Runs, prepared
from sysid.data.record import Record
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model


def compare(
    model: Model,
    runs: Runs,
    band_hz: tuple[float, float],
    quiet: Sequence[Record] = (),
    *,
    own_runs: bool = True,
) -> Comparison:
    """Compare a model with flown runs.

    Runs of quiet hover, among these or in `quiet`, measure the noise and are not compared on. `own_runs` says that
    the model was fitted to these runs, so that what is left is not for its numbers to mend. Raises
    CompareError where nothing can be compared.
    """
    try:
        return _compared(model, prepared(runs, band_hz), quiet, own_runs)
    except (RelaxationError, np.linalg.LinAlgError) as failure:
        raise CompareError(f"the model's response does not settle on these runs ({failure})") from failure


def _compared(model: Model, on_all: Dataset, quiet: Sequence[Record], own_runs: bool) -> Comparison:
    records, band_hz = on_all.records, on_all.band_hz
    flown = [record for record in records if record.maneuver != "quiet"]
    still = [*quiet, *(record for record in records if record.maneuver == "quiet")]
    if not flown:
        raise CompareError("no run to compare on: quiet hover alone tells of noise only; name a chirp")
    _refuse_missing_channels(model, [*flown, *still])
    on = ModelOnRuns.of(model, on_all.of(flown))
    alone = RunsAlone(on)
    runs = alone.runs()
    growth = growth_with_amplitude(runs, alone, on.outputs) if on.division.measured else ()
    controls, division = other_controls(on)
    calm, remarks = quiet_levels(model, prepared(still, band_hz), division.edges_hz)
    levels = Levels.of(division, on.stacks)
    noise = NoiseShare.of(division, on.division.measured, levels, calm, on.power)
    mixture = alone.mixture(runs, across=on.division.measured, amplitudes=bool(growth))
    if mixture:
        noise = noise.at_most(1 - alone.explained_apart / on.residual_power)
    responses, mistaken = response_errors(on)
    checks = [*clipped(flown), *mistaken_axes(flown), *mistaken, *mixture, *not_separable(model.structure, on.spectra)]
    traces = tuple(
        trace_of(model.structure.commands, one, residual)
        for one, residual in zip(on.spectra, on.error.residuals, strict=True)
    )
    conditions = varied_conditions(flown, on.outputs)
    result = Comparison(
        outputs=on.outputs,
        commands=model.structure.commands,
        references=on.causes.references,
        band_hz=band_hz,
        nrmse_percent=on.by_output(on.error.nrmse_percent),
        noise_share=None if noise.share is None else on.by_output(noise.share),
        noise_floor_percent=None if noise.share is None else on.by_output(_floor_percent(noise.share, on)),
        noise_share_is="measured" if on.division.measured or calm is not None else "upper bound, closed loop",
        noise_from=noise.source,
        quiet_ratio=None if noise.ratio is None else on.by_output(noise.ratio),
        distortion=on.by_output(noise.distortion),
        more=dict(zip(on.outputs, map(bool, noise.more), strict=True)),
        explained=noise.explained,
        bands=band_errors(on, division, noise),
        windows=window_errors(traces, on.outputs),
        levels=level_errors(traces, on.spectra, amplitudes(on.outputs), on.outputs),
        conditions=level_errors(traces, on.spectra, conditions, on.outputs),
        trends=trends(traces, on.spectra, conditions, on.outputs),
        runs=runs,
        growth=growth,
        controls=controls,
        responses=responses,
        densities=densities(on, levels, noise),
        traces=traces,
        suspicions=tuple(checks),
        remarks=tuple(dict.fromkeys([*on.dataset.remarks, *remarks])),
        findings=(),
    )
    return replace(result, findings=findings(result, own_runs))


def _floor_percent(noise_share: FloatArray, on: ModelOnRuns) -> FloatArray:
    """NRMSE (k,) that a model without any error but the noise would reach."""
    return 100 * (1 - np.sqrt(noise_share * (on.residual_power / on.error.measured_power)))


def _refuse_missing_channels(model: Model, records: Sequence[Record]) -> None:
    for record in records:
        missing = [name for name in model.structure.inputs if name not in record.channels]
        if missing:
            needs = ", ".join(one.id for one in model.structure.composed if set(one.channels) & set(missing))
            raise CompareError(
                f"{record.id}: {', '.join(missing)} is not logged, which the fit's {needs or 'structure'} needs; "
                "compare on runs that have it, or fit without"
            )

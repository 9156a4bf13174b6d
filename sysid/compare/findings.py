"""What a comparison finds, as values; each stands there only where the data carry it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sysid.compare.finding_kinds import (
    MOST_OF_IT,
    AtTheEnds,
    Burst,
    ChangesWithAmplitude,
    ErrorInBand,
    Finding,
    FollowsControl,
    GoesWithCondition,
    GrowsWithAmplitude,
    LeavesBounds,
    NearlyNoise,
    NoiseKnown,
    NotSeparable,
    OnlyNoise,
    TooShort,
    WorseRun,
)
from sysid.compare.values import GROWTH_RATIO, BandError, Comparison, ResponseError, RunError
from sysid.data.record import axis_of

NEARLY_ALL = 0.9
QUIET_AGREES = 2.0
"""Factor between the two within which they agree."""
DISTORTED = 0.08
"""Of the error, that is neither as in quiet hover nor linear, to be spoken of."""
CHANGED = 0.15
"""Of the error, that goes away when the response may differ between amplitudes, to be spoken of."""
WORSE = 2.0
MOSTLY_NOISE = 0.7
OFF_DB, OFF_DEG = 0.5, 3.0
"""Of a response outside its bounds, to be spoken of."""
BANDS_TOLD = 2
ENDS_S = 2.0
ENDS_SHARE, ENDS_DENSITY = 0.25, 3.0
BURST_SHARE, BURST_DENSITY = 0.2, 6.0


def findings(compared: Comparison, own_runs: bool) -> tuple[Finding, ...]:
    """What there is to tell, mistakes in the data first; `own_runs` says that the model was fitted to these."""
    refused = [one for one in compared.suspicions if isinstance(one, NotSeparable)]
    mistakes = [one for one in compared.suspicions if not isinstance(one, NotSeparable)]
    return (
        *mistakes,
        *_error_findings(compared, own_runs),
        *_response_findings(compared),
        *_growth_findings(compared),
        *_control_findings(compared),
        *_time_findings(compared),
        *_condition_findings(compared),
        *_run_findings(compared),
        *refused,
    )


def _error_findings(compared: Comparison, own_runs: bool) -> list[Finding]:
    """Where the error of each axis sits, the worst axis first."""
    nonlinear = any(share > DISTORTED for share in compared.distortion.values())
    if not any(compared.more.values()) and not nonlinear:
        return [OnlyNoise(_noise_known(compared))]
    worst_first = sorted(compared.outputs, key=lambda output: compared.nrmse_percent[output])
    return [_axis_finding(compared, output, own_runs) for output in worst_first]


def _noise_known(compared: Comparison) -> NoiseKnown:
    agrees = compared.quiet_ratio is not None and all(
        1 / QUIET_AGREES < ratio < QUIET_AGREES for ratio in compared.quiet_ratio.values()
    )
    return NoiseKnown(compared.noise_from, agrees)


def _axis_finding(compared: Comparison, output: str, own_runs: bool) -> Finding:
    axis = axis_of(output)
    bands = [one for one in compared.bands if one.axis == axis]
    if compared.noise_share is None:
        worst = max(bands, key=lambda band: band.error_share)
        return TooShort(axis, (worst.low_hz, worst.high_hz), worst.error_share)
    noise, share = _noise_known(compared), compared.noise_share[output]
    distortion = compared.distortion[output] if compared.distortion[output] > DISTORTED else None
    if not compared.more[output] and distortion is None:
        return OnlyNoise(noise, axis)
    inside = _stretch(bands)
    band = inside[0].low_hz, inside[-1].high_hz
    if share > NEARLY_ALL and distortion is None:
        return NearlyNoise(axis, band, share, noise)
    part = sum(one.error_share for one in inside)
    weight = max(part, 1e-300)
    return ErrorInBand(
        axis=axis,
        band_hz=band,
        error_share=part,
        noise_within=sum(one.error_share * (one.noise_share or 0) for one in inside) / weight,
        coherence={
            name: sum(one.error_share * one.coherence[name] for one in inside) / weight for name in inside[0].coherence
        },
        coherence_together=sum(one.error_share * one.coherence_together for one in inside) / weight,
        noise_share=share,
        noise=noise,
        distortion=distortion,
        mixed=any(one.kind == "mixed" for one in compared.suspicions),
        own_runs=own_runs,
    )


def _stretch(bands: Sequence[BandError]) -> Sequence[BandError]:
    """The neighbouring bands that hold most of what is not noise."""
    beyond = np.array([one.beyond_noise for one in bands])
    first = last = int(np.argmax(beyond))
    while np.sum(beyond[first : last + 1]) < MOST_OF_IT * np.sum(beyond):
        below = beyond[first - 1] if first > 0 else -1.0
        above = beyond[last + 1] if last + 1 < len(bands) else -1.0
        if below > above:
            first -= 1
        else:
            last += 1
    return bands[first : last + 1]


def _response_findings(compared: Comparison) -> Iterator[Finding]:
    """Of each axis with more than noise the response that lies furthest outside its bounds, where that is of a size."""
    for output in compared.outputs:
        each = [one for one in compared.responses if one.mismatch.output == output and one.noticed]
        if not compared.more[output] or not each:
            continue
        worst = max(each, key=lambda one: float(np.sum(one.off[one.outside] ** 2)))
        at = int(np.argmax(np.where(worst.outside, worst.off, -1.0)))
        furthest_hz = float(worst.frequency_hz[at])
        decibels, degrees = float(worst.decibels[at]), float(worst.degrees[at])
        if abs(decibels) >= OFF_DB or abs(degrees) >= OFF_DEG:
            yield LeavesBounds(
                axis=axis_of(output),
                output=output,
                command=worst.mismatch.command,
                bands_hz=_told_bands(worst, furthest_hz),
                furthest_hz=furthest_hz,
                decibels=decibels,
                degrees=degrees,
            )


def _told_bands(response: ResponseError, furthest_hz: float) -> tuple[tuple[float, float], ...]:
    """The band outside the bounds that holds this frequency, and of the others the longest on a logarithmic scale."""
    inside = [band for band in response.noticed if band[0] <= furthest_hz <= band[1]][:1]
    others = sorted((band for band in response.noticed if band not in inside), key=lambda band: band[0] / band[1])
    return tuple(sorted([*inside, *others][:BANDS_TOLD]))


def _growth_findings(compared: Comparison) -> Iterator[Finding]:
    for axis in ("roll", "pitch"):
        each = [one for one in compared.growth if one.axis == axis]
        strong = [one for one in each if one.significant]
        if strong:
            most = max(strong, key=lambda growth: abs(np.log(growth.per_doubling)))
            yield GrowsWithAmplitude(
                axis=axis,
                command=most.command,
                per_doubling=most.per_doubling,
                at_least=most.at_least,
                low=most.low,
                high=most.high,
            )
        elif any(one.changes > CHANGED for one in each):
            most = max(each, key=lambda growth: growth.changes)
            yield ChangesWithAmplitude(axis, most.command, most.changes)


def _control_findings(compared: Comparison) -> Iterator[Finding]:
    for name, shares in compared.controls.items():
        output, share = max(shares.items(), key=lambda item: item[1])
        if name in compared.bands[0].coherence:
            yield FollowsControl(axis_of(output), name, share)


def _time_findings(compared: Comparison) -> Iterator[Finding]:
    """Errors that sit at the ends of the runs, or in one place of one run."""
    total = sum(float(one.t[-1] - one.t[0]) for one in compared.traces)
    for k, output in enumerate(compared.outputs):
        at_ends = list(_end_findings(compared, k, axis_of(output), total))
        yield from at_ends
        if not at_ends and len(compared.runs) > 1:
            yield from _burst_findings(compared, axis_of(output), total)


def _end_findings(compared: Comparison, k: int, axis: str, total: float) -> Iterator[Finding]:
    """The ends of all runs, of output `k`; total: seconds of them all."""
    whole = max(float(np.sum([np.sum(one.residual[k] ** 2) for one in compared.traces])), 1e-300)
    for first in (True, False):
        share = time = 0.0
        for one in compared.traces:
            near = one.t - one.t[0] if first else one.t[-1] - one.t
            at = near < ENDS_S
            share += float(np.sum(one.residual[k, at] ** 2)) / whole
            time += min(ENDS_S, float(one.t[-1] - one.t[0])) / total
        if share > ENDS_SHARE and share > ENDS_DENSITY * time:
            yield AtTheEnds(axis=axis, share=share, first=first, seconds=ENDS_S)


def _burst_findings(compared: Comparison, axis: str, total: float) -> Iterator[Finding]:
    largest = max((one for one in compared.windows if one.axis == axis), key=lambda one: one.error_share)
    density = largest.error_share * total / (largest.stop_s - largest.start_s)
    if largest.error_share > BURST_SHARE and density > BURST_DENSITY:
        start = next(trace.t[0] for trace in compared.traces if trace.run == largest.run)
        yield Burst(
            axis=axis,
            share=largest.error_share,
            run=largest.run,
            start_s=largest.start_s - start,
            stop_s=largest.stop_s - start,
        )


def _condition_findings(compared: Comparison) -> Iterator[Finding]:
    for one in compared.trends:
        if one.significant:
            yield GoesWithCondition(axis=one.axis, channel=one.channel, factor=one.factor, low=one.low, high=one.high)


def _run_findings(compared: Comparison) -> Iterator[Finding]:
    """Runs whose error is far above that of the others of their kind."""
    for one in compared.runs:
        for output in compared.outputs:
            like = [
                other.error_share[output] / other.duration_s
                for other in compared.runs
                if other is not one and (other.axis, other.maneuver) == (one.axis, one.maneuver) and _like(other, one)
            ]
            own = one.error_share[output] / one.duration_s
            if like and own > WORSE * float(np.median(like)) and own > WORSE * min(like):
                yield WorseRun(
                    run=one.id,
                    axis=axis_of(output),
                    times=own / max(float(np.median(like)), 1e-300),
                    mostly_noise=one.noise_share is not None and one.noise_share[output] > MOSTLY_NOISE,
                )
                break


def _like(one: RunError, other: RunError) -> bool:
    """Whether two runs were flown with about the same amplitude."""
    sizes = max(one.command_rms.values()), max(other.command_rms.values())
    return max(sizes) < GROWTH_RATIO * min(sizes)

"""A comparison in sentences that an operator can use; each is said only where the data carry it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.compare.data_checks import listed
from sysid.compare.values import GROWTH_RATIO, BandError, Comparison, RunError
from sysid.data.record import axis_of

MOST_OF_IT, NEARLY_ALL = 0.5, 0.9
COHERENT, PARTLY = 0.5, 0.2
ONE_COMMAND = 0.8
"""Of what all commands explain; a command that explains this much alone is named alone."""
QUIET_AGREES = 2.0
"""Factor between the two within which they agree."""
DISTORTED = 0.08
"""Of the error, that is neither as in quiet hover nor linear, to be spoken of."""
CHANGED = 0.15
"""Of the error, that goes away when the response may differ between amplitudes, to be spoken of."""
WORSE = 2.0
ENDS_S = 2.0
ENDS_SHARE, ENDS_DENSITY = 0.25, 3.0
BURST_SHARE, BURST_DENSITY = 0.2, 6.0
CONDITION_WORDS = {"omega": "the rotor speed", "airspeed": "the airspeed"}


def findings(found: Comparison, own_runs: bool) -> tuple[str, ...]:
    """What is to be said, mistakes in the data first; `own_runs` says that the model was fitted to these."""
    said = [one.text for one in found.suspicions if one.kind != "not separable"]
    nonlinear = any(share > DISTORTED for share in found.distortion.values())
    if not any(found.more.values()) and not nonlinear:
        said.append(f"what is left is noise: nothing to find here ({_noise_words(found)})")
    else:
        worst_first = sorted(found.outputs, key=lambda output: found.nrmse_percent[output])
        said += [_axis_finding(found, output, own_runs) for output in worst_first]
    said += _growth_findings(found)
    said += _control_findings(found)
    said += _time_findings(found)
    said += _condition_findings(found)
    said += _run_findings(found)
    said += [one.text for one in found.suspicions if one.kind == "not separable"]
    return tuple(said)


def _noise_words(found: Comparison) -> str:
    agrees = found.quiet_ratio is not None and all(
        1 / QUIET_AGREES < ratio < QUIET_AGREES for ratio in found.quiet_ratio.values()
    )
    return {
        "quiet hover": "measured from quiet hover",
        "logged excitation": "measured, and quiet hover agrees" if agrees else "measured, the excitation is logged",
        "commands": "feedback hides some of it, the excitation is not logged",
    }[found.noise_from]


def _axis_finding(found: Comparison, output: str, own_runs: bool) -> str:
    axis = axis_of(output)
    bands = [one for one in found.bands if one.axis == axis]
    if found.noise_share is None:
        one = max(bands, key=lambda band: band.error_share)
        return (
            f"{axis}: {_percent(one.error_share)} of the error sits in {_hertz(one.low_hz, one.high_hz)}; the runs are "
            "too short to tell noise from error, fly longer ones or quiet hover"
        )
    least = "at least " if found.noise_from == "commands" else ""
    share = found.noise_share[output]
    noisy = f"Noise explains {least}{_percent(share)} ({_noise_words(found)})"
    nonlinear = found.distortion[output] > DISTORTED
    if not found.more[output] and not nonlinear:
        return f"{axis}: what is left is noise, nothing to find here"
    low, high, part, inside, together, each = _stretch(bands)
    if share > NEARLY_ALL and not nonlinear:
        return (
            f"{axis}: noise explains {least}{_percent(share)} ({_noise_words(found)}); "
            f"the little beyond it sits in {_hertz(low, high)}."
        )
    where = f"{axis}: {_percent(part)} of the error sits in {_hertz(low, high)}"
    lacking = "linear dynamics are missing there" if own_runs else "linear dynamics or their numbers are off there"
    name, alone = max(each.items(), key=lambda item: item[1])
    if together < PARTLY:
        said = f"{where}, hardly coherent with the commands ({together:.2f})"
        if any(one.kind == "mixed" for one in found.suspicions):
            said += ": the runs do not agree"
        else:
            what = "most of it is noise" if inside > MOST_OF_IT else "a nonlinearity, or something that is not logged"
            said += f": {'a nonlinearity rather than linear dynamics' if nonlinear else what}"
    elif alone >= ONE_COMMAND * together:
        said = f"{where}, coherent with {name} ({alone:.2f}): {lacking}"
    else:
        listing = ", ".join(f"{name} {value:.2f}" for name, value in sorted(each.items(), key=lambda item: -item[1]))
        said = f"{where}, coherent with the commands ({together:.2f}; {listing}): {lacking}"
    if together >= PARTLY and together < COHERENT:
        said += ", among other things"
    said += f". {noisy}"
    if nonlinear:
        said += (
            f"; {_percent(found.distortion[output])} is neither as in quiet hover nor linear in the commands: "
            "a nonlinearity, or rougher air"
        )
    return said + "."


def _stretch(bands: Sequence[BandError]) -> tuple[float, float, float, float, float, dict[str, float]]:
    """The neighbouring bands that hold most of what is not noise.

    Ends, share of the error, noise's share in it, coherence with all commands and with each.
    """
    beyond = np.array([one.error_share * (1 - (one.noise_share or 0)) for one in bands])
    first = last = int(np.argmax(beyond))
    while np.sum(beyond[first : last + 1]) < MOST_OF_IT * np.sum(beyond):
        below = beyond[first - 1] if first > 0 else -1.0
        above = beyond[last + 1] if last + 1 < len(bands) else -1.0
        if below > above:
            first -= 1
        else:
            last += 1
    inside = bands[first : last + 1]
    share = sum(one.error_share for one in inside)
    weight = max(share, 1e-300)
    each = {name: sum(one.error_share * one.coherence[name] for one in inside) / weight for name in inside[0].coherence}
    together = sum(one.error_share * one.coherence_together for one in inside) / weight
    noise = sum(one.error_share * (one.noise_share or 0) for one in inside) / weight
    return inside[0].low_hz, inside[-1].high_hz, share, noise, together, each


def _growth_findings(found: Comparison) -> list[str]:
    said = []
    for axis in ("roll", "pitch"):
        each = [one for one in found.growth if one.axis == axis]
        strong = [one for one in each if one.significant]
        if strong:
            one = max(strong, key=lambda growth: abs(np.log(growth.per_doubling)))
            way = "grows" if one.per_doubling > 1 else "falls"
            kind = "" if one.per_doubling > 1 else " that counts most in small motion, as play does"
            factor = f"{'at least ' if one.at_least else ''}x{one.per_doubling:.1f} per doubling beyond the linear"
            said.append(
                f"{axis}: the error {way} with amplitude ({factor}, {one.command} {one.low:.2g} to {one.high:.2g} "
                f"rms): a nonlinearity{kind}"
            )
        elif any(one.changes > CHANGED for one in each):
            one = max(each, key=lambda growth: growth.changes)
            said.append(
                f"{axis}: the response to {one.command} changes with amplitude "
                f"({_percent(one.changes)} of the error): a nonlinearity"
            )
    return said


def _control_findings(found: Comparison) -> list[str]:
    said = []
    for name, shares in found.controls.items():
        output, share = max(shares.items(), key=lambda item: item[1])
        if name in found.bands[0].coherence:
            said.append(
                f"{axis_of(output)}: {name} explains {_percent(share)} of the error beyond the commands: "
                + ("yaw couples into it" if name == "r" else "it acts on the vehicle and is not in the structure")
            )
    return said


def _time_findings(found: Comparison) -> list[str]:
    """Errors that sit at the ends of the runs, or in one place of one run."""
    said: list[str] = []
    total = sum(float(one.t[-1] - one.t[0]) for one in found.traces)
    for k, output in enumerate(found.outputs):
        axis = axis_of(output)
        whole = max(float(np.sum([np.sum(one.residual[k] ** 2) for one in found.traces])), 1e-300)
        for words, begin in (("first", True), ("last", False)):
            share = time = 0.0
            for one in found.traces:
                near = one.t - one.t[0] if begin else one.t[-1] - one.t
                at = near < ENDS_S
                share += float(np.sum(one.residual[k, at] ** 2)) / whole
                time += min(ENDS_S, float(one.t[-1] - one.t[0])) / total
            if share > ENDS_SHARE and share > ENDS_DENSITY * time:
                said.append(
                    f"{axis}: {_percent(share)} of the error sits in the {words} {ENDS_S:g} s of the runs: "
                    "cut them off with --window, or look at what happens there"
                )
        if any(text.startswith(axis) for text in said) or len(found.runs) < 2:
            continue
        largest = max((one for one in found.windows if one.axis == axis), key=lambda one: one.error_share)
        density = largest.error_share * total / (largest.stop_s - largest.start_s)
        if largest.error_share > BURST_SHARE and density > BURST_DENSITY:
            start = next(trace.t[0] for trace in found.traces if trace.run == largest.run)
            said.append(
                f"{axis}: {_percent(largest.error_share)} of the error sits at {largest.start_s - start:.0f}-"
                f"{largest.stop_s - start:.0f} s of {largest.run}: a gust, a knock or a lost sample there?"
            )
    return said


def _condition_findings(found: Comparison) -> list[str]:
    return [
        f"{one.axis}: the error grows where {CONDITION_WORDS[one.channel]} is {'high' if one.factor > 1 else 'low'} "
        f"(x{max(one.factor, 1 / one.factor):.1f} in power from {one.low:.4g} to {one.high:.4g})"
        for one in found.trends
        if one.significant
    ]


def _run_findings(found: Comparison) -> list[str]:
    """Runs whose error is far above that of the others of their kind."""
    said = []
    for one in found.runs:
        for output in found.outputs:
            like = [
                other.error_share[output] / other.duration_s
                for other in found.runs
                if other is not one and (other.axis, other.maneuver) == (one.axis, one.maneuver) and _like(other, one)
            ]
            own = one.error_share[output] / one.duration_s
            if like and own > WORSE * float(np.median(like)) and own > WORSE * min(like):
                noisy = one.noise_share is not None and one.noise_share[output] > 0.7
                why = "most of it is noise, rougher air" if noisy else "look at what was different in it"
                said.append(
                    f"{listed([one.id])} is worse than the others: its {axis_of(output)} error is "
                    f"{own / max(float(np.median(like)), 1e-300):.1f} times theirs; {why}"
                )
                break
    return said


def _like(one: RunError, other: RunError) -> bool:
    """Whether two runs were flown with about the same amplitude."""
    sizes = max(one.command_rms.values()), max(other.command_rms.values())
    return max(sizes) < GROWTH_RATIO * min(sizes)


def _percent(share: float) -> str:
    value = 100 * share
    return f"{value:.0f} %" if value >= 1 else "less than 1 %"


def _hertz(low: float, high: float) -> str:
    return f"{low:.2g}-{high:.2g} Hz"

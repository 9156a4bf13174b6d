"""What a comparison found and what it suspects, each in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from gcs.analysis.text.blocks import SHELL, Offers, Sentence, whole
from sysid.compare.finding_kinds import (
    Answers,
    AtTheEnds,
    Burst,
    ChangesWithAmplitude,
    Clipped,
    CommandsElsewhere,
    ErrorInBand,
    Finding,
    FollowsControl,
    GoesWithCondition,
    GrowsWithAmplitude,
    LeavesBounds,
    Mixed,
    NearlyNoise,
    NoiseKnown,
    NotSeparable,
    OnlyNoise,
    OtherAxisMoved,
    Suspicion,
    TooShort,
    WorseRun,
    WrongSigns,
)
from sysid.data.record import CYCLIC, RATES

CONDITIONS = {"omega": "the rotor speed", "airspeed": "the airspeed"}
NONLINEAR = "a nonlinearity"


def finding_text(finding: Finding, offers: Offers = SHELL) -> str:
    """One finding of a comparison, or one suspicion."""
    return whole(finding_sentence(finding), offers)


def finding_sentence(finding: Finding, first: str = "", rest: str = "") -> Sentence:
    """The same, still to be broken."""
    if isinstance(finding, AtTheEnds):
        look = " look at what happens there"
        return Sentence(_text(finding), first, rest, offer="cut off", last=look)
    return Sentence(_text(finding), first, rest)


def _text(finding: Finding) -> str:
    """What every face says of it."""
    match finding:
        case OnlyNoise(noise, None):
            return f"what is left is noise: nothing to find here ({_noise_known(noise)})"
        case OnlyNoise(_, axis):
            return f"{axis}: what is left is noise, nothing to find here"
        case NearlyNoise(axis, band, share, noise):
            return f"{axis}: noise explains {_noise(share, noise)}; the little beyond it sits in {_hertz(band)}."
        case ErrorInBand():
            return _error_in_band(finding)
        case TooShort(axis, band, share):
            return (
                f"{axis}: {_percent(share)} of the error sits in {_hertz(band)}; the runs are too short to tell noise "
                "from error, fly longer ones or quiet hover"
            )
        case LeavesBounds():
            return _leaves_bounds(finding)
        case GrowsWithAmplitude():
            return _growth(finding)
        case ChangesWithAmplitude(axis, command, share):
            changes = f"changes with amplitude ({_percent(share)} of the error)"
            return f"{axis}: the response to {command} {changes}: {NONLINEAR}"
        case FollowsControl(axis, channel, share):
            why = "yaw couples into it" if channel == "r" else "it acts on the vehicle and is not in the structure"
            return f"{axis}: {channel} explains {_percent(share)} of the error beyond the commands: {why}"
        case AtTheEnds():
            end = f"the {'first' if finding.first else 'last'} {finding.seconds:g} s of the runs"
            return f"{finding.axis}: {_percent(finding.share)} of the error sits in {end}:"
        case Burst():
            return (
                f"{finding.axis}: {_percent(finding.share)} of the error sits at {finding.start_s:.0f}-"
                f"{finding.stop_s:.0f} s of {finding.run}: a gust, a knock or a lost sample there?"
            )
        case GoesWithCondition():
            return _condition(finding)
        case WorseRun():
            why = "most of it is noise, rougher air" if finding.mostly_noise else "look at what was different in it"
            times = f"its {finding.axis} error is {finding.times:.1f} times theirs"
            return f"{finding.run} is worse than the others: {times}; {why}"
        case _:
            return suspicion_text(finding)


def suspicion_text(suspicion: Suspicion) -> str:
    """One mistake that the runs look like."""
    match suspicion:
        case Clipped():
            return (
                f"{suspicion.channel} is clipped at {suspicion.limit:.3g} rad/s ({100 * suspicion.share:.2g} % of the "
                f"samples of {listed_runs(suspicion.runs)}): fly with less amplitude, or set a larger range of the gyro"
            )
        case OtherAxisMoved(runs, axis, channel):
            declared = f"{listed_runs(runs)} {'is' if len(runs) == 1 else 'are'} declared {axis}"
            return f"{declared}, but {channel} moved most: are the axes swapped in the log or its profile?"
        case CommandsElsewhere(_, answers):
            moves = _moves(answers, ("excitation_x", "excitation_y"), ("delta_x", "delta_y"))
            return (
                f"the commands do not follow what was added to them: {moves}; check their signs and axes in the profile"
            )
        case WrongSigns(answers, logged):
            moves = _moves(answers, CYCLIC, RATES)
            return (
                f"the {'slow' if logged else 'fast'} answers have the wrong signs ({moves}): as if {_looks(answers)}; "
                "check the profile first"
            )
        case Mixed():
            return _mixed(suspicion)
        case NotSeparable(_, refusal):
            return f"these runs alone would be refused: {refusal}"
    assert_never(suspicion)


def listed_runs(ids: Sequence[str]) -> str:
    """Runs as people write them: `flight.BIN#1, #2`, the log named once."""
    words: list[str] = []
    last: str | None = None
    for run in ids:
        log, mark, number = run.rpartition("#")
        words.append(f"#{number}" if mark and log == last else run)
        last = log if mark else None
    return ", ".join(words)


def _error_in_band(finding: ErrorInBand) -> str:
    partly = ", among other things" if finding.follows_commands and finding.follows_something_else else ""
    where = f"{finding.axis}: {_percent(finding.error_share)} of the error sits in {_hertz(finding.band_hz)}"
    noise = f"Noise explains {_noise(finding.noise_share, finding.noise)}"
    if finding.distortion is not None:
        beyond = f"{_percent(finding.distortion)} is neither as in quiet hover nor linear in the commands"
        noise += f"; {beyond}: {NONLINEAR}, or rougher air"
    return f"{where}, {_cause(finding)}{partly}. {noise}."


def _cause(finding: ErrorInBand) -> str:
    """What the error follows, and what that tells."""
    together = finding.coherence_together
    if not finding.follows_commands:
        return f"hardly coherent with the commands ({together:.2f}): {_not_the_commands(finding)}"
    lacking = "are missing there" if finding.own_runs else "or their numbers are off there"
    if finding.command is not None:
        with_what = f"coherent with {finding.command} ({finding.coherence[finding.command]:.2f})"
    else:
        largest_first = sorted(finding.coherence.items(), key=lambda item: -item[1])
        listing = ", ".join(f"{name} {value:.2f}" for name, value in largest_first)
        with_what = f"coherent with the commands ({together:.2f}; {listing})"
    return f"{with_what}: linear dynamics {lacking}"


def _not_the_commands(finding: ErrorInBand) -> str:
    if finding.mixed:
        return "the runs do not agree"
    if finding.distortion is not None:
        return f"{NONLINEAR} rather than linear dynamics"
    return "most of it is noise" if finding.mostly_noise else f"{NONLINEAR}, or something that is not logged"


def _leaves_bounds(finding: LeavesBounds) -> str:
    where = " and ".join(_hertz(band) for band in finding.bands_hz)
    off = f"{finding.decibels:+.1f} dB and {finding.degrees:+.0f} degrees"
    pair = f"{finding.output} per {finding.command}"
    outside = f"the model's {pair} lies outside the bounds of the measured response in {where}"
    return f"{finding.axis}: {outside}, furthest at {finding.furthest_hz:.1f} Hz: {off}"


def _growth(finding: GrowsWithAmplitude) -> str:
    grows = finding.per_doubling > 1
    kind = "" if grows else " that counts most in small motion, as play does"
    factor = f"{'at least ' if finding.at_least else ''}x{finding.per_doubling:.1f} per doubling beyond the linear"
    sizes = f"{finding.command} {finding.low:.2g} to {finding.high:.2g} rms"
    way = "grows" if grows else "falls"
    return f"{finding.axis}: the error {way} with amplitude ({factor}, {sizes}): {NONLINEAR}{kind}"


def _condition(finding: GoesWithCondition) -> str:
    where = f"{CONDITIONS[finding.channel]} is {'high' if finding.factor > 1 else 'low'}"
    times = max(finding.factor, 1 / finding.factor)
    power = f"x{times:.1f} in power from {finding.low:.4g} to {finding.high:.4g}"
    return f"{finding.axis}: the error grows where {where} ({power})"


def _mixed(suspicion: Mixed) -> str:
    apart = [" against ".join(listed_runs(runs) for runs in groups) for groups in suspicion.apart]
    where = f" ({'; '.join(apart)})" if apart else ""
    look = "runs of different vehicles, gains or flight conditions"
    if suspicion.amplitudes:
        look += f", or {NONLINEAR}, as the amplitudes differ"
    return (
        f"{100 * suspicion.share:.0f} % of the {suspicion.axis} error goes away when every run may answer for "
        f"itself{where}: {look}; fit them apart and compare the numbers"
    )


def _looks(answers: Answers) -> str:
    (row, first), (_, second) = answers
    if row:
        return "rates and commands are " + ("swapped" if first == second else "turned by 90 degrees against each other")
    if first == second:
        return "rates and commands are turned by 180 degrees against each other"
    return f"the sign of {'p or of delta_x' if first < 0 else 'q or of delta_y'} is turned"


def _moves(answers: Answers, inputs: Sequence[str], outputs: Sequence[str]) -> str:
    return ", ".join(
        f"{name} moves {'-' if sign < 0 else ''}{outputs[row]}"
        for name, (row, sign) in zip(inputs, answers, strict=True)
    )


def _noise(share: float, noise: NoiseKnown) -> str:
    return f"{'at least ' if noise.at_least else ''}{_percent(share)} ({_noise_known(noise)})"


def _noise_known(noise: NoiseKnown) -> str:
    logged = "measured, and quiet hover agrees" if noise.quiet_agrees else "measured, the excitation is logged"
    return {
        "quiet hover": "measured from quiet hover",
        "logged excitation": logged,
        "commands": "feedback hides some of it, the excitation is not logged",
    }[noise.source]


def _percent(share: float) -> str:
    value = 100 * share
    return f"{value:.0f} %" if value >= 1 else "less than 1 %"


def _hertz(band: tuple[float, float]) -> str:
    return f"{band[0]:.2g}-{band[1]:.2g} Hz"

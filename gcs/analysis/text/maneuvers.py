"""What to fly or to log next, and why, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, assert_never

from gcs.analysis.quantities import quantity
from gcs.analysis.text.findings import listed_runs
from gcs.vehicle.sweeps import BY_STICK, how_to_fly
from sysid.diagnose.proposals import (
    FitRuns,
    FurtherApart,
    HalfAndFull,
    LinearHalves,
    LogChannels,
    LogSignal,
    MeasuredNotGuessed,
    SignalTells,
    Why,
)
from sysid.diagnose.rivals import NEEDED

if TYPE_CHECKING:
    from sysid.data.record import Record
    from sysid.diagnose.maneuver_plans import Plan
    from sysid.diagnose.next_maneuver import NextManeuver
    from sysid.diagnose.proposals import Proposal

SIGNALS = {
    "servo": "log the servo's position",
    "motors": "log the motors' speeds",
    "flapping": "measure the flapping (a and b)",
    "attitude": "log the attitude by another sensor than these gyros",
}
BY_HAND = {
    "delta_c": "the collective is moved gently",
    "r": "the pilot yaws to and fro, some 0.6 rad/s",
    "omega": "the rotor speed is changed by 4 % to and fro",
}
OFTEN = ("", "", " twice", " three times", " four times")
FAR = 100.0
"""Standard errors, above which a number says nothing more."""


def maneuver_text(plan: NextManeuver) -> str:
    """What to do next, and where that was flown already."""
    return proposal_text(plan.proposal) + (_flown_before(plan.why) if isinstance(plan.why, FurtherApart) else "")


def _flown_before(why: FurtherApart) -> str:
    """That it was flown already, in runs that are fitted, or that tell too little once they are."""
    if why.too_little is not None:
        runs, sigma = why.too_little
        few = f"{sigma:.1f} of {NEEDED:g} standard errors"
        return f", beside {listed_runs(runs)}, flown so, only judging, and telling too little ({few}): fit them too"
    return f", once more after {listed_runs(why.repeats)}" if why.repeats else ""


def proposal_text(proposal: Proposal) -> str:
    """`roll chirp 0.5-10 Hz, 30 s, amplitude 0.1 twice`."""
    match proposal:
        case HalfAndFull(full):
            half = full.amplitude / 2
            return f"{full.axis} chirps at half the amplitude ({half:.3g}) and at the flown one, twice each"
        case LogSignal(signal):
            return f"{SIGNALS[signal]}, and fly the same again"
        case LogChannels(channels):
            return f"log {' and '.join(channels)}, and fly the same again"
        case FitRuns(runs, maneuver, axis):
            which = "" if axis is None or maneuver == "unknown" else f" ({axis} {maneuver})"
            return f"use {listed_runs(runs)} in the fit too: they were flown already{which}, and only judge so far"
        case _:
            return _plan(proposal)


def how_text(proposal: Proposal, records: Sequence[Record]) -> str | None:
    """How whoever flew these runs flies it, where no card does; None where that is not known."""
    if isinstance(proposal, LogSignal | LogChannels | FitRuns):
        return None
    plan = proposal.full if isinstance(proposal, HalfAndFull) else proposal
    if plan.kind != "chirp":
        return BY_STICK.format(pulse_s=plan.pulse_s)
    ways = {
        how_to_fly(
            one,
            plan.axis,
            amplitude=plan.amplitude,
            band_hz=(plan.f_start_hz, plan.f_stop_hz),
            duration_s=plan.duration_s,
        )
        for one in records
    }
    return ways.pop() if len(ways) == 1 else None


def why_text(why: Why) -> str:
    """Why that would tell."""
    match why:
        case FurtherApart():
            return _further(why)
        case LinearHalves(share):
            return (
                "a linear error halves with the amplitude, a nonlinear one does not, and the repeats tell both from "
                f"noise; {100 * share:.0f} % of what is left now looks like a linear answer to the commands"
            )
        case SignalTells(sigma, same_whatever):
            alike = "whatever these inputs do, they answer alike"
            apart = f"{sigma:.0f} standard errors apart" if sigma < FAR else f"more than {FAR:g} standard errors apart"
            return f"{alike if same_whatever else 'no maneuver of a card does enough'}; that signal sets them {apart}"
        case MeasuredNotGuessed(rival):
            return f"{rival} is about it: measured, it is no longer to be guessed from the rates"
    assert_never(why)


def _plan(plan: Plan) -> str:
    band = f" {plan.f_start_hz:g}-{plan.f_stop_hz:g} Hz," if plan.kind == "chirp" else f" of {plan.pulse_s:g} s pulses,"
    larger = f" ({plan.times:g} times the flown one)" if plan.times != 1 else ""
    also = f", while {BY_HAND[plan.channel]}" if plan.by_hand and plan.channel is not None else ""
    size = f"amplitude {plan.amplitude:.3g}{larger}{OFTEN[plan.repeats]}{also}"
    return f"{plan.axis} {plan.kind}{band} {plan.duration_s:g} s, {size}"


def _further(why: FurtherApart) -> str:
    usual = f"; taken that it acts as usual ({', '.join(quantity(*each) for each in why.usual)})" if why.usual else ""
    rest = f"; {', '.join(why.rest)} would still look the same" if why.rest else ""
    apart = f"it sets them {why.sigma:.1f} standard errors of the noise further apart"
    return f"{apart}; these runs set them {why.before:.1f} apart{usual}{rest}"

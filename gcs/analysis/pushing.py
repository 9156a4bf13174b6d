"""May these gains be pushed? The one place that decides it, for the commands, the app and the demonstration.

What speaks against a push is said and stops it, unless words say why it is done all the same. First, before anything is
asked of the vehicle, what the gains are worth; then, on the vehicle, whether it is the one that was identified, as it
was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gcs.analysis.clearance import Clearance
from gcs.analysis.text.clearance import require_cleared
from gcs.flight.gains import Gains, GainsError, PushPlan, PushResult, planned_push, push, require_ready
from gcs.flight.identified import Objection, objections, same
from gcs.flight.rate_push import Held, RatePush, forget_behind, held, push_behind, push_directly, whole
from gcs.flight.rate_set import RateSet, SetBefore
from gcs.flight.session import Session
from gcs.link.events import float_of_bits
from gcs.vehicle.gain_switch import checksum as rates_checksum

FLYABLE = ("holds", "poor")
"""Verdicts of a design that refuse no push."""


class NotClearedError(GainsError):
    """Words why would let it pass."""


@dataclass(frozen=True, kw_only=True)
class ToPush:
    """A set that nothing speaks against so far, or of which somebody says why."""

    gains: Gains
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Pushed:
    """What was done, and what was known against it."""

    result: PushResult
    objections: tuple[Objection, ...]

    def to_json(self) -> dict[str, Any]:
        return self.result.to_json() | {"objections": [one.to_json() for one in self.objections]}


def to_push(gains: Gains, cleared: Clearance, why: str | None = None) -> ToPush:
    """Raises NotClearedError, reason `margins`, for gains that fail and of which nobody says why they are pushed."""
    try:
        require_cleared(cleared, why)
    except GainsError as error:
        raise NotClearedError(str(error), reason=error.reason) from error
    return ToPush(gains=gains, why=(why or "").strip())


def plan(session: Session, ready: ToPush) -> tuple[PushPlan, tuple[Objection, ...]]:
    """What a push would do, and what speaks against it; nothing is written and nothing refused."""
    return planned_push(session, ready.gains), objections(session, ready.gains.identified)


def push_judged(session: Session, ready: ToPush, on_progress: Callable[[str], None] = lambda _: None) -> Pushed:
    """The push. Raises NotClearedError where the vehicle is not as it was identified and nobody says why; as `push`."""
    require_ready(session)  # an armed vehicle, or one without a bank, is told as such first
    on_progress("asking whether it is the vehicle that was identified")
    found = objections(session, ready.gains.identified)
    require_none(found, ready.why)
    return Pushed(result=push(session, ready.gains, on_progress=on_progress), objections=found)


def require_none(found: Sequence[Objection], why: str) -> None:
    """Raises NotClearedError where something speaks against a push and nobody says why it is done all the same."""
    against = [one for one in found if one.refuses]
    if against and not why:
        raise NotClearedError(
            f"{'; '.join(one.words for one in against)}; nothing was written. Set the vehicle up as it was identified, "
            "or say --why",
            reason=against[0].kind,
        )


# ------------------------------------------------------------------------------------------------ a stock autopilot


@dataclass(frozen=True, kw_only=True)
class RatesToPush:
    """Rate gains on their way to a stock autopilot, and what speaks against them."""

    wanted: RateSet
    now: Held
    behind: bool
    """Whether they go behind the pilot's switch; else they fly from the next take-off."""
    objections: tuple[Objection, ...]

    @property
    def there(self) -> bool:
        """Whether the vehicle has them already."""
        bits = whole(self.wanted.new, self.now)
        if self.behind and self.now.switch is not None:
            values = tuple(float_of_bits(bits[name]) for name in bits)
            return self.now.switch.active == rates_checksum(values)
        return bits == self.now.bits


def rates_to_push(
    session: Session, wanted: RateSet, cleared: Clearance | None = None, *, for_good: bool = False
) -> RatesToPush:
    """What is there, and what speaks against it; nothing is written. `cleared`: the set judged anew, where its file
    holds models. `for_good`: past the switch.

    Raises GainsError for an armed vehicle and one without these parameters; ProcedureError, LinkError.
    """
    now = held(session, wanted.new)
    behind = now.switch is not None and not for_good
    found = [*_worth(wanted, cleared), *_switched(now, behind), *_flown(wanted, now)]
    found += objections(session, wanted.identified)
    return RatesToPush(wanted=wanted, now=now, behind=behind, objections=tuple(found))


def push_rates(
    session: Session,
    ready: RatesToPush,
    why: str | None,
    *,
    keep: Callable[[SetBefore], object],
    on_progress: Callable[[str], None] = lambda _: None,
) -> RatePush:
    """The push. Raises NotClearedError where something speaks against it and nobody says why; as `push_directly`."""
    require_none(ready.objections, (why or "").strip())
    if ready.behind:
        return push_behind(session, ready.wanted.new, ready.now, on_progress)
    if ready.now.switch is not None and ready.now.switch.active:
        on_progress("nothing is to be behind the switch")
        forget_behind(session)
    return push_directly(session, ready.wanted.new, ready.now, keep=keep, on_progress=on_progress)


def _worth(wanted: RateSet, cleared: Clearance | None) -> list[Objection]:
    if cleared is not None:
        try:
            require_cleared(cleared, None)
        except GainsError as error:
            return [Objection(kind="margins", words=str(error))]
        return []
    if wanted.verdict is None:
        words = "not judged: the file tells nothing of margins (the .json of `tippath design --for ardupilot` does)"
        return [Objection(kind="not judged", words=words)]
    if wanted.verdict in FLYABLE:
        return []
    why = "; ".join(wanted.against) or "as judged when they were designed"
    return [Objection(kind="margins", words=f"these gains are not cleared: {why}")]


def _switched(now: Held, behind: bool) -> list[Objection]:
    flies = "the new gains fly from the next take-off, and no hand takes them back in the air"
    if now.switch is None:
        put = "`tippath design --for ardupilot --script FILE` writes the script that holds both sets"
        return [Objection(kind="switch", words=f"no switch: {flies} ({put})")]
    if not behind:
        return [Objection(kind="switch", words=f"past the switch: {flies}")]
    if now.switch.channel is None:
        words = f"no channel has the switch's option {now.switch.option:g}: the new gains would never fly"
        return [Objection(kind="switch", words=words)]
    if now.switch.flies:
        return [Objection(kind="switch", words="the pilot's switch is high, and the set behind it flies: set it low")]
    return []


def _flown(wanted: RateSet, now: Held) -> list[Objection]:
    """Where the settings of the fit's logs are known these gains are among them."""
    if wanted.identified is not None and wanted.identified.parameters:
        return []
    if wanted.flown is None:
        words = "gains: those that they were designed from are not known"
        return [Objection(kind="gains", words=words, refuses=False)]
    values = now.values
    other = [f"{n} was {was:g}, is {values[n]:g}" for n, was in wanted.flown.items() if not same(was, values[n])]
    return [Objection(kind="gains", words=f"gains: not as flown: {'; '.join(other)}")] if other else []

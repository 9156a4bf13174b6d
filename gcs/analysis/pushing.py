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
from gcs.analysis.text.clearance import failing_words
from gcs.flight.gains import Gains, GainsError, PushPlan, PushResult, planned_push, push, require_ready
from gcs.flight.identified import Objection, objections
from gcs.flight.session import Session


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
    said = (why or "").strip()
    if cleared.judgement.verdict == "fails" and not said:
        raise NotClearedError(
            f"these gains are not cleared: {failing_words(cleared.judgement)}; nothing was sent. Design others (a "
            "higher --input-cost leaves more), or say --why",
            reason="margins",
        )
    return ToPush(gains=gains, why=said)


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

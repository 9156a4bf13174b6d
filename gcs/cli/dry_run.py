"""What --dry-run prints: what would have been done, after every question and check."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gcs.cli.options import print_json

if TYPE_CHECKING:
    from gcs.flight.gains import PushPlan
    from gcs.flight.identified import Objection
    from gcs.flight.prepare import Prepared
    from gcs.flight.resume import Earlier
    from gcs.flight.session import Session

SAID = "nothing was sent but questions"


def print_push(plan: PushPlan, objections: Sequence[Objection], *, as_json: bool) -> None:
    """Which values of the active bank would become others, and what speaks against it."""
    from gcs.flight.gains import checksum  # as in every command

    if as_json:
        print_json(plan.to_json() | {"objections": [one.to_json() for one in objections]})
        return
    for one in objections:
        print(f"{'a push is refused without --why: ' if one.refuses else ''}{one.words}")
    if not plan.changes:
        print(f"the vehicle has this set already ({checksum(plan.crc)}); a push would write nothing; {SAID}")
        return
    print(f"a push would commit {checksum(plan.crc)} in place of {checksum(plan.active_crc)}; {SAID}")
    for name, (now, then) in plan.changes.items():
        print(f"  {name:6} {'-' if now is None else f'{now:.6g}':>12} -> {then:.6g}")


def print_revert(crc: int, *, as_json: bool) -> None:
    """Which bank a revert would leave."""
    from gcs.flight.gains import checksum

    if as_json:
        about = {"dry_run": True, "reverted_crc": crc, "reverted_checksum": checksum(crc)}
        print_json({"format": "tippath.revert/1", **about})
        return
    print(f"a revert would leave {checksum(crc)} for the set before it, which the vehicle does not name; {SAID}")


def print_sweep(session: Session, ready: Prepared, earlier: Earlier | None, *, as_json: bool) -> None:
    """The runs as this vehicle would fly them, or those that are left of an earlier flight, each parameter that would
    become another, and what it does when it no longer hears this station.

    Raises as `gcs.flight.settings.read_settings`, and TippathError where another vehicle flew that flight.
    """
    from gcs.cards.maneuver import duration_s
    from gcs.flight.connection import WallClock
    from gcs.flight.resume import require_same_vehicle
    from gcs.flight.settings import read_settings
    from gcs.vehicle.autopilots import link_loss

    parameters = read_settings(session, WallClock(), ready.profile)
    answer = link_loss(parameters, session.station).words
    if earlier is not None:
        require_same_vehicle(earlier, session.snapshot(), ready.profile)
    left = ready.card.runs() if earlier is None else earlier.left
    plans = [(run, ready.profile.plan(run.maneuver)) for run in left]
    if as_json:
        runs: list[dict[str, Any]] = [
            {"label": run.label, "flew": plan.words, "parameters": dict(plan.writes)} for run, plan in plans
        ]
        about = {"card": ready.card.name, "left_out": list(ready.left_out), "planned": len(runs), "runs": runs}
        about |= {"now": dict(parameters), "link_loss": answer}
        folder = None if earlier is None else str(earlier.folder.path)
        print_json({"format": "tippath.sweep/1", "dry_run": True, "folder": folder, "complete": None, **about})
        return
    print(f" card {ready.card.name}: {len(plans)} runs, about {duration_s(left, ready.card.rest_s):.0f} s; {SAID}")
    for words in ready.left_out:
        print(f"   left out: {words}")
    held = dict(parameters)
    for run, plan in plans:
        print(f"   {run.label}: {plan.words}")
        changes = [
            f"{name} {_now(held.get(name))} -> {value:g}" for name, value in plan.writes if held.get(name) != value
        ]
        held.update(plan.writes)
        print(f"     {'; '.join(changes) or 'as the run before it'}")
    print(f"   {answer}")
    print("   the log and the hover are looked at only once a log is asked for, at the start")


def _now(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"

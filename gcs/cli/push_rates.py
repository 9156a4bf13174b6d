"""`tippath push` and `tippath revert` of a stock autopilot's rate gains."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from gcs.cli.options import parse_words

if TYPE_CHECKING:
    from gcs.analysis.pushing import RatesToPush
    from gcs.flight.rate_push import RatePush


def run(args: argparse.Namespace, station: dict[str, Any]) -> int:
    """The push; `station` is how this one takes part in the link."""
    from gcs.analysis.clearance import cleared_again
    from gcs.analysis.pushing import push_rates, rates_to_push
    from gcs.analysis.text.clearance import clearance_text
    from gcs.flight.folder import keep
    from gcs.flight.rate_set import SetBefore, load_rate_set
    from gcs.flight.session import Session

    wanted = load_rate_set(args.gains)
    cleared = cleared_again(args.gains, parse_words(args.effects)) if wanted.has_models else None
    if cleared is not None:
        print(clearance_text(cleared), file=sys.stderr)
    place = args.gains.with_name(f"{args.gains.stem}.before.json")
    kept: list[str] = []

    def keep_before(before: SetBefore) -> None:
        kept.append(str(keep(before.to_json(), place)))

    with Session.open(args.connect, **station) as session:
        ready = rates_to_push(session, wanted, cleared, for_good=args.for_good)
        for one in ready.objections:
            _say(one.words)
        if args.dry_run or ready.there:
            _print_plan(ready, as_json=args.json, dry=args.dry_run)
            return 0
        result = push_rates(session, ready, args.why, keep=keep_before, on_progress=_say)
    _print_result(result, ready, kept[0] if kept else None, args)
    return 0


def _say(words: str) -> None:
    print(f" {words}", file=sys.stderr)


def _told(ready: RatesToPush) -> dict[str, Any]:
    return {"objections": [one.to_json() for one in ready.objections]}


def _print_plan(ready: RatesToPush, *, as_json: bool, dry: bool) -> None:
    """What a push would write, or that there is nothing to write."""
    from gcs.flight.identified import same

    values, new = ready.now.values, {} if ready.there else ready.wanted.new
    changes = {name: (values[name], value) for name, value in new.items() if not same(values[name], value)}
    if as_json:
        about: dict[str, Any] = {"format": "tippath.push/1", "committed": False, "behind_switch": ready.behind}
        about |= {"dry_run": True} if dry else {}
        about |= {"changes": {name: {"now": now, "then": then} for name, (now, then) in changes.items()}}
        print(json.dumps(about | _told(ready), indent=2, allow_nan=False))
        return
    if ready.there:
        print("the vehicle has this set already; nothing was written")
        return
    print(
        f"a push would write these {'behind the switch' if ready.behind else 'gains'}; nothing was sent but questions"
    )
    for name, (now, then) in changes.items():
        print(f"  {name:20} {now:12.6g} -> {then:.6g}")


def _print_result(result: RatePush, ready: RatesToPush, kept: str | None, args: argparse.Namespace) -> None:
    if args.json:
        told = {"kept": kept, "why": args.why} | _told(ready)
        print(json.dumps(result.to_json() | told, indent=2, allow_nan=False))
        return
    print(f"{len(result.now)} of {len(result.now)} values read back equal")
    for name, now in result.now.items():
        print(f"  {name:20} {result.before[name]:12.6g} -> {now:.6g}")
    if result.behind is not None:
        print(f"they fly while the switch on channel {result.behind.channel} is high, and was low before")
        print("`tippath revert` forgets them; the old set is the autopilot's own all the time")
    else:
        print(f"they fly from the next take-off; `tippath revert {kept}` puts the old ones back")


def revert(args: argparse.Namespace, station: dict[str, Any]) -> int:
    """By a file that a push kept."""
    from gcs.flight.identified import same
    from gcs.flight.rate_push import held, put_back
    from gcs.flight.rate_set import load_before
    from gcs.flight.session import Session

    before = load_before(args.before)
    with Session.open(args.connect, **station) as session:
        if args.dry_run:
            values = held(session, before.before).values
            changed = {name: value for name, value in before.before.items() if not same(values[name], value)}
        else:
            changed = put_back(session, before, anyway=bool((args.why or "").strip()))
    if args.json:
        about: dict[str, Any] = {"format": "tippath.revert/1", "parameters": changed}
        print(json.dumps(about | ({"dry_run": True} if args.dry_run else {}), indent=2, allow_nan=False))
        return 0
    done = "would be put back" if args.dry_run else "put back, read back equal"
    print(f"{len(changed)} of {len(before.before)} gains {done}")
    for name, value in changed.items():
        print(f"  {name:20} {value:.6g}")
    return 0

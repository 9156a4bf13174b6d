"""A checker of the rules of `gcs.flight.rules`: histories of messages between the real engine and a model vehicle.

In a history everything of the ground is the real code: `gcs.link.clock`, `gcs.vehicle.snapshot.reduce`, the procedures,
and `gcs.flight.sweep` with the settings and the runs of a card. The vehicle, its pilot, other stations and the link are
a model here, in fake time, and the rules are judged from what happened, not from what the ground believed:

- **write**: no parameter that we wrote reaches a vehicle that one of our starts excites, but for a magnitude of 0
  that somebody wanted sent to a vehicle that is not heard, and that only while it is not; none is written by us that
  makes axis and magnitude a dangerous pair; what is in the vehicle when our start excites it is what was shown.
- **clear**: `cleared` is never true while the vehicle is excited by us, or a start of ours is under way; nor in a
  silence, nor after one without a look of some seconds, nor while the vehicle's last word is that it starts.
- **end**: at the end the vehicle is not excited by us, and no start of ours is under way, or the words say that it is
  not known; three heartbeats that show the excitation after its run was to end are answered with an order at least;
  where nothing was said to the contrary the vehicle has its own settings again.
- **order**: no mode but the excitation's and the one before is asked for; the one before only while the last heartbeat
  that can tell shows the excitation and the link is heard; a mode of the pilot's or a failsafe's is not talked over.
- **start**: the excitation is asked for only while the last heartbeat shows the mode before, over a link whose lag is
  known and short; no more once the vehicle said that it starts, nor after a silence of the link or of ourselves.
- **run on**: a run whose log is dead (or, where that stays on the vehicle's card, its telemetry), whose link is late,
  or whose vehicle does not answer is ended within seconds, as long as anything is heard.
- **flown**: a run that ends as finished was flown by the vehicle for as long as it takes, by the settings that were
  shown: as far as the vehicle told of others, and where its log stays on the card of those that it began with.
- **hang**: every history ends.

The link keeps what `gcs.link.clock` takes for granted, and no more: each way is a queue that holds everything back by
up to 10 s, in steps and bursts, loses by chance or for a time, repeats, and swaps what is sent less than `SWAP_S`
apart.

A second vehicle with the same id sends heartbeats that nobody can tell from the vehicle's own. Where all of the
vehicle's own that could have told were lost meanwhile, nobody can know better: such a breach of **clear**, **write** or
**end** is counted as `excused`, not as broken. The other rules hold as they are.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import math
import random
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

import gcs.flight.sweep
import gcs.link.clock
from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver, TestCard
from gcs.errors import TippathError
from gcs.flight.card_recording import Attitudes
from gcs.flight.live import LiveWindow
from gcs.flight.log_health import Capacity
from gcs.flight.preflight import LAG_LIMIT_S
from gcs.flight.recorder import RecordingSummary
from gcs.flight.resume import FlownBefore
from gcs.link.clock import LOST_AFTER_S, SWAP_S
from gcs.link.encode import DO_SET_MODE, BlockStatus, Command, ParamRead, ParamWrite, Ping, Send
from gcs.link.events import (
    Attitude,
    CommandAck,
    Event,
    Heartbeat,
    LogBlock,
    ParamValue,
    StatusText,
    TimeReply,
    bits_of_float,
    float_of_bits,
)
from gcs.link.procedures import NoAnswerError
from gcs.vehicle.autopilots import LinkLoss
from gcs.vehicle.profile import VehicleProfile, bundled_profiles
from gcs.vehicle.snapshot import Text, VehicleSnapshot, reduce

STABILIZE, ACRO, ALT_HOLD, RTL, EXCITED = 0, 1, 2, 6, 25
POLL_S = 0.05
CLOSE_S = 0.4
"""A link on which something is heard at least so often is heard without a break."""
TWIN_AHEAD_S = 40.0
LATE_S = 1.2
"""Truly later than this is beyond the limit, whatever the two clocks' offset was mistaken by."""
LONGEST_S = 900.0
LOOKED_S = 3.5
"""So long at least a vehicle is looked at after a silence before it is taken for cleared."""
ONE_WAY_S = 8.0
"""A link on which no question was answered for so long carries one way."""
FIRST_START_S = 4.5
"""About when the first start is due."""
NOT_KNOWN = ("not known", "does not tell", "must take it", "tippath abort", "could not be told")
FLOWN = (
    Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=1.5, f_start_hz=2.0),
    Maneuver(kind="doublet", axis="pitch", amplitude=0.6, duration_s=1.5, target="rate"),
    Maneuver(kind="chirp", axis="pitch", amplitude=0.3, duration_s=1.5, f_start_hz=2.5),
    Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=12.0, f_start_hz=2.0),
)
OWN_SETTINGS = ((0.0, 15.0), (10.0, 0.05), (7.0, 40.0), (0.0, 0.0), (11.0, 0.5), (10.0, 15.0))
"""Axis and magnitude that a user may have left in the vehicle; the third is harmless on its own axis only, the last
on none."""


# ------------------------------------------------------------------------------------------------ a history


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One direction of the link. Times are s since the history's origin; before it, and before the first, the base."""

    delay_s: float = 0.05
    loss: float = 0.0
    delays: tuple[tuple[float, float], ...] = ()
    """From when on, how long."""
    losses: tuple[tuple[float, float], ...] = ()
    outages: tuple[tuple[float, float], ...] = ()
    """From, to: everything that is sent is lost."""
    repeats: float = 0.0
    """Share of what is sent twice."""
    swaps: float = 0.0
    """Share of what enters the queue late, by less than `SWAP_S`."""


@dataclass(frozen=True, slots=True)
class Act:
    """What somebody does, or what happens: see `World`."""

    at_s: float
    what: str
    value: float = 0.0
    more: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """Everything that decides what happens; the same history happens the same way again."""

    seed: int = 0
    """Of the chances of single messages."""
    origin: str = "start"
    """What the times count from: the first `start` that is asked for, or about then since the `begin`ning."""
    up: Way = Way()
    down: Way = Way()
    acts: tuple[Act, ...] = ()
    runs: tuple[int, ...] = (0,)
    """Which of `FLOWN`."""
    own: int = 0
    """Which of `OWN_SETTINGS`."""
    mode_before: int = STABILIZE
    tick_s: float = 0.1
    attitude_s: float = 0.25
    failsafe_s: float = math.inf
    """The vehicle goes to RTL after so long without a word from the ground."""
    refuses: bool = False
    never_leaves: bool = False
    shows_at_once: bool = True
    """A heartbeat at every change of mode."""
    stop_s: float = 1.0
    """How long the end of the recording takes."""
    whole: bool = False
    """Through `fly_card`, with all that comes before the first run."""
    card: bool = False
    """The log stays on the vehicle's card: attitudes stand for it, and an act `log` silences those."""


def random_history(seed: int, *, whole: bool = False) -> History:
    """Some history; most begin on a good link, because nothing is started on another."""
    chance = random.Random(seed)
    kind = chance.choice(("wild", "wild", "people", "people", "late"))
    up, down = (
        {"wild": _wild, "people": _mild, "late": _late}[kind](chance),
        (_wild if kind == "wild" else _mild)(chance),
    )
    acts = chance.choice((0, 0, 1, 1, 2, 3) if kind == "wild" else (1, 1, 2, 3, 4))
    return History(
        seed=seed,
        origin="start" if chance.random() < 0.7 else "begin",
        up=up,
        down=down,
        acts=tuple(_random_act(chance) for _ in range(acts)),
        runs=tuple(chance.sample((0, 1, 2), chance.choice((2, 3) if whole else (1, 1, 1, 2))))
        if chance.random() < 0.8
        else (3,),
        own=chance.randrange(len(OWN_SETTINGS)),
        mode_before=chance.choice((STABILIZE, STABILIZE, ACRO)),
        tick_s=chance.choice((0.1, 0.25, 0.4)),
        attitude_s=chance.choice((0.25, 0.5, 1.0)),
        failsafe_s=chance.choice((math.inf, math.inf, 5.0)),
        refuses=chance.random() < 0.03,
        never_leaves=chance.random() < 0.02,
        shows_at_once=chance.random() < 0.7,
        stop_s=chance.choice((0.5, 1.0, 4.0, 15.0)),
        whole=whole,
    )


def hard_history(seed: int) -> History:
    """A random history with what the others have seldom: strangers and silences about the end of a run, while half of
    the vehicle's own words are lost, and a vehicle that accepts the way back and stays."""
    chance = random.Random(-1 - seed)
    history = random_history(seed)
    down = replace(history.down, loss=chance.choice((0.2, 0.4, 0.5)))
    acts = [
        Act(chance.uniform(-1, 35), "stranger", chance.choice((history.mode_before, RTL, EXCITED)), 8)
        for _ in range(chance.choice((1, 1, 2)))
    ]
    for what in chance.sample(("stall", "reboot", "mode", "abort"), chance.choice((0, 1, 2))):
        value = {"stall": chance.choice((2.0, 5.0)), "mode": chance.choice((STABILIZE, RTL, EXCITED))}.get(what, 0.0)
        acts.append(Act(chance.uniform(0, 15), what, value))
    return replace(history, down=down, acts=(*history.acts, *acts), never_leaves=chance.random() < 0.2)


def blind_history(seed: int) -> History:
    """A random or a hard history in which the vehicle is silent for a while, and somebody wants an end sent unheard."""
    chance = random.Random(f"blind {seed}")
    history = hard_history(seed) if seed % 3 == 0 else random_history(seed, whole=seed % 3 == 1)
    begin = chance.choice((0.5, chance.uniform(0, 3), chance.uniform(0, 20)))
    outage = (begin, begin + chance.choice((5.0, 12.0, 30.0, 90.0)))
    up = chance.choice((Way(), history.up, replace(history.up, repeats=0.3, delays=((begin, chance.uniform(0, 9)),))))
    acts = (Act(begin + chance.uniform(-1, 5), "abort"), Act(begin + chance.uniform(0, 8), "blind"))
    down = replace(history.down, outages=(outage, *history.down.outages))
    return replace(history, origin="start", up=up, down=down, acts=(*history.acts, *acts[chance.choice((0, 0, 1)) :]))


def card_history(seed: int) -> History:
    """A random or a hard history without the log's stream."""
    history = hard_history(seed) if seed % 3 == 0 else random_history(seed, whole=seed % 3 == 1)
    return replace(history, card=True, attitude_s=0.1 if history.whole else history.attitude_s)


def twin_history(seed: int) -> History:
    """A random history with a second vehicle of the same id, which says when it says something."""
    chance = random.Random(f"twin {seed}")
    history = random_history(seed)
    acts = [
        Act(chance.uniform(-1, 20), "twin", chance.choice((history.mode_before, RTL, EXCITED)), chance.choice((2, 8)))
        for _ in range(chance.choice((1, 1, 2)))
    ]
    return replace(history, acts=(*history.acts, *acts))


def _wild(chance: random.Random) -> Way:
    """Everything that a link may do."""
    span = chance.choice((2.0, 8.0, 25.0))

    def moment() -> float:
        return chance.choice((0.0, -0.001, chance.uniform(0, span), chance.uniform(0, span), chance.uniform(-3, 0)))

    def delay() -> float:
        return chance.choice((0.02, 0.2, chance.uniform(0.3, 1.0), chance.uniform(1, 4), chance.uniform(4, 10)))

    delays = tuple(sorted((moment(), delay()) for _ in range(chance.choice((0, 1, 2, 3, 6)))))
    losses = tuple(sorted((moment(), chance.choice((0.0, 0.2, 0.4, 0.6))) for _ in range(chance.choice((0, 0, 1, 2)))))
    outages = []
    for _ in range(chance.choice((0, 0, 1, 1, 2))):
        begin, longest = moment(), chance.choice((1.0, 2.5, 5.0, 12.0, 40.0, 90.0))
        outages.append((begin, begin + longest * chance.uniform(0.6, 1.0)))
    return replace(_mild(chance), delays=delays, losses=losses, outages=tuple(outages))


def _mild(chance: random.Random) -> Way:
    """Fit to fly on, most of the time: what people do decides."""
    return Way(
        delay_s=chance.choice((0.02, 0.05, 0.1, 0.2)),
        loss=chance.choice((0.0, 0.0, 0.1, 0.3, 0.5)),
        repeats=chance.choice((0.0, 0.0, 0.1, 0.3)),
        swaps=chance.choice((0.0, 0.0, 0.1, 0.3)),
    )


def _late(chance: random.Random) -> Way:
    """What is sent about the start arrives late, or the second or third time."""
    delays = ((-0.001, chance.uniform(0.5, 9.0)), (chance.uniform(0.5, 9.0), 0.05))
    lost = (-0.001, chance.choice((0.4, 0.8))), (chance.uniform(0.5, 3.0), 0.0)
    return replace(_mild(chance), delays=delays, losses=lost if chance.random() < 0.4 else ())


_ACTS = (
    *("mode",) * 4,
    *("stranger", "abort", "stall") * 2,
    *("write", "log", "lean", "reboot", "interrupt", "tilt", "refuse"),
)


def _random_act(chance: random.Random) -> Act:
    at_s = chance.choice((chance.uniform(-2, 1), chance.uniform(0, 1), chance.uniform(0, 8), chance.uniform(0, 30)))
    what = chance.choice(_ACTS)
    match what:
        case "mode":
            return Act(at_s, what, chance.choice((STABILIZE, STABILIZE, ALT_HOLD, RTL, EXCITED, ACRO)))
        case "stranger":
            return Act(at_s, what, chance.choice((STABILIZE, RTL, EXCITED)), chance.choice((1, 2, 8)))
        case "write":
            return Act(at_s, what, chance.choice((0.0, 0.15, 15.0)), chance.choice((0, 1)))
        case "stall":
            return Act(at_s, what, chance.choice((1.0, 2.0, 5.0, 20.0)))
        case "log":
            return Act(at_s, what, chance.choice((1.0, 3.0, math.inf)))
        case _:
            return Act(at_s, what)


# ------------------------------------------------------------------------------------------------ the code under test

MODULES = (
    "gcs.link.clock",
    "gcs.flight.settings",
    "gcs.flight.run_state",
    "gcs.flight.rules",
    "gcs.flight.excitation",
    "gcs.flight.run",
    "gcs.flight.flown_card",
    "gcs.flight.handback",
    "gcs.flight.sweep",
)
"""In the order in which they import each other."""


@dataclass(frozen=True, slots=True)
class Code:
    """The modules that a history runs through: the real ones, or with a rule removed."""

    clock: Any
    sweep: Any


REAL = Code(gcs.link.clock, gcs.flight.sweep)


@dataclass(frozen=True, slots=True)
class Mutation:
    """One rule removed: the text in the module, and what stands there instead."""

    name: str
    text: str
    instead: str
    beside: str = ""
    """What else holds the rule, where no history shows that this guard is gone."""


def mutated(*mutations: Mutation) -> Code:
    """The code with these rules removed. Raises ValueError where a text is not in the modules exactly once."""
    kept = {name: sys.modules[name] for name in MODULES}
    parents = {name: name.rpartition(".")[0] for name in MODULES}
    sources = _sources(mutations)
    made = []
    try:
        for name in MODULES:
            module = ModuleType(name)
            module.__file__ = kept[name].__file__
            sys.modules[name] = module
            exec(_compiled(name, sources[name]), module.__dict__)
            made.append(module)
    finally:
        for name, module in kept.items():
            sys.modules[name] = module
            setattr(sys.modules[parents[name]], name.rpartition(".")[2], module)
    return Code(made[0], made[-1])


def _sources(mutations: Sequence[Mutation]) -> dict[str, str]:
    sources = {name: Path(str(sys.modules[name].__file__)).read_text("utf-8") for name in MODULES}
    for mutation in mutations:
        times = guards(mutation, sources)
        if times != 1:
            raise ValueError(f"{mutation.name}: its text is there {times} times")
        sources = {name: source.replace(mutation.text, mutation.instead) for name, source in sources.items()}
    return sources


def guards(mutation: Mutation, sources: Mapping[str, str] | None = None) -> int:
    """How often a mutation's text is in the modules: once, or it is no mutation any more."""
    return sum(source.count(mutation.text) for source in (sources or _sources(())).values())


@cache
def _compiled(name: str, source: str) -> CodeType:
    return compile(source, f"{name}, mutated", "exec")


MUTATIONS = tuple(
    Mutation(*row)
    for row in (
        ("an early word finishes a run", "            if early_s > EARLY_S:", "            if False:"),
        ("stamps that ran ahead finish a run", "over_s < seen.sweep_s <= since + LATE_S", "over_s < seen.sweep_s"),
        ("a link of one way counts against stuck", "- since > LOST_PATIENCE_S", "- since > STUCK_S"),
        (
            "a link of one way is waited for without end",
            "    if _deaf(seen):\n        return seen.now - since > LOST_PATIENCE_S\n",
            "",
        ),
        ("time without answers counts against stuck", "max(since, state.deaf_until)", "since"),
        ("one that shows itself excited counts as silent", "if not state.excited and waited > ", "if waited > "),
        ("what the vehicle tells of settings is not heard", "if (flying or awaited) and ", "if False and "),
        (
            "settings are not asked for where the log stays on the card",
            "if flown and log is not None and log.on_card:",
            "if False:",
        ),
        (
            "settings that were not told of are as planned",
            "if not interruption and flown.unanswered_settings:",
            "if False:",
        ),
        (
            "settings told of after the end change nothing",
            "if ending is Ending.FINISHED and flown.other_settings:",
            "if False:",
        ),
        (
            "a heartbeat from before the start is believed",
            "if state.asks and not state.confirmed and beat.mode == state.mode_before and beat.known_s",
            "if False and beat.known_s",
        ),
        (
            "one other heartbeat is a takeover in flight",
            "    if state.others > 1:\n        return _leave(_end(",
            "    if state.others > 0:\n        return _leave(_end(",
        ),
        ("no takeover in flight", "    if state.others > 1:\n", "    if False:\n"),
        (
            "one other heartbeat is a return",
            "if state.others > 1 and seen.heartbeats > state.fresh_after:",
            "if state.others > 0 and seen.heartbeats > state.fresh_after:",
        ),
        (
            "one other heartbeat does not suspend the orders",
            "return replace(state, excited=False, others=state.others + 1,",
            "return replace(state, excited=state.excited and not state.others, others=state.others + 1,",
        ),
        (
            "two in a row need not be in a row",
            "            others=0,\n            mode_shown",
            "            mode_shown",
        ),
        (
            "time without a link counts against stuck",
            "since = max(state.returning_since, state.heard_since)",
            "since = state.returning_since",
            "without a link there are no answers either, and until they come no time counts",
        ),
        (
            "our own silence counts against stuck",
            "if state.heard_since == UNKNOWN or silent:",
            "if state.heard_since == UNKNOWN or lost:",
        ),
        ("cleared without proof", " and state.known_s >= state.ordered_at:", ":"),
        (
            "an old heartbeat with another mode stops nothing",
            "proved_at=None) if beat.mode == plan.mode else replace(state, excited=False)",
            "proved_at=None) if beat.mode == plan.mode else state",
        ),
        (
            "an old heartbeat with the excitation interrupts nothing",
            "return replace(state, others=0, proved_at=None) if beat.mode == plan.mode else replace(state",
            "return state if beat.mode == plan.mode else replace(state",
        ),
        (
            "a proof outlives a silence",
            "state = _unproved(replace(state, settled_at=seen.now + SETTLE_S, excited=False, accepted_after=None))",
            "state = replace(state, settled_at=seen.now + SETTLE_S, excited=False, accepted_after=None)",
        ),
        (
            "a late start's own word does not undo the proof",
            "    if any(text.startswith(STARTING) for text in seen.texts):\n        state",
            "    if False:\n        state",
        ),
        ("an acceptance that changed nothing is believed", "state.accepted == 1 and", "state.accepted and"),
        (
            "cleared at once after a silence",
            " and state.heard_since <= state.left_at\n",
            "\n",
        ),
        ("cleared against the vehicle's own log", "if looked and seen.log_mode != plan.mode:", "if looked:"),
        (
            "cleared at once without a word of the log",
            "not state.asks or (ours and seen.log_mode is not None)",
            "not state.asks or ours",
        ),
        (
            "cleared with the start's proof alone",
            "return max(self.asked_at, self.returned_at, self.stilled_at)",
            "return max(self.asked_at, self.stilled_at)",
        ),
        (
            "cleared before what was sent unheard has come",
            "return max(self.asked_at, self.returned_at, self.stilled_at)",
            "return max(self.asked_at, self.returned_at)",
            "a link keeps the order of what is sent: what is written later also arrives later",
        ),
        (
            "sent unheard although it is heard",
            "if seen.blind and seen.lost and state.asks",
            "if seen.blind and state.asks",
        ),
        ("sent unheard unasked", "if seen.blind and seen.lost and state.asks", "if seen.lost and state.asks"),
        (
            "contradictions are not looked at",
            "look_s = 0.0 if not state.asks or (ours and seen.log_mode is not None) else LOOK_S",
            "look_s = 0.0",
        ),
        (
            "shown again after it left, and left alone",
            "    if state.excited:\n        again",
            "    if False:\n        again",
        ),
        (
            "started right after a write",
            "RunState(mode_before=mode_before, settled_at=clock.now() + SETTLE_S)",
            "RunState(mode_before=mode_before)",
        ),
        (
            "old heartbeats are believed after a silence",
            "if now >= state.settled_at or (age_s is not None and age_s <= FRESH_S):",
            "if True:",
        ),
        (
            "after a silence the word from before it counts",
            "settled_at=seen.now + SETTLE_S, excited=False, accepted_after=None)",
            "settled_at=seen.now + SETTLE_S)",
        ),
        (
            "after a silence the accepted start still counts",
            "settled_at=seen.now + SETTLE_S, excited=False, accepted_after=None)",
            "settled_at=seen.now + SETTLE_S, excited=False)",
        ),
        (
            "an acceptance heard after a silence counts",
            "accepted_after=seen.heartbeats if seen.now >= state.settled_at and not state.others else None,",
            "accepted_after=None if state.others else seen.heartbeats,",
        ),
        (
            "a heartbeat beside the acceptance is not heard",
            "accepted_after=seen.heartbeats if seen.now >= state.settled_at and not state.others else None,",
            "accepted_after=seen.heartbeats if seen.now >= state.settled_at else None,",
        ),
        (
            "a heartbeat ages only on its way",
            "else beat.late_s + now - beat.at_s",
            "else beat.late_s",
        ),
        (
            "a silence between two ticks is not seen",
            "lost = seen.lost or heard_at - state.heard_at > LOST_AFTER_S",
            "lost = seen.lost",
        ),
        (
            "a silence between two ticks does not end a run",
            "    if state.lost_since is not None:\n        return Ending.LINK",
            "    if seen.lost:\n        return Ending.LINK",
        ),
        ("our own silence is none", "silent = lost or seen.now - state.ticked_at > STALL_S", "silent = lost"),
        ("asked again after a silence", "if wanted is None and state.settled_at > state.asked_at:", "if False:"),
        ("asked again although it started", "if state.confirmed or started or (", "if ("),
        (
            "asked again where it started and left",
            "if state.confirmed or started or (",
            "if state.excited or started or (",
        ),
        ("started with an unknown lag", "elif wanted is None and seen.lag_s is None:", "elif False:"),
        (
            "started on a late link",
            "elif wanted is None and seen.lag_s is not None and seen.lag_s > LAG_LIMIT_S:",
            "elif False:",
        ),
        (
            "started right after a silence",
            "    if seen.now < state.settled_at:\n        return",
            "    if False:\n        return",
        ),
        (
            "started from the pilot's other mode",
            "    elif wanted is None and seen.mode != state.mode_before:",
            "    elif False:",
        ),
        (
            "started where somebody excites it already",
            "    if seen.mode == plan.mode:\n        wanted = Ending.PILOT",
            "    if False:\n        wanted = Ending.PILOT",
            "any mode but the one before forbids the start; this guard only has better words",
        ),
        (
            "asked again in the pilot's other mode",
            "if wanted is None and seen.mode not in (state.mode_before, plan.mode):",
            "if False:",
        ),
        ("a late link does not end a run", "if state.late_since is not None and seen", "if False and seen"),
        (
            "a lag that is not known is none",
            "late = state.late_since is not None if seen.lag_s is None else seen.lag_s > LAG_LIMIT_S",
            "late = seen.lag_s is not None and seen.lag_s > LAG_LIMIT_S",
        ),
        ("a dead log does not end a run", "if state.log_silent_since is not None and seen", "if False and seen"),
        (
            "no answers do not end a run",
            "    if _deaf(seen):\n        return Ending.LINK",
            "    if False:\n        return Ending.LINK",
        ),
        (
            "a lost link does not end a run",
            "    if state.lost_since is not None:\n        return Ending.LINK",
            "    if False:\n        return Ending.LINK",
            "a run without answers ends as well; so does a start after a silence",
        ),
        ("nobody's wish ends a run", "if seen.abort is not None:", "if False:"),
        ("no limit ends a run", "if seen.violations:", "if False:"),
        ("an accepted way back is asked for again", "max(state.fresh_after, state.held)", "state.fresh_after"),
        (
            "an ordinary end does not wait",
            "fresh_after=seen.heartbeats if patient else seen.heartbeats - 1,",
            "fresh_after=seen.heartbeats - 1,",
        ),
        (
            "the way back is asked for on the start's word again and again",
            "(newly_started and state.held < 0)",
            "newly_started",
        ),
        (
            "the way back is one mode for all",
            "proved_at=None), Order(state.mode_before)",
            "proved_at=None), Order(0)",
        ),
        ("no end where nothing is known", "    if not state.excited and waited > UNKNOWN_S:", "    if False:"),
        (
            "axis and magnitude in any order",
            "    if not profile.dangerous(after.axis, before.magnitude):",
            "    if True:",
        ),
        ("an unanswered write counts as not done", "        now[name] = math.nan\n", ""),
        (
            "a dangerous magnitude is put back",
            "if axis in wanted and magnitude in wanted and profile.dangerous(wanted[axis], wanted[magnitude]):",
            "if False:",
        ),
        (
            "written while the excitation shows",
            "        if session.snapshot().mode == profile.excitation_mode:\n            raise",
            "        if False:\n            raise",
        ),
        (
            "given back while the excitation shows",
            "        if snapshot.mode == profile.excitation_mode:\n            words",
            "        if False:\n            words",
        ),
        (
            "given back right after a write",
            "        self.clock.sleep(SWAP_S)  # a copy",
            "        # a copy",
        ),
        (
            "given back although one was not taken",
            "held:g}'} with it\")\n            break",
            "held:g}'} with it\")\n            continue",
        ),
        (
            "not read back before the start",
            "    for name, value in plan.writes:\n        held",
            "    for name, value in ():\n        held",
        ),
        (
            "given back before it is cleared",
            "        if flown is None:\n            return True\n        if flown.stills",
            "        return True\n        if flown.stills",
        ),
        (
            "given back in whatever mode",
            "if cleared and not snapshot.lost and snapshot.mode != self.profile.excitation_mode:",
            "if cleared:",
            "`give_back` looks at the mode before each write",
        ),
        (
            "started on a dead log",
            "self.stopped = trouble or self._changed(plan) or self._log_dead()",
            "self.stopped = trouble or self._changed(plan)",
        ),
        ("no last look", "        self.handback.last_look()\n", ""),
        (
            "no watch while the rest of the log arrives",
            "stop_recording(meanwhile=self.handback.watch_on)",
            "stop_recording(meanwhile=lambda: None)",
        ),
        (
            "a vehicle heard again after it was given up is left excited",
            "        if self._ours and self._shows_excitation:",
            "        if False:",
        ),
        (
            "Ctrl-C ends the way back",
            "if not flown.out_of_hand or interrupted >= 3:",
            "if True:",
            "the watch while the log arrives goes on with it, and so does the last look",
        ),
        (
            "the last look believes contradicting heartbeats",
            "        return not (flown.state.contradictions or back_again)\n",
            "        return True\n",
        ),
        (
            "the last look does not wait for proof",
            "if snapshot.lost or self._ours:",
            "if snapshot.lost:",
        ),
        (
            "no room for swaps at the vehicle",
            "while self._fences and self._fences[0][1] + SWAP_S <= self._boot_s:",
            "while self._fences and self._fences[0][1] <= self._boot_s:",
        ),
        ("no room for swaps on the way there", "self._fences.popleft()[0] - SWAP_S)", "self._fences.popleft()[0])"),
        (
            "an answer need not be later than the question",
            "            self._fences.append((sent, boot_s))",
            "            self.known_s = max(self.known_s, now - SWAP_S)",
        ),
        ("a heartbeat's age is the likely one", "now - boot_s - earliest)", "now - boot_s - (self._offset or 0.0))"),
        ("a stamp from the future is believed", "if back or ahead:", "if back:"),
        (
            "the way there is never late",
            "max(self._down_s, self._up_s)",
            "self._down_s",
            "a run without answers ends as well, later",
        ),
        ("the way back is never late", "max(self._down_s, self._up_s)", "self._up_s"),
    )
)
"""Every guard of the rules, each removed or weakened."""


SEEN_IN = {
    "a heartbeat from before the start is believed": ("random", 53),
    "one other heartbeat is a takeover in flight": ("hard", 1),
    "no takeover in flight": ("random", 47),
    "one other heartbeat is a return": ("random", 1),
    "one other heartbeat does not suspend the orders": ("random", 7),
    "two in a row need not be in a row": ("hard", 1),
    "our own silence counts against stuck": ("hard", 2199),
    "cleared without proof": ("random", 53),
    "an old heartbeat with another mode stops nothing": ("random", 18948),
    "an old heartbeat with the excitation interrupts nothing": ("random", 1031913),
    "a proof outlives a silence": ("twin", 201),
    "cleared at once after a silence": ("hard", 6000566),
    "cleared against the vehicle's own log": ("hard", 5000081),
    "cleared at once without a word of the log": ("hard", 5035734),
    "contradictions are not looked at": ("hard", 10),
    "shown again after it left, and left alone": ("hard", 338),
    "old heartbeats are believed after a silence": ("hard", 67),
    "started right after a write": ("twin", 242),
    "after a silence the word from before it counts": ("hard", 18),
    "after a silence the accepted start still counts": ("hard", 382),
    "an acceptance heard after a silence counts": ("hard", 135),
    "a heartbeat beside the acceptance is not heard": ("hard", 5003428),
    "a heartbeat ages only on its way": ("hard", 5010658),
    "a silence between two ticks is not seen": ("random", 27672),
    "our own silence is none": ("random", 308),
    "asked again after a silence": ("random", 75),
    "asked again although it started": ("random", 47),
    "asked again where it started and left": ("random", 157),
    "started on a late link": ("hard", 1114),
    "started right after a silence": ("hard", 5150),
    "started from the pilot's other mode": ("random", 146),
    "asked again in the pilot's other mode": ("random", 45646),
    "a late link does not end a run": ("random", 1078),
    "a lag that is not known is none": ("twin", 9005235),
    "a dead log does not end a run": ("random", 45),
    "no answers do not end a run": ("random", 528),
    "nobody's wish ends a run": ("random", 29),
    "no limit ends a run": ("random", 83),
    "an accepted way back is asked for again": ("random", 9),
    "an ordinary end does not wait": ("random", 1),
    "the way back is asked for on the start's word again and again": ("hard", 2764),
    "the way back is one mode for all": ("random", 9),
    "axis and magnitude in any order": ("random", 2),
    "a dangerous magnitude is put back": ("random", 1),
    "written while the excitation shows": ("random", 65),
    "given back while the excitation shows": ("random", 153),
    "not read back before the start": ("random", 1),
    "given back before it is cleared": ("random", 71),
    "given back although one was not taken": ("hard", 608),
    "given back right after a write": ("random", 8020353),
    "started on a dead log": ("random", 5003214),
    "no last look": ("hard", 1346),
    "the last look does not wait for proof": ("hard", 5001859),
    "a stamp from the future is believed": ("twin", 2113),
    "the way back is never late": ("random", 1078),
    "sent unheard although it is heard": ("blind", 5),
    "sent unheard unasked": ("blind", 0),
}
"""A history that shows a guard to be gone: its kind and its seed."""

SEEN_TOGETHER: dict[tuple[str, ...], History | tuple[str, int]] = {
    ("an acceptance that changed nothing is believed", "cleared at once without a word of the log"): ("hard", 5003098),
    ("cleared at once without a word of the log", "cleared with the start's proof alone"): ("hard", 5002088),
    (
        "settings are not asked for where the log stays on the card",
        "settings that were not told of are as planned",
    ): History(card=True, acts=(Act(-0.5, "write", 0.15, 1),)),
    ("no room for swaps at the vehicle", "no room for swaps on the way there"): ("hard", 5023824),
    ("the last look believes contradicting heartbeats", "the last look does not wait for proof"): ("hard", 5009977),
}
"""Guards that stand behind each other: a history that breaks a rule where all of them are gone, and holds all of them
where any one stands."""

HEARD_AGAIN = History(
    seed=2094615,
    down=Way(delay_s=0.1, delays=((0.0, 6.761),), outages=((7.215, 32.04),)),
    acts=(Act(5.899, "abort"),),
    attitude_s=0.5,
    stop_s=15.0,
)
"""Given up while nothing was heard, and heard again, still excited, while the rest of the log arrives."""

MADE_FOR = {
    "an early word finishes a run": History(acts=(Act(4.0, "finished"),), runs=(3,)),
    "stamps that ran ahead finish a run": History(acts=(Act(4.0, "jump", 60.0),), runs=(3,)),
    "a link of one way counts against stuck": History(up=Way(outages=((4.0, 48.0),)), runs=(3,)),
    "a link of one way is waited for without end": History(up=Way(outages=((4.0, math.inf),)), runs=(3,)),
    "time without answers counts against stuck": History(
        up=Way(outages=((4.0, 48.0),)), down=Way(delay_s=0.2), runs=(3,)
    ),
    "one that shows itself excited counts as silent": History(up=Way(outages=((4.0, 48.0),)), runs=(3,)),
    "what the vehicle tells of settings is not heard": History(acts=(Act(4.0, "told", 0.15),), runs=(3,)),
    "settings told of after the end change nothing": History(
        card=True, up=Way(outages=((0.2, 3.4),)), acts=(Act(-0.5, "write", 0.15, 1),)
    ),
    "asked again where it started and left": History(
        seed=157,
        up=Way(loss=0.1, delays=((-0.001, 4.6726694770962265),)),
        down=Way(delay_s=0.02, swaps=0.3),
        acts=(Act(0.6869326722618869, "mode", 1), Act(0.6143488875317185, "mode", 25)),
        mode_before=1,
        tick_s=0.4,
        attitude_s=1.0,
    ),
    "a late start's own word does not undo the proof": History(
        seed=74,
        acts=(Act(2.72, "log", math.inf), Act(10.183, "mode", EXCITED)),
        tick_s=0.1,
        shows_at_once=False,
    ),
    "a heartbeat's age is the likely one": History(
        seed=0,
        down=Way(delays=((3.074, 2.261),)),
        acts=(Act(3.533, "reboot"), Act(3.959, "mode", EXCITED), Act(5.214, "stall", 5.0)),
        runs=(3,),
        tick_s=0.25,
    ),
    "a silence between two ticks does not end a run": History(
        seed=85210,
        down=Way(delays=((0.62, 2.896),)),
        acts=(Act(3.5, "stall", 2.0), Act(5.915, "stall", 2.0)),
        runs=(3,),
        attitude_s=1.0,
    ),
    "a vehicle heard again after it was given up is left excited": HEARD_AGAIN,
    "no watch while the rest of the log arrives": HEARD_AGAIN,
    "started with an unknown lag": History(
        seed=866286,
        origin="begin",
        up=Way(delay_s=0.02, outages=((0.07, 2.88),)),
        down=Way(delay_s=0.2),
        acts=(Act(1.1217, "reboot"),),
    ),
    "no end where nothing is known": History(seed=107352, up=Way(outages=((-0.01, math.inf),))),
    "an unanswered write counts as not done": History(
        seed=986,
        own=1,
        down=Way(outages=((7.174, 17.045),)),
        runs=(0, 1),
    ),
    "an answer need not be later than the question": History(
        seed=514858,
        up=Way(delay_s=0.4, delays=((-0.001, 5.546),)),
        down=Way(delays=((-0.001, 2.097),)),
        acts=(Act(0.7495, "abort"),),
    ),
}
"""A history made for a guard that chance shows too seldom."""


# ------------------------------------------------------------------------------------------------ the world


@dataclass(frozen=True, slots=True)
class Breach:
    """A rule broken."""

    at_s: float
    rule: str
    words: str


class _Message:
    """On its way, either way; its truth is for the judge."""

    __slots__ = ("content", "made_s", "mode", "newest_s", "own", "sweep_s", "up_s")

    def __init__(self, content: Any, made_s: float, own: bool = True) -> None:
        self.content = content
        self.made_s = made_s
        self.own = own
        """Of the vehicle, not of a stranger."""
        self.up_s = 0.0
        """How late the question was that it answers."""
        self.newest_s = 0.0
        """A log block's newest sample, and the time in the maneuver and the mode then."""
        self.sweep_s: float | None = None
        self.mode: int | None = None


class _Queue:
    """One way of the link."""

    def __init__(self, way: Way, world: World, deliver: Callable[[_Message], None]) -> None:
        self.way = way
        self._world = world
        self._deliver = deliver
        self._last = 0.0

    def send(self, message: _Message) -> int:
        """How many copies of it will arrive."""
        world, way = self._world, self.way
        chance = world.chance.random
        lost, repeated, swapped, by, by_too = chance(), chance(), chance(), chance(), chance()
        now = world.now - world.origin
        if lost < _latest(way.losses, now, way.loss) or (way.outages and self._is_out(now)):
            world.counts["messages lost"] += 1
            return 0
        self._enter(message, by if swapped < way.swaps else 0.0)
        if repeated >= way.repeats:
            return 1
        self._enter(message, by_too)
        return 2

    def _enter(self, message: _Message, late: float) -> None:
        if late == 0.0:
            self._queue(message)
        else:
            self._world.at(self._world.now + 0.98 * SWAP_S * late, self._queue, message)

    def _queue(self, message: _Message) -> None:
        now = self._world.now
        delay_s = _latest(self.way.delays, now - self._world.origin, self.way.delay_s)
        self._last = max(self._last, now + delay_s)
        self._world.at(self._last, self._deliver, message)

    def _is_out(self, now: float) -> bool:
        return any(begin <= now < end for begin, end in self.way.outages)


def _latest(steps: Sequence[tuple[float, float]], now: float, base: float) -> float:
    value = base
    for begin, then in steps:
        if begin > now:
            break
        value = then
    return value


@dataclass(slots=True)
class _Sweep:
    """A stay in the excitation that we asked for."""

    entered_s: float
    otherwise: set[str]
    """Settings that were not as shown when it began;"""
    told: set[str]
    """and those of which the vehicle said so while it was flown."""
    over_s: float = math.inf


class _Vehicle:
    """The truth: mode, parameters, and who excites it."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._history = world.history
        self.mode = world.history.mode_before
        self.parameters = _parameters(world.history.own)
        self.excited_by = ""
        """`us`, `other`, or nobody."""
        self.entered_s = 0.0
        self.sweep_over = False
        self.booted_s = -100.0
        self.heard_s = 0.0
        self.streams = False
        self.log_silent_until = -math.inf
        self.tilted = False
        self.refuses = world.history.refuses
        self.foreign: dict[str, float] = {}
        """When another station wrote a parameter last."""
        self.sweeps: list[_Sweep] = []
        self.ahead_s = 0.0
        """So far its log's stamps have jumped."""
        self._beats = 0
        self._blocks = 0
        world.at(world.chance.random(), self._beat, self._beats)
        world.at(world.chance.random() * 0.1, self._attitude, None)

    # what it says

    def _say(self, event: Event) -> _Message:
        message = _Message(event, self._world.now)
        self._world.downlink.send(message)
        return message

    def _boot_s(self) -> float:
        return self._world.now - self.booted_s

    def show(self) -> None:
        """A heartbeat, now; the next in a second."""
        self._beats += 1
        self._world.at(self._world.now + 1.0, self._beat, self._beats)
        self._say(Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=self.mode, status=4))

    def _beat(self, number: int) -> None:
        if number == self._beats:
            self.show()
            silence_s = self._world.now - self.heard_s
            if silence_s > self._history.failsafe_s and self.mode != RTL:
                self.text("GCS Failsafe")
                self.change(RTL, "failsafe")
            if silence_s > 10.0:
                self.streams = False

    def _attitude(self, _: None) -> None:
        world = self._world
        world.at(world.now + self._history.attitude_s, self._attitude, None)
        if self._history.card and world.now < self.log_silent_until:
            return
        lean = 0.9 if self.tilted and self.mode == EXCITED else 0.0
        self._say(Attitude(1, 1, boot_s=self._boot_s(), roll=lean, pitch=0.0, yaw=0.0, p=0.0, q=0.0, r=0.0))

    def text(self, words: str) -> None:
        self._say(StatusText(1, 1, 4, words))

    def _block(self, _: None) -> None:
        world = self._world
        world.at(world.now + 0.25, self._block, None)
        if self.streams and world.now >= self.log_silent_until:
            message = _Message(LogBlock(1, 1, self._blocks, b""), world.now)
            self._blocks += 1
            message.newest_s = self._boot_s() + self.ahead_s
            message.sweep_s = world.now - self.entered_s + self.ahead_s if self.mode == EXCITED else None
            message.mode = self.mode
            world.downlink.send(message)

    # what it does

    def change(self, mode: int, who: str) -> None:
        if mode == self.mode:
            return
        world = self._world
        world.tell("vehicle", f"mode {mode}, by {who}")
        self.mode = mode
        self.excited_by = ""
        self._over()
        if mode == EXCITED:
            self.excited_by = "us" if who == "us" else "other"
            self.entered_s, self.sweep_over = world.now, False
            self.text(f"SystemID Starting: axis={self.parameters['SID_AXIS']:.0f}")
            flown = None if world.flight is None else world.flight.handback.flown
            world.at(world.now + (3.5 if flown is None else flown.plan.finished_s), self._finish, self.entered_s)
            if flown is not None and self.excited_by == "us":
                writes = flown.plan.writes
                otherwise = {name for name, value in writes if self.parameters[name] != _float32(value)}
                self.sweeps.append(_Sweep(world.now, otherwise, set()))
        if self._history.shows_at_once:
            self.show()

    def _over(self) -> None:
        if self.sweeps:
            self.sweeps[-1].over_s = min(self.sweeps[-1].over_s, self._world.now)

    def flies_otherwise(self, name: str, *, told: bool = False) -> None:
        """Another station wrote it, and everybody was told, or that was lost."""
        if told:
            self._echo(name)
        if told and self.sweeps and self.sweeps[-1].over_s == math.inf:
            self.sweeps[-1].told.add(name)

    def _finish(self, entered_s: float) -> None:
        if self.mode == EXCITED and self.entered_s == entered_s and not self.sweep_over:
            self.sweep_over = True
            self._over()
            self.text("SystemID Finished")

    def stop_by_lean(self) -> None:
        if self.mode == EXCITED and not self.sweep_over:
            self.sweep_over = True
            self._over()
            self.text("SystemID Stopped: lean=31.1 max=30")

    def reboot(self) -> None:
        self.booted_s, self.mode, self.excited_by = self._world.now, STABILIZE, ""
        self.streams = False

    def hear(self, message: _Message) -> None:
        world = self._world
        self.heard_s = world.now
        match message.content:
            case Ping(nonce):
                self._say(TimeReply(1, 1, nonce, self._boot_s())).up_s = world.now - message.made_s
            case Command(command, parameters, _) if command == DO_SET_MODE:
                self._asked(int(parameters[1]), message)
            case ParamRead(name, _) if name in self.parameters:
                self._echo(name)
            case ParamWrite(name, bits, _) if name in self.parameters:
                world.judge.write_arrives(name, float_of_bits(bits))
                self.parameters[name] = float_of_bits(bits)
                self._echo(name)
            case BlockStatus(number, _):
                streams = number == 2147483646
                if streams and not self.streams and not self._blocks:
                    world.at(world.now, self._block, None)
                self.streams = streams

    def _asked(self, mode: int, message: _Message) -> None:
        world, accepted = self._world, True
        if mode == EXCITED:
            world.starts_under_way -= 1
            world.counts["starts that arrived"] += 1
            world.counts["starts over a second late"] += world.now - message.made_s > 1.0
            world.judge.start_arrives()
            if self.refuses and self.mode != EXCITED:
                accepted = False
                self.text("No axis selected, SID_AXIS = 0")
            else:
                self.change(mode, "us")
        elif not (self._history.never_leaves and self.mode == EXCITED):
            world.counts["ways back that arrived"] += self.mode == EXCITED
            self.change(mode, "us")
        world.tell("vehicle", f"hears {'start' if mode == EXCITED else f'mode {mode}'}, made {message.made_s:.2f}")
        self._say(
            CommandAck(1, 1, command=DO_SET_MODE, result=0 if accepted else 4, target_system=0, target_component=0)
        )

    def _echo(self, name: str) -> None:
        self._say(
            ParamValue(1, 1, name=name, bits=bits_of_float(self.parameters[name]), kind=9, count=100, index=65535)
        )


def _parameters(own: int) -> dict[str, float]:
    axis, magnitude = OWN_SETTINGS[own]
    values = {"SID_AXIS": axis, "SID_MAGNITUDE": magnitude, "SID_F_START_HZ": 0.5, "SIDX_KIND": 0.0}
    values |= {"SYSID_MYGCS": 254.0, "FS_GCS_ENABLE": 1.0, "LQR_SW": 1.0, "ANGLE_MAX": 3000.0}
    values |= {"LOG_BACKEND_TYPE": 3.0}
    values |= {"FS_OPTIONS": 0.0, "FS_GCS_TIMEOUT": 5.0, "SCHED_LOOP_RATE": 100.0}
    return {name: _float32(value) for name, value in values.items()}


def _float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


class _Folder:
    """What a flight writes is of no matter here."""

    path = Path("flight")

    def write(self, about: Any) -> None: ...
    def write_card(self, text: str) -> None: ...
    def audit(self, *words: Any, **more: Any) -> None: ...


class World:
    """The session's face and its clock, before the vehicle and the link of one history."""

    station = 254

    def __init__(self, history: History, code: Code = REAL, *, story: bool = False) -> None:
        self.history = history
        self.code = code
        self.now = 0.0
        self.origin = FIRST_START_S if history.origin == "begin" else math.inf
        self.chance = random.Random(history.seed)
        self.counts: Counter[str] = Counter()
        self.story: list[tuple[float, str, str]] | None = [] if story else None
        self._heap: list[tuple[float, int, Callable[[Any], None], Any]] = []
        self._number = 0
        self.uplink = _Queue(history.up, self, lambda message: self.vehicle.hear(message))
        self.downlink = _Queue(history.down, self, self._arrives)
        self.judge = _Judge(self)
        self.vehicle = _Vehicle(self)
        self.starts_under_way = 0
        """Copies of starts that will arrive."""
        self.flight: Any = None
        self.notes: list[str] = []
        self.pressed = 0
        self.blind = False
        """Somebody wants an end sent to a vehicle that is not heard."""
        self._interrupt = False
        self._stalled_until = -math.inf
        self._clock = code.clock.LinkClock()
        self._snapshot = VehicleSnapshot(system=1, component=1)
        self._heard_s = -math.inf
        self._texts: list[Text] = []
        self._procedure: Any = None
        self._writing: Any = None
        self._blocks = 0
        self._block_s = -math.inf
        self._attitudes = Attitudes()
        self._newest = _Message(None, 0.0)
        self._recording = False
        self.at(0.0, self._ping, None)
        if history.origin == "begin":
            self._plan_acts()

    @property
    def mode_before(self) -> int:
        """The mode of the pilot's choice, as the card is begun: in a whole flight it may change until then."""
        flown = None if self.flight is None else self.flight.handback.flown
        return self.history.mode_before if flown is None else flown.state.mode_before

    # time

    def at(self, when: float, action: Callable[[Any], None], argument: Any) -> None:
        self._number += 1
        heapq.heappush(self._heap, (when, self._number, action, argument))

    def tell(self, who: str, words: str) -> None:
        if self.story is not None:
            self.story.append((self.now, who, words))

    def advance(self, until: float) -> None:
        if until > LONGEST_S:
            raise TimeoutError
        self.judge.ground(self.now)
        until = max(until, self._stalled_until)
        heap = self._heap
        while heap[0][0] <= until:
            self.now, _, action, argument = heapq.heappop(heap)
            action(argument)
            if self._stalled_until > until:
                until = self._stalled_until
        self.now = until
        self.judge.ground(until)

    # what others do

    def _plan_acts(self) -> None:
        for act in self.history.acts:
            self.at(max(self.now, self.origin + act.at_s), self._act, act)

    def _act(self, act: Act) -> None:
        vehicle = self.vehicle
        self.counts[f"act: {act.what}"] += 1
        self.tell("act", f"{act.what} {act.value:g} {act.more:g}")
        match act.what:
            case "mode":
                vehicle.change(int(act.value), "other")
            case "stranger":
                for number in range(int(act.more)):
                    self.at(self.now + 1.0 * number, self._stranger, int(act.value))
            case "write":
                name, value = ("SID_MAGNITUDE", act.value) if act.more else ("SID_F_START_HZ", 1.0 + act.value)
                vehicle.parameters[name], vehicle.foreign[name] = _float32(value), self.now
                vehicle.flies_otherwise(name)
            case "told":  # as ArduPilot does, to all stations
                vehicle.parameters["SID_MAGNITUDE"] = vehicle.foreign["SID_MAGNITUDE"] = _float32(act.value)
                vehicle.flies_otherwise("SID_MAGNITUDE", told=True)
            case "finished":
                self.downlink.send(_Message(StatusText(1, 1, 6, "SystemID Finished"), self.now, own=False))
            case "jump":
                vehicle.ahead_s = act.value
            case "log":
                vehicle.log_silent_until = self.now + act.value
            case "lean":
                vehicle.stop_by_lean()
            case "twin":
                for number in range(int(act.more)):
                    self.at(self.now + 1.0 * number, self._twin, int(act.value))
            case "reboot":
                vehicle.reboot()
            case "tilt":
                vehicle.tilted = True
            case "refuse":
                vehicle.refuses = not vehicle.refuses
            case "abort":
                self.pressed += 1
            case "blind":
                self.blind = True
            case "interrupt":
                self._interrupt = True
            case "stall" if self.now >= self._stalled_until:
                self._stalled_until = self.now + act.value
                self.judge.stall(act.value)

    def _stranger(self, mode: int) -> None:
        self.at(
            self.now + 0.05,
            self._arrives,
            _Message(
                Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=mode, status=4), self.now, own=False
            ),
        )

    def _twin(self, mode: int) -> None:
        """A second vehicle with the same id, whose clock is ahead: what it says is stamped."""
        boot_s = self.now + TWIN_AHEAD_S - self.vehicle.booted_s
        attitude = Attitude(1, 1, boot_s=boot_s, roll=0.0, pitch=0.0, yaw=0.0, p=0.0, q=0.0, r=0.0)
        self.at(self.now + 0.05, self._arrives, _Message(attitude, self.now, own=False))
        self._stranger(mode)

    # the ground's ears and mouth

    def _ping(self, _: None) -> None:
        if self.now < self._stalled_until:
            self.at(self._stalled_until, self._ping, None)
            return
        self.at(self.now + 0.2, self._ping, None)
        self._send(self._clock.poll(self.now))
        if self._recording and not self._blocks and not self.history.card:
            self._send([BlockStatus(2147483646, True)])

    def _send(self, sends: Sequence[Send]) -> None:
        for send in sends:
            message = _Message(send, self.now)
            start = isinstance(send, Command) and send.command == DO_SET_MODE and send.parameters[1] == EXCITED
            if start and math.isinf(self.origin):
                self.origin = self.now
                self._plan_acts()
            if isinstance(send, Command):
                self.judge.ordered(int(send.parameters[1]))
            if isinstance(send, ParamRead):
                self.judge.reads(send.name)
            if isinstance(send, ParamWrite) and self._procedure is None:
                self.judge.stilled(send.name)
            elif isinstance(send, ParamWrite) and self._procedure is not self._writing:
                self._writing = self._procedure
                self.judge.write_begins(send.name)
            copies = self.uplink.send(message)
            if start:
                self.starts_under_way += copies
            if self.story is not None and not isinstance(send, Ping | BlockStatus):
                self.tell("ground", f"sends {_words(send)}{'' if copies else ': lost'}")

    def _arrives(self, message: _Message) -> None:
        if self.now < self._stalled_until:
            self.at(self._stalled_until, self._arrives, message)
            return
        event, now = message.content, self.now
        self.judge.heard(message)
        self._heard_s = now
        if isinstance(event, LogBlock):
            self._blocks += 1
            self._block_s = now
            if message.newest_s > self._newest.newest_s or message.newest_s < self._newest.newest_s - 1.0:
                self._newest = message
            return
        clock = self._clock
        clock.on_event(event, now)
        if self.history.card and self._recording:
            self._attitudes.on_event(event, now)
        if isinstance(event, Attitude) and not event.roll and self._snapshot.roll == 0.0:
            return  # as before
        self._snapshot = reduce(self._snapshot, event, now, known_s=clock.known_s, late_s=clock.stamp_age_s(now))
        if isinstance(event, StatusText):
            self._texts.append(self._snapshot.texts[-1])
        if self.story is not None and not isinstance(event, Attitude | TimeReply):
            known = f", known to {clock.known_s:.2f}" if isinstance(event, Heartbeat) else ""
            whose = "" if message.own else " of a stranger"
            self.tell("ground", f"hears {_words(event)}{whose}, made {message.made_s:.2f}{known}")
        if self._procedure is not None:
            self._send(self._procedure.on_event(event, now))

    # the session's face

    def sleep(self, seconds: float) -> None:
        self.advance(self.now + max(seconds, self.history.tick_s))
        if self._interrupt:
            self._interrupt = False
            self.tell("act", "Ctrl-C reaches the program")
            raise KeyboardInterrupt

    def now_s(self) -> float:
        return self.now

    def snapshot(self) -> Any:
        clock, age = self._clock, self.now - self._heard_s
        if not self.history.whole:
            return _View(self, age)
        return replace(
            self._snapshot,
            link_age_s=age,
            lost=age > LOST_AFTER_S,
            lag_s=clock.lag_s,
            answer_age_s=self.now - clock.answered_s,
            recording=_Folder.path if self._recording else None,
            blocks_received=self._blocks,
        )

    def call(self, procedure: Any, timeout_s: float | None = None, *, cancelled: Any = None) -> Any:
        end = math.inf if timeout_s is None else self.now + timeout_s
        try:
            self._procedure = procedure
            self._send(procedure.start(self.now))
            while procedure.outcome is None:
                if self.now >= end:
                    raise NoAnswerError(f"not done in {timeout_s} s")
                self.advance(min(self.now + POLL_S, end))
                self._send(procedure.poll(self.now))
        finally:
            self._procedure = None
        if hasattr(procedure.outcome, "error"):
            raise procedure.outcome.error()
        return procedure.outcome.value

    def send(self, *sends: Send) -> None:
        self._send(sends)

    def texts_since(self, cursor: int) -> tuple[int, list[Text]]:
        texts = self._texts[cursor:]
        return len(self._texts), texts

    def samples(self, last_s: float) -> LiveWindow:
        if self.history.card:
            return self._attitudes.window(last_s)
        newest = self._newest
        t = _EMPTY if newest.content is None else np.array([newest.newest_s - last_s, newest.newest_s])
        zero = np.zeros(t.size)
        return LiveWindow(
            t=t,
            p=zero,
            q=zero,
            delta_x=zero,
            delta_y=zero,
            excitation_x=zero,
            excitation_y=zero,
            sweep_s=newest.sweep_s,
            sweep_entered_s=None if newest.sweep_s is None else newest.newest_s - newest.sweep_s,
            log_s=None if newest.content is None else newest.newest_s,
            mode=newest.mode,
        )

    def log_health(self) -> Any:
        if not self.history.card:
            return _Log(None if self._newest.content is None else self.now - self._block_s)
        heard = self._attitudes
        return _CardLog(None if heard.kept_at is None else self.now - heard.kept_at, heard.count, heard.reported)

    def start_recording(self, directory: Path, log: str = "stream") -> None:
        assert log == ("card" if self.history.card else "stream")
        self._recording = True
        if log == "stream":
            self._send([BlockStatus(2147483646, True)])

    def shed_log(self) -> None:
        if not self.history.card:
            self._send([BlockStatus(2147483645, True)])

    def stop_recording(self, *, meanwhile: Callable[[], None]) -> RecordingSummary:
        if not self.history.card:
            self._send([BlockStatus(2147483645, True)])
        end = self.now + self.history.stop_s
        while self.now < end:
            meanwhile()
            self.advance(max(self.now, min(end, self.now + self.history.tick_s)))
        self._recording = False
        return RecordingSummary(directory=_Folder.path, logs=(), tlog=None, tlog_frames=0, how="", problems=())


_EMPTY = np.zeros(0)


class _Log:
    """The health of a log that is recorded, as far as a run asks for it."""

    __slots__ = ("silent_s",)
    reported = ""
    capacity = Capacity(over_s=5.0, carried=4000.0, numbered=4000.0, per_log_s=4000.0, advance=1.0)
    on_card = False
    clock_s = None
    another = False

    def __init__(self, silent_s: float | None) -> None:
        self.silent_s = silent_s


class _CardLog(_Log):
    """As it, where the log stays on the vehicle's card."""

    __slots__ = ("blocks", "reported")
    on_card = True

    def __init__(self, silent_s: float | None, blocks: int, reported: str) -> None:
        super().__init__(silent_s)
        self.blocks, self.reported = blocks, reported


class _View:
    """A snapshot as `replace` would make it, and ten times faster."""

    def __init__(self, world: World, age: float) -> None:
        snapshot = self._snapshot = world._snapshot
        self.mode, self.mode_name, self.beats = snapshot.mode, snapshot.mode_name, snapshot.beats
        self.heartbeats, self.armed = snapshot.heartbeats, snapshot.armed
        self.link_age_s, self.lost = age, age > LOST_AFTER_S
        self.lag_s, self.answer_age_s = world._clock.lag_s, world.now - world._clock.answered_s
        self.recording = _Folder.path if world._recording else None
        self.blocks_received = world._blocks

    def __getattr__(self, name: str) -> Any:
        return getattr(self._snapshot, name)


class _Time:
    """The session's clock, as the engine wants it."""

    def __init__(self, world: World) -> None:
        self.now = world.now_s
        self.sleep = world.sleep


def _words(content: Any) -> str:
    match content:
        case Command(_, parameters, _):
            return f"an order for mode {parameters[1]:.0f}"
        case ParamWrite(name, bits, _):
            return f"{name} = {float_of_bits(bits):g}"
        case ParamRead(name, _):
            return f"{name}?"
        case ParamValue():
            return f"{content.name} is {float_of_bits(content.bits):g}"
        case Heartbeat():
            return f"a heartbeat in mode {content.mode}"
        case CommandAck():
            return f"an answer, {'accepted' if content.result == 0 else 'refused'}"
        case StatusText():
            return content.text
    return type(content).__name__


# ------------------------------------------------------------------------------------------------ the judge


class _Judge:
    """Every rule, from what happened."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.breaches: list[Breach] = []
        self._cleared: Any = None
        self._run: Any = None
        self._run_s = 0.0
        self._asked = 0
        """Starts of this run."""
        self._first_ask_s = 0.0
        self._last_ask_s = 0.0
        self._start_arrived_s = math.inf
        self._started_heard = False
        self._confirmed = False
        self._mode_heard = -1
        self._telling = EXCITED
        """Of the last heartbeat heard that can tell of this run."""
        self._heard_s = 0.0
        self._break_s = 0.0
        """When the link was last heard again after a break."""
        self._silence_s = -math.inf
        """When the last silence of the link, or of ourselves, ended."""
        self._stood_s = -math.inf
        """When we last stood still for what is a silence together with the pace of our looks."""
        self._block_s = 0.0
        self._fresh_down_s = 0.0
        self._fresh_up_s = 0.0
        self._unanswered = 0
        """Heartbeats with the excitation, heard since the last way back was asked for after the run's end."""
        self._counted_s = -math.inf
        """When the last of them was."""
        self._strangers = 0
        self._deceived: Any = False
        self._beats = 0
        self._others = 0
        self._settled_others = 0
        self._gone_s = math.inf
        """Since when three in a row, none of them from right after a silence, have shown another mode."""
        self._phase = ""
        self._beat_s = -math.inf
        self._beat_age_s = 0.0
        """Of the last heartbeat heard: when, and how old it was."""
        self._lost_s = -math.inf
        """When a silence of the link, certainly long enough to be seen, ended."""
        self._held = False
        """The vehicle accepted the way back, and has not shown the excitation since."""
        self._ended: tuple[Any, int] = (None, 0)
        """The run that was last seen to end, and the heartbeats heard until then."""
        self._stuck_run: Any = None
        self._unknown_run: Any = None
        self._answered_s = 0.0
        self._answers_since_s = 0.0
        """The last answer to a ping, and the first after a break of `ONE_WAY_S`."""
        self._flown_by: list[tuple[Any, float, _Sweep | None]] = []
        """Of each run that ended its plan, when, and what the vehicle had flown last."""
        self._read_s: dict[str, float] = {}
        self._written_s: dict[str, float] = {}
        self._held_values: dict[str, float] = {}
        """As the vehicle first answered the last question."""
        self._reading: Any = None
        self.pressed_s = math.inf
        self._tilted_s = math.inf
        self._shown_s = -math.inf
        """When the vehicle was last heard to show a mode, by its own heartbeat."""
        self._left_s = math.inf
        """When the ground last took the vehicle for having left the excitation."""
        self._last_word_is_start = False
        """It said that it starts, and no heartbeat was heard since."""

    def broken(self, rule: str, words: str) -> None:
        world = self._world
        world.tell("RULE", f"{rule}: {words}")
        self.breaches.append(Breach(world.now, rule, words))

    def _unless_deceived(self, rule: str, words: str) -> None:
        """Where strangers spoke and the vehicle itself was not heard meanwhile, nobody could know."""
        if self._strangers and (self._world.now - self._shown_s > 3.0 or self._deceived is self._flown):
            self._deceived = self._flown  # and so are the writes that follow
            self._world.counts["excused"] += 1
        else:
            self.broken(rule, words)

    @property
    def _flown(self) -> Any:
        return None if self._world.flight is None else self._world.flight.handback.flown

    def _new_run(self) -> None:
        flown = self._flown
        if flown is not self._run:
            self._run_s = self._world.now
            self._run, self._asked, self._started_heard, self._confirmed = flown, 0, False, False
            self._start_arrived_s, self._unanswered, self._telling, self._held = math.inf, 0, EXCITED, False
            self._others, self._left_s = 0, math.inf
            self._said_to_start()

    def _said_to_start(self) -> None:
        """The vehicle's last word is that it starts."""
        self._telling, self._settled_others, self._gone_s = EXCITED, 0, math.inf

    # what the vehicle gets

    def write_arrives(self, name: str, value: float) -> None:
        world, vehicle = self._world, self._world.vehicle
        world.counts["writes that arrived"] += 1
        still = name == "SID_MAGNITUDE" and value == 0.0 and world.blind
        world.counts["sent unheard, and arrived in the excitation"] += still and vehicle.excited_by == "us"
        if vehicle.excited_by == "us" and not still:
            self._unless_deceived("write", f"{name} = {value:g} reaches a vehicle that we excite")
        if name in ("SID_AXIS", "SID_MAGNITUDE") and not vehicle.foreign:
            now = (vehicle.parameters["SID_AXIS"], vehicle.parameters["SID_MAGNITUDE"])
            then = (value, now[1]) if name == "SID_AXIS" else (now[0], value)
            if _profile().dangerous(*then) and not _profile().dangerous(*now):
                self.broken("write", f"axis {then[0]:g} with magnitude {then[1]:g} is dangerous")

    def start_arrives(self) -> None:
        vehicle, flown = self._world.vehicle, self._flown
        self._start_arrived_s = min(self._start_arrived_s, self._world.now)
        if vehicle.mode == EXCITED or flown is None:
            return
        for name, value in flown.plan.writes:
            if vehicle.parameters[name] != _float32(value) and name not in vehicle.foreign:
                self.broken("write", f"{name} is {vehicle.parameters[name]:g} at the start, not {value:g} as shown")

    # what the ground hears and sends

    def stall(self, seconds: float) -> None:
        if seconds + 2 * self._world.history.tick_s > 1.5:
            self._stood_s = self._world.now + seconds
        if seconds > 1.5 and self._flown is not None:
            self._silence_s = self._world.now + seconds
        self._break_s = self._world.now + seconds

    def heard(self, message: _Message) -> None:
        now, event = self._world.now, message.content
        self._new_run()
        if now - self._heard_s > CLOSE_S:
            self._break_s = now
        if now - self._heard_s > LOST_AFTER_S:
            self._silence_s = now
        if now - self._heard_s > LOST_AFTER_S + 1.0:
            self._lost_s = now
        self._heard_s = now
        if now - message.made_s <= LATE_S and message.own:
            self._fresh_down_s = now
        if isinstance(event, TimeReply):
            self._answers_since_s = now if now - self._answered_s > ONE_WAY_S else self._answers_since_s
            self._answered_s = now
        if isinstance(event, TimeReply) and message.up_s <= LATE_S:
            self._fresh_up_s = now
        if isinstance(event, Attitude if self._world.history.card else LogBlock) and message.own:
            self._block_s = now
        if isinstance(event, StatusText) and event.text.startswith("SystemID Starting") and self._asked:
            self._started_heard = True
            self._last_word_is_start = True
            self._said_to_start()
        if isinstance(event, CommandAck) and event.result == 0:
            asked = self._asked_for()
            self._held = self._held or asked == self._world.mode_before
            if asked == EXCITED:
                self._said_to_start()
        if isinstance(event, ParamValue):
            self._held_values.setdefault(event.name, float_of_bits(event.bits))
        if isinstance(event, Attitude):
            self._tilted_s = min(self._tilted_s, now) if event.roll > 0.6 else math.inf
        if isinstance(event, Heartbeat):
            self._heard_beat(message, event.mode)

    def _asked_for(self) -> int | None:
        """The mode that an answer now is an answer about."""
        asking = self._world._procedure
        return getattr(asking, "mode", None) if asking is not None and asking.outcome is None else None

    def _heard_beat(self, message: _Message, mode: int) -> None:
        flown = self._flown
        self._mode_heard, self._beats = mode, self._beats + 1
        self._last_word_is_start = False
        self._beat_s, self._beat_age_s = self._world.now, self._world.now - message.made_s
        self._strangers += not message.own
        if message.own:
            self._shown_s = self._world.now
        if flown is None:
            return
        self._count_others(message, mode)
        if mode == EXCITED:
            self._started_heard = self._started_heard or self._asked > 0
            self._confirmed, self._telling, self._held = True, mode, False
            self._count_unanswered(message)
        elif (
            self._confirmed
            or mode != self._world.mode_before
            or (message.own and message.made_s > self._start_arrived_s + SWAP_S and self._known_of_start(message))
        ):
            self._telling = mode
        if mode != EXCITED and self._world.now - self._counted_s <= self._world.history.tick_s:
            self._unanswered -= self._unanswered > 0  # both in one tick: the last one stops every order

    def _count_others(self, message: _Message, mode: int) -> None:
        """In a row, with another mode; not those that date from before a silence, or from before the start."""
        now = self._world.now
        before = message.own and message.made_s < self._start_arrived_s and mode == self._world.mode_before
        starting = math.isfinite(self._start_arrived_s) or self._world.starts_under_way > 0
        if mode == EXCITED:
            self._settled_others, self._gone_s = 0, math.inf
            if now > self._silence_s + 1.5:
                self._others = 0
        elif self._confirmed or not (before and starting):
            self._others += 1
            known = self._confirmed or self._world._clock.known_s >= self._last_ask_s
            self._settled_others += known and now > max(self._silence_s, self._stood_s) + 1.5
            if self._settled_others > 2:
                self._gone_s = min(self._gone_s, now)

    def _count_unanswered(self, message: _Message) -> None:
        """Those of a burst count once, and those right after a silence not at all."""
        state, now = self._flown.state, self._world.now
        ended = state.ending is not None and not state.cleared
        if ended and state.asks and message.own and now > max(self._counted_s + 0.5, self._silence_s + 1.0):
            self._unanswered, self._counted_s = self._unanswered + 1, now

    def _known_of_start(self, message: _Message) -> bool:
        """A question sent after the last start was answered, and something was stamped later, before this was made."""
        return self._world._clock.known_s >= self._first_ask_s and message.made_s > self._first_ask_s

    def ordered(self, mode: int) -> None:
        self._new_run()
        world = self._world
        world.counts["starts asked for" if mode == EXCITED else "ways back asked for"] += 1
        if self._flown is None:
            self.broken("order", f"mode {mode} without a run")
        elif mode == EXCITED:
            self._start_ordered()
        elif mode == world.mode_before:
            self._way_back_ordered(mode)
        else:
            self.broken("order", f"mode {mode} was never the vehicle's")

    def _way_back_ordered(self, mode: int) -> None:
        now, state = self._world.now, self._flown.state
        if self._telling != EXCITED:
            self.broken("order", f"mode {mode} although the last heartbeat showed {self._telling}")
        if now - self._heard_s > LOST_AFTER_S + 0.5:
            self.broken("order", f"mode {mode} although nothing was heard for {now - self._heard_s:.1f} s")
        if self._beat_s < self._silence_s:
            self.broken("order", f"mode {mode} on a heartbeat from before a silence")
        if now < self._silence_s + 0.9 and self._beat_age_s > 1.6:
            self.broken("order", f"mode {mode} right after a silence, on a heartbeat {self._beat_age_s:.1f} s old")
        if self._held:
            self.broken("order", f"mode {mode} although the vehicle had accepted it and shown nothing since")
        ordinary = state.ending.value in ("finished", "link lost") and "showed again" not in state.reason
        ordinary = ordinary and self._confirmed  # one that just said that it starts is excited without a heartbeat
        ended, beats = self._ended
        if ordinary and (ended is not self._flown or beats == self._beats):
            self.broken("order", f"mode {mode} at an ordinary end, on a heartbeat from before it")
        self._unanswered = 0

    def reads(self, name: str) -> None:
        if self._reading is not self._world._procedure:
            self._reading = self._world._procedure
            self._held_values.pop(name, None)
        self._read_s[name] = self._world.now

    def write_begins(self, name: str) -> None:
        self._written_s[name] = self._world.now
        if self._mode_heard == EXCITED:
            self.broken("write", f"{name} is written although the last heartbeat shows the excitation")

    def _start_ordered(self) -> None:
        world, flown = self._world, self._flown
        now, lag_s = world.now, world._clock.lag_s
        if self._mode_heard != world.mode_before:
            self.broken("start", f"while the last heartbeat shows {self._mode_heard}")
        if self._started_heard:
            self.broken("start", "although the vehicle said that it starts")
        if flown.state.ending is not None:
            self.broken("start", "although the run has ended")
        if now - self._heard_s > LOST_AFTER_S or (self._asked and self._silence_s > self._first_ask_s):
            self.broken("start", "after a silence")
        if not self._asked:
            self._first_ask_s = now
            if lag_s is None or lag_s > LAG_LIMIT_S:
                self.broken("start", f"while the lag is {lag_s}")
            if self._run_s <= self._silence_s and now < self._silence_s + 0.9:
                self.broken("start", "right after a silence")
            for name, value in flown.plan.writes:
                if self._read_s.get(name, 0.0) < self._written_s[name] or self._held_values.get(name) != _float32(
                    value
                ):
                    self.broken("start", f"{name} was not read back as {value:g}")
            if now - max(self._block_s, self._break_s) > 2.5:
                self.broken("start", f"on a log that was dead for {now - self._block_s:.1f} s")
        self._asked += 1
        self._last_ask_s = now

    # what the ground believes

    def stilled(self, name: str) -> None:
        """A write that nobody waits for."""
        world = self._world
        if name != "SID_MAGNITUDE" or not world.blind:
            self.broken("write", f"{name} is written unheard, and nobody asked for it")
        if world.now - self._heard_s < LOST_AFTER_S:
            self.broken(
                "write", f"{name} is written unheard {world.now - self._heard_s:.1f} s after something was heard"
            )

    def ground(self, now: float) -> None:
        flown = self._flown
        if flown is None:
            return
        state = flown.state
        if state.ending is not None and self._ended[0] is not flown:
            self._ended = flown, self._beats
            sweeps = self._world.vehicle.sweeps
            began = sweeps and sweeps[-1].entered_s >= self._first_ask_s
            self._flown_by.append((flown.plan, now, sweeps[-1] if began else None))
        if state.ending is not None and state.ending.value == "stuck" and self._stuck_run is not flown:
            self._stuck_run = flown
            self._stuck(now, state)
        if "does not tell whether it is out" in state.reason and self._unknown_run is not flown:
            self._unknown_run = flown
            if state.excited:
                self.broken("end", "given up as if it did not tell, while it shows the excitation")
        if self._world.pressed:
            self.pressed_s = min(self.pressed_s, now)
        phase = state.phase.value
        if phase == "watching" and self._phase != "watching" and self._others < 2:
            self.broken("order", "one heartbeat with another mode was taken for the end of the excitation")
        if phase == "watching" and self._phase != "watching":
            self._left_s = now
        self._phase = phase
        if state.cleared and self._cleared is not flown:
            self._cleared = flown
            self._cleared_now(now, state)
        if phase == "flying":
            self._runs_on(now, state.flying_since)

    def _stuck(self, now: float, state: Any) -> None:
        heard_since = max(self._silence_s, state.returning_since)
        if now - heard_since < 25.0:
            self.broken("end", f"given up as stuck after {now - heard_since:.1f} s of hearing it")
        one_way_s, answered_s = now - self._answered_s, now - self._answers_since_s
        if ONE_WAY_S < one_way_s < 45.0:  # what was answered last may have been asked 10 s and more before
            self.broken("end", f"given up as stuck after {one_way_s:.1f} s of a link of one way")
        if one_way_s <= ONE_WAY_S and answered_s < 25.0:
            self.broken("end", f"given up as stuck after {answered_s:.1f} s of answers")

    def _cleared_now(self, now: float, state: Any) -> None:
        world = self._world
        world.tell("ground", "takes the vehicle for cleared")
        if state.asks and now - self._heard_s > LOST_AFTER_S:
            self.broken("clear", f"nothing was heard for {now - self._heard_s:.1f} s")
        if state.asks and self._left_s < self._silence_s <= now < self._silence_s + LOOKED_S:
            self.broken("clear", f"after a silence, looked at for {now - self._silence_s:.1f} s only")
        if state.asks and self._last_word_is_start:
            self.broken("clear", "the vehicle's last word is that it starts")
        if world.vehicle.excited_by == "us":
            self._unless_deceived("clear", "the vehicle is excited by us")
        if world.starts_under_way:
            self._unless_deceived("clear", f"{world.starts_under_way} start(s) of ours are under way")

    def _runs_on(self, now: float, flying_since: float) -> None:
        tick_s = self._world.history.tick_s
        if now - max(self.pressed_s, self._silence_s, flying_since) > 1.0 + tick_s:
            self._run_on("somebody wants the end")
        if now - max(self._tilted_s, self._silence_s, flying_since) > 1.0 + tick_s:
            self._run_on("it leans beyond the limit")
        if now - self._gone_s > 1.5 + tick_s:
            self._run_on(f"{self._others} heartbeats in a row show another mode")
        if self._lost_s > flying_since and now > self._lost_s + 1.0 + tick_s:
            self._run_on("the link was lost")
        heard_since = max(self._break_s, flying_since)
        if now - self._heard_s > CLOSE_S:
            return
        if now - max(self._block_s, heard_since) > 1.5 + 1.5 + tick_s:
            self._run_on("its log is dead")
        if now - max(self._fresh_down_s, heard_since) > 3.0 + tick_s:
            self._run_on("what is heard is late")
        if now - max(self._fresh_up_s, flying_since, self._silence_s) > LOST_AFTER_S + 3.0 + tick_s:
            self._run_on("what is sent is late, or lost")

    def _run_on(self, words: str) -> None:
        if not any(breach.rule == "run on" for breach in self.breaches):
            self.broken("run on", f"the run goes on although {words}")

    # the end

    def at_the_end(self, said: str) -> None:
        world, vehicle, flown = self._world, self._world.vehicle, self._flown
        if flown is None:
            return
        unknown = any(words in said for words in NOT_KNOWN)
        excited = vehicle.excited_by == "us"
        if excited and not unknown:
            self._unless_deceived("end", f"the vehicle is left excited, and what is said is: {said}")
        if world.starts_under_way and not unknown:
            self._unless_deceived("end", f"a start is under way, and what is said is: {said}")
        given_up = "must take it" in said or "pilot, look" in said  # after half a minute of orders
        if excited and self._unanswered >= 3 and not given_up:
            self.broken("end", f"{self._unanswered} heartbeats with the excitation were not answered with an order")
        ends = list(self._flown_by)
        for run in world.flight.runs:
            self._as_flown(run, ends)
        if not said.strip("; ") and not vehicle.foreign and not excited:
            self._settings_are_back()

    def _as_flown(self, run: Any, ends: list[tuple[Any, float, _Sweep | None]]) -> None:
        """`ends` are those of this run and of later ones; one plan may have been flown several times."""
        ended = next((end for end in ends if end[0] is run.plan), None)
        if ended is not None:
            del ends[: ends.index(ended) + 1]
        card = self._world.history.card
        if run.ending.value != "finished" or (card and run.verdict is not None and not run.verdict.clean):
            return
        assert ended is not None
        _, ended_s, sweep = ended
        if sweep is None:
            return  # somebody else excited it, or a stranger says so
        if min(sweep.over_s, ended_s) - sweep.entered_s < run.plan.over_s - 1.0 and sweep.over_s >= ended_s:
            self.broken("flown", f"it is finished {ended_s - sweep.entered_s:.1f} s after it began")
        elif sweep.told or (card and sweep.otherwise):
            names = ", ".join(sorted(sweep.told | (sweep.otherwise if card else set())))
            self.broken("flown", f"it is finished, and {names} were not as shown")

    def _settings_are_back(self) -> None:
        own, vehicle = _parameters(self._world.history.own), self._world.vehicle
        changed = [name for name, value in own.items() if vehicle.parameters[name] != value]
        if changed:
            self.broken("end", f"the vehicle has other settings than before, and nothing is said: {changed}")


# ------------------------------------------------------------------------------------------------ one history


@cache
def _profile() -> VehicleProfile:
    """The bundled vehicle's, with no more parameters than the rules need."""
    profile = next(p for p in bundled_profiles() if p.kinds)
    kept = ("axis", "amplitude", "f_start_hz", "kind")
    return replace(profile, parameters={word: profile.parameters[word] for word in kept})


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a history came to."""

    breaches: tuple[Breach, ...]
    counts: Counter[str]
    story: tuple[tuple[float, str, str], ...] = ()


def play(history: History, code: Code = REAL, *, story: bool = False) -> Outcome:
    """Let it happen, and judge it."""
    world = World(history, code, story=story)
    ended = ""
    try:
        ended = _fly(world)
    except TimeoutError:
        world.judge.broken("hang", f"not ended after {LONGEST_S:g} s")
    except KeyboardInterrupt:
        ended = "interrupted"
    except TippathError as error:
        world.counts["nothing flown"] += 1
        world.tell("ground", str(error))
    _count(world, ended)
    said = _said(world)
    world.tell("ground", f"ends and says: {said}")
    world.judge.at_the_end(said)
    return Outcome(tuple(world.judge.breaches), world.counts, tuple(world.story or ()))


class _Blind:
    """What somebody at the app wishes, of what concerns a vehicle that is not heard; after an end by hand that was
    followed by one the card goes on, once."""

    def __init__(self, world: World) -> None:
        self._world = world

    def chosen(self) -> int | None:
        return None

    def again(self, result: Any) -> bool:
        if not self._world.blind:
            return False
        self._world.blind, self._world.pressed, self._world.judge.pressed_s = False, 0, math.inf
        return True

    def blind(self) -> bool:
        return self._world.blind


def _fly(world: World) -> str:
    history, sweep = world.history, world.code.sweep
    card = TestCard(name="rules", maneuvers=tuple(FLOWN[number] for number in history.runs), rest_s=0.5)
    clock, folder, limits = _Time(world), _Folder(), Limits()

    def on_progress(progress: Any) -> None:
        if type(progress).__name__ == "Note":
            world.notes.append(progress.words)
            world.tell("ground", f"says: {progress.words}")

    def aborted() -> str | None:
        enough = world.flight is not None and len(world.flight.runs) > 2 * len(history.runs)
        return "Ctrl-C" if world.pressed else "enough" if enough else None

    if history.whole:
        world.advance(2.0)
        made, alone = sweep._Flight, sweep.flown_into
        sweep._Flight = lambda **more: _kept(world, made(**more))
        sweep.flown_into = lambda *_: contextlib.nullcontext()
        try:
            sweep.fly_card(
                world, card, _profile(), limits, folder=folder, on_progress=on_progress, aborted=aborted,
                interruptions=lambda: world.pressed, clock=clock, disk_free=lambda path: None,
                log="card" if history.card else "stream", choosing=_Blind(world),
            )  # fmt: skip
        finally:
            sweep._Flight, sweep.flown_into = made, alone
        return world.flight.stopped
    planned = tuple((run, _profile().plan(run.maneuver)) for run in card.runs())
    own = _parameters(history.own)
    asked = {name: own[name] for name in _profile().settings}
    flight = sweep._Flight(
        session=world,
        card=card,
        profile=_profile(),
        limits=limits,
        planned=planned,
        folder=folder,
        loss=LinkLoss("", None),
        about={},
        clock=clock,
        on_progress=on_progress,
        log="card" if history.card else "stream",
        before=FlownBefore(own=asked),
        choosing=_Blind(world),
    )
    world.flight = flight
    with flight:
        world.advance(2.5)
        if world.snapshot().mode != history.mode_before:
            raise TippathError("another mode than the pilot's: nothing is flown")
        flight.fly(asked, aborted, lambda: world.pressed)
    return flight.stopped


def _kept(world: World, flight: Any) -> Any:
    world.flight = flight
    return flight


def _said(world: World) -> str:
    flight = world.flight
    if flight is None:
        return ""
    parts = [flight.stopped, *world.notes]
    if flight.handback.flown is not None:
        parts.append(flight.handback.flown.state.reason)
        if (
            not flight.handback.flown.state.cleared
            and flight.handback.flown.state.asks
            and flight.handback.flown.state.ending is None
        ):
            parts.append("(no ending)")
    return "; ".join(filter(None, parts))


def _count(world: World, ended: str) -> None:
    counts, flight = world.counts, world.flight
    counts["histories"] += 1
    counts["seconds"] += round(world.now)
    if flight is None:
        return
    for run in flight.runs:
        counts[f"ended: {run.ending.value}"] += 1
        counts["mode not known after"] += run.mode_after == "unknown"
    if flight.handback.flown is not None:
        state = flight.handback.flown.state
        counts["with contradicting heartbeats"] += state.contradictions > 0
        counts["not cleared"] += not state.cleared
        counts["showed again after it had left"] += "showed again" in state.reason
    counts["settings not given back"] += flight.handback.unrestored is not None
    counts["left excited, and so said"] += world.vehicle.excited_by == "us"


def history_of(kind: str, seed: int) -> History:
    """`random`, `hard`, `twin`, `card`, `blind`, or `whole` (a random one through fly_card)."""
    made = {"hard": hard_history, "twin": twin_history, "card": card_history, "blind": blind_history}.get(kind)
    return random_history(seed, whole=kind == "whole") if made is None else made(seed)


def shown_by(name: str) -> tuple[History, tuple[str, ...]] | None:
    """The history that is known to show that the guard of this name is gone, and what is removed in it: the guard, and
    those that stand behind it. None where none is known."""
    if name in MADE_FOR:
        return MADE_FOR[name], (name,)
    if name in SEEN_IN:
        return history_of(*SEEN_IN[name]), (name,)
    for names, seen_in in SEEN_TOGETHER.items():
        if name in names:
            return seen_in if isinstance(seen_in, History) else history_of(*seen_in), names
    return None


def needed_in(history: History, mutations: Sequence[Mutation]) -> tuple[tuple[str, ...], Breach | None]:
    """Of guards that are removed together, those without which the history breaks a rule: none can be put back without
    the rule holding again. Empty where it breaks none."""
    breaches = play(history, mutated(*mutations)).breaches
    if not breaches:
        return (), None
    needed = list(mutations)
    for mutation in mutations:
        fewer = [other for other in needed if other is not mutation]
        broken = play(history, mutated(*fewer)).breaches
        if broken:
            needed, breaches = fewer, broken
    return tuple(mutation.name for mutation in needed), breaches[0]


SHORT_S = 1.5
"""How long one part of a short history lasts."""


def short_histories(parts: int) -> Iterator[History]:
    """All of them: in each part, each way of the link carries, holds back until a later part, or loses; and the pilot
    does nothing, takes over, goes back, or somebody aborts, at the beginning of one part."""
    people: list[tuple[Act, ...]] = [()]
    for part in range(parts):
        at_s = SHORT_S * part + 0.3
        people += [(Act(at_s, "mode", mode),) for mode in (STABILIZE, RTL)] + [(Act(at_s, "abort"),)]
    for up in itertools.product("-|x", repeat=parts):
        for down in itertools.product("-|x", repeat=parts):
            for acts in people:
                yield History(up=_short_way(up), down=_short_way(down), acts=acts, tick_s=0.25, attitude_s=0.5)


def _short_way(parts: Sequence[str]) -> Way:
    """`-` carries, `|` holds back until the next part that carries, 10 s at most, `x` loses."""
    delays, outages = [], []
    for number, part in enumerate(parts):
        begin = SHORT_S * number - 0.001
        if part == "x":
            outages.append((begin, begin + SHORT_S))
        later = next((n for n in range(number, len(parts)) if parts[n] == "-"), len(parts) + 2)
        delays.append((begin, SHORT_S * (later - number) if part == "|" else 0.05))
    return Way(delays=(*delays, (SHORT_S * len(parts), 0.05)), outages=tuple(outages))


def in_words(counts: Counter[str]) -> str:
    """What happened, a line each."""
    return "\n".join(f"  {count:10,d}  {name}" for name, count in sorted(counts.items()) if count)


def told(history: History, outcome: Outcome) -> str:
    """A failing history, to be read."""
    lines = [f"history {history.seed}{' (whole)' if history.whole else ''}: " + _differences(history)]
    lines += [f"{at:8.2f}  {who:8s} {words}" for at, who, words in outcome.story]
    return "\n".join(lines)


def _differences(history: History) -> str:
    plain = History()
    return ", ".join(
        f"{f.name}={getattr(history, f.name)}"
        for f in fields(History)
        if getattr(history, f.name) != getattr(plain, f.name)
    )


def shrunk(history: History, code: Code = REAL) -> History:
    """A simpler history that breaks a rule of the same name."""
    rules = {breach.rule for breach in play(history, code).breaches}
    again = True
    while again:
        again = False
        for simpler in _simpler(history):
            if rules & {breach.rule for breach in play(simpler, code).breaches}:
                history, again = simpler, True
                break
    return history


def _simpler(history: History) -> Iterator[History]:
    for at in range(len(history.acts)):
        yield replace(history, acts=history.acts[:at] + history.acts[at + 1 :])
    for side in ("up", "down"):
        way: Way = getattr(history, side)
        for part in ("delays", "losses", "outages"):
            steps = getattr(way, part)
            for at in range(len(steps)):
                yield replace(history, **{side: replace(way, **{part: steps[:at] + steps[at + 1 :]})})
        for part, plain in (("repeats", 0.0), ("swaps", 0.0), ("loss", 0.0)):
            if getattr(way, part) != plain:
                yield replace(history, **{side: replace(way, **{part: plain})})
    plain_history = History()
    for name in ("runs", "failsafe_s", "refuses", "never_leaves", "shows_at_once", "mode_before", "own", "stop_s"):
        if getattr(history, name) != getattr(plain_history, name):
            yield replace(history, **{name: getattr(plain_history, name)})


__all__ = [
    "MADE_FOR", "MUTATIONS", "SEEN_IN", "SEEN_TOGETHER", "Act", "Breach", "History", "Mutation", "Outcome", "Way",
    "World", "guards", "history_of", "in_words", "mutated", "needed_in", "play", "random_history", "short_histories",
    "shown_by", "shrunk", "told",
]  # fmt: skip

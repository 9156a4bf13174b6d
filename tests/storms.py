"""Random storms over whole flights, and what was claimed of each against what the simulated vehicle did.

A storm is a script as `tippath sim --faults` reads it, drawn from a seed: several faults with random times, over a card
of two short runs or over a push of gains. The commands themselves fly it, in fake time (`tests/slow_flight.py`).
Judged afterwards, by the vehicle's state, its own logs and what passed the air, never by what the ground believed:

- **end**: the vehicle is not left in the excitation where three heartbeats that showed it were heard after its run was
  to end and anything of ours was delivered; where it is left there, the words say so or that it is not known.
- **complete**: never said, and no exit status 0, where `flight.BIN` is not the vehicle's own log byte for byte; blocks
  that differ from it are those that are called missing, or said to be doubtful.
- **verdict**: a run that is kept, or that finished, was flown: that axis, that magnitude, to its end.
- **mode**: a run ends with a mode that the vehicle had since, or with words.
- **starts**: no more sweeps than runs that are told of.
- **parameters**: as found, or said not to be.
- **push**: the bank that flies is one whole set, the one that is claimed.
- **ended**: without a traceback, and not after more than `LONGEST_S`.

Heartbeats of another vehicle on the same link, with the same id, cannot be told from the vehicle's own without a key:
in such a storm **end**, **mode** and **starts** are counted as `excused`.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import random
import re
import struct
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

import pytest
from loops_in_time import TABLE_4, Late, gains_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from slow_flight import RADIO, SlowFlight

from gcs.flight.gains import BANK, COMMIT, SHADOW
from gcs.flight.gains import gains_of as read_gains
from gcs.link.events import float_of_bits
from sitl.autopilot.modes import Mode

CARD = """
name = "storm"
rest_s = 1
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.08
duration_s = 3
f_start_hz = 1
noise_fraction = 0
fade_in_s = 0.5
[[maneuver]]
kind = "chirp"
axis = "pitch"
amplitude = 0.08
duration_s = 3
f_start_hz = 1
noise_fraction = 0
fade_in_s = 0.5
"""
LONGEST_S = 900.0
BLOCK = 200
LAST_MOMENT = 40_000
"""Bytes of a log: half a second."""
FAST = 400_000.0
"""Bytes a second of a link that carries the log."""
NOT_KNOWN = (
    *(
        "must take it",
        "`tippath abort` ends it",
        "does not tell whether it is out",
        "what the vehicle does is not known",
    ),
    *("still arrives is not known", "is excited is not known", "could not be told otherwise"),
)
NOT_BACK = ("parameters stay in the vehicle", "not as it was before", "may not be as before", "is not put back")
SETTINGS = ("SID_AXIS", "SID_MAGNITUDE", "SID_F_START_HZ", "SID_F_STOP_HZ", "SID_T_REC", "SID_T_FADE_IN", "SIDX_KIND")

Kind = Literal["card", "telemetry", "push"]
"""A card whose log is streamed, one whose log stays on the vehicle's card, a set of gains."""


@dataclass(frozen=True, slots=True)
class Storm:
    """One flight's bad luck. The same storm passes the same way again."""

    seed: int
    kind: Kind
    script: str


def random_storm(seed: int) -> Storm:
    """One to four faults at random times; every fifth over a push, every tenth over a card without the log's stream."""
    chance = random.Random(f"storm {seed}")
    kind: Kind = "push" if seed % 5 == 4 else "telemetry" if seed % 10 == 7 else "card"
    given: dict[str, list[str]] = {}
    for _ in range(chance.choice((1, 2, 2, 3, 3, 4))):
        name = chance.choices(tuple(FAULTS), [weight for weight, _ in FAULTS.values()])[0]
        given.setdefault(name, []).append(FAULTS[name][1](chance, kind))
    if "bandwidth" in given and chance.random() < 0.3:
        given["queue"] = [str(chance.choice((600, 2000, 60_000)))]
    lines = [f"{name} = {json.dumps(words[0] if name == 'queue' else words)}" for name, words in given.items()]
    return Storm(seed, kind, "\n".join(lines) + "\n")


def _moment(chance: random.Random, kind: Kind) -> str:
    if kind == "push":
        return f"{chance.uniform(1, 12):.2f}"
    return f"sweep+{chance.uniform(-1, 16):.2f}" if chance.random() < 0.7 else f"{chance.uniform(1, 24):.2f}"


def _window(chance: random.Random, kind: Kind) -> str:
    """From a moment on, for 0.3 s to a minute and more."""
    zero, plus, start = _moment(chance, kind).rpartition("+")
    stop = float(start) + math.exp(chance.uniform(math.log(0.3), math.log(75.0)))
    return f"{zero}{plus}{start}:{stop:.2f}"


def _during(words: Callable[[random.Random], str], always: float = 0.0) -> Callable[[random.Random, Kind], str]:
    """The fault's word in a window, or with a chance of `always` from beginning to end."""

    def word(chance: random.Random, kind: Kind) -> str:
        text = words(chance)
        return text if chance.random() < always else f"{text}@{_window(chance, kind)}"

    return word


def _between(low: float, high: float) -> Callable[[random.Random], str]:
    return lambda chance: f"{math.exp(chance.uniform(math.log(low), math.log(high))):.4g}"


def _one_of(*words: str) -> Callable[[random.Random], str]:
    return lambda chance: chance.choice(words)


def _station(chance: random.Random, kind: Kind) -> str:
    order = chance.choice(("log", "SID_MAGNITUDE=0.2", "SID_AXIS=11", "SID_AXIS=0", "SID_T_REC=9"))
    return f"{order}@{_moment(chance, kind)}"


def _log_stop(chance: random.Random, kind: Kind) -> str:
    return _moment(chance, kind) + chance.choice(("", ",silent", ",resumes", ",silent,resumes"))


def _second_vehicle(chance: random.Random, kind: Kind) -> str:
    when = _moment(chance, kind) if chance.random() < 0.6 else _window(chance, kind)
    return f"{chance.choice(('stabilize', 'rtl', 'land'))}@{when}"


def _impostor(chance: random.Random, kind: Kind) -> str:
    texts = ("SystemID Finished", "SystemID Stopped", "Log stream stopped: buffer full")
    block = f"block={chance.choice((0, 7, chance.randrange(3000), 60_000, 2**31))}"
    words = ("heartbeat=stabilize", "heartbeat=rtl", f"text={chance.choice(texts)}", block, block, "mode=rtl", "log")
    return f"{chance.choice(words)}@{_moment(chance, kind) if chance.random() < 0.7 else _window(chance, kind)}"


FAULTS: dict[str, tuple[float, Callable[[random.Random, Kind], str]]] = {
    "loss": (2, _during(_between(0.02, 0.6), 0.3)),
    "outage": (5, _during(_one_of("up", "down", "both", "both"))),
    "lag": (1, _during(_between(0.05, 4.0), 0.1)),
    "lag-up": (1, _during(_between(0.05, 4.0))),
    "lag-down": (1, _during(_between(0.05, 4.0))),
    "jitter": (1, _during(_between(0.02, 0.6), 0.3)),
    "bandwidth": (1, _during(_between(1500, 60_000), 0.1)),
    "duplicate": (1, _during(_between(0.02, 0.5), 0.5)),
    "reorder": (1, _during(_between(0.02, 0.3), 0.5)),
    "corrupt": (1, _during(_between(0.01, 0.3), 0.5)),
    "second-vehicle": (1, _second_vehicle),
    "other-station": (2, _station),
    "log-stops": (1, _log_stop),
    "log-slows": (1, _during(_between(5_000, 70_000))),
    "alter-writes": (1, _during(_between(0.05, 1.0), 0.3)),
    "refuse-writes": (1, _during(_between(0.05, 1.0), 0.3)),
    "reboot": (1, _moment),
    "clock-step": (1, lambda chance, kind: f"{_between(0.1, 5000)(chance)}@{_moment(chance, kind)}"),
    "gyro-nan": (1, _window),
    "forge": (2, _impostor),
    "spoof": (1, _impostor),
}
"""How often each is drawn, and its word."""
TWINS = ("second-vehicle", "heartbeat=")
"""What nobody can tell from the vehicle's own heartbeats."""


@dataclass(slots=True)
class Sweep:
    """A stay in the excitation mode, as the vehicle had it."""

    start_s: float
    axis: float
    magnitude: float
    flown: bool = False
    """To the maneuver's end."""
    left_s: float = math.inf


@dataclass(slots=True)
class Seen:
    """What happened. Times are s of fake time."""

    sweeps: list[Sweep] = field(default_factory=list)
    modes: list[tuple[float, Mode]] = field(default_factory=list)
    """At every change."""
    beats: list[tuple[float, int]] = field(default_factory=list)
    """Heartbeats of the vehicle's that reached the ground, and their mode."""
    delivered: list[float] = field(default_factory=list)
    """When anything of the ground's reached the vehicle."""


@dataclass(slots=True)
class Outcome:
    """A storm that passed."""

    storm: Storm
    status: int
    said: str
    claims: dict[str, Any]
    """The JSON that the command printed; empty where none came."""
    breaches: list[str] = field(default_factory=list)
    excused: list[str] = field(default_factory=list)

    def told(self) -> str:
        breaches = [f"  BROKEN {words}" for words in self.breaches]
        words = [f"storm {self.storm.seed} ({self.storm.kind}):", self.storm.script, *breaches, f"  exit {self.status}"]
        return "\n".join([*words, self.said])


class _Watcher:
    """Looks at the vehicle after every turn, and at what passes its link."""

    def __init__(self, flown: SlowFlight) -> None:
        self.seen = Seen()
        self._flown = flown
        self._sweep: Any = None
        self._end_s = flown.now() + LONGEST_S
        self._mav = mavlink.MAVLink(None)
        receive, send = flown.air.receive, flown.wire.send

        def delivered() -> list[Any]:
            packets = receive()
            self.seen.delivered += [flown.now() for address, _ in packets if address == RADIO]
            return packets

        def sent(address: Any, data: bytes) -> None:
            send(address, data)
            if address == RADIO:
                self._hear(data)

        flown.air.receive = delivered  # type: ignore[method-assign]
        flown.wire.send = sent  # type: ignore[method-assign]

    def _hear(self, data: bytes) -> None:
        if data[7:10] != b"\x00\x00\x00":
            return
        with contextlib.suppress(mavlink.MAVError, struct.error):
            message = self._mav.decode(bytearray(data))
            self.seen.beats.append((self._flown.now(), message.custom_mode))

    def __call__(self) -> None:
        now, vehicle, seen = self._flown.now(), self._flown.vehicle, self.seen
        if now > self._end_s:
            raise TimeoutError(f"it has not ended after {LONGEST_S:.0f} s")
        if not seen.modes or seen.modes[-1][1] is not vehicle.mode:
            seen.modes.append((now, vehicle.mode))
        sweep = vehicle.systemid.sweep
        if sweep is not self._sweep:
            if self._sweep is not None:
                seen.sweeps[-1].left_s = now
            if sweep is not None:
                axis, magnitude = (vehicle.parameters[name] for name in ("SID_AXIS", "SID_MAGNITUDE"))
                seen.sweeps.append(Sweep(sweep.start_us * 1e-6, axis, magnitude))
            self._sweep = sweep
        if sweep is not None and sweep.lead_out > 0:
            seen.sweeps[-1].flown = True


# ------------------------------------------------------------------------------------------------ flown


def play(
    storm: Storm, folder: Path, card: str = CARD, prepare: Callable[[SlowFlight], None] = lambda flown: None
) -> Outcome:
    """Fly it in fake time, with its files in a new `folder`, and judge it; `prepare` does more to the flight."""
    folder.mkdir()
    with pytest.MonkeyPatch.context() as patched:
        flown = SlowFlight(
            patched,
            "hover-ideal",
            None,
            folder / "sd",
            bytes_s=FAST,
            on_ground=storm.kind == "push",
            script=storm.script,
            seed=storm.seed,
        )
        prepare(flown)
        (folder / "card.toml").write_text(card)
        return _push(storm, flown, folder) if storm.kind == "push" else _fly(storm, flown, folder)


def _commanded(flown: SlowFlight, watcher: _Watcher, *words: str | Path) -> tuple[int, str, str, str]:
    """Exit status, standard output and error, and the traceback where there was one."""
    out, err = io.StringIO(), io.StringIO()
    flown.between = watcher
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = flown.tippath(str(words[0]), *words[1:])
        broken = ""
    except BaseException as error:  # whatever escapes is what is looked for
        if isinstance(error, KeyboardInterrupt):
            raise
        status, broken = -1, "".join(traceback.format_exception(error)[-3:])
    flown.between = lambda: None
    return status, out.getvalue(), err.getvalue(), broken


def _outcome(storm: Storm, status: int, out: str, err: str) -> Outcome:
    """With what was said to people: standard error, and of the document the sentences about the end."""
    claims = json.loads(out) if out.strip() else {}
    runs = [f"{run['label']} {run['ending']} {run['reason']} {run['mode_after']}" for run in claims.get("runs", ())]
    problems = (claims.get("recording") or {}).get("problems", ())
    words = "\n".join([err, claims.get("stopped", ""), *runs, *problems])
    return Outcome(storm, status, " ".join(words.split()), claims)


def _fly(storm: Storm, flown: SlowFlight, folder: Path) -> Outcome:
    before = {name: flown.vehicle.parameters[name] for name in SETTINGS}
    watcher = _Watcher(flown)
    words: list[str | Path] = ["sweep", "--card", folder / "card.toml", "-o", folder / "flight", "--json"]
    words += ["--log", "card"] if storm.kind == "telemetry" else ["--no-probe"]
    status, out, err, broken = _commanded(flown, watcher, *words)
    over_s = flown.now()
    flown.close()
    outcome = _outcome(storm, status, out, err)
    if broken:
        outcome.breaches.append(f"ended: {broken}")
        return outcome
    after = {name: flown.vehicle.parameters[name] for name in SETTINGS}
    foreign = {word.partition("=")[0] for word in storm.script.replace('"', " ").split() if "=" in word}
    twins = any(word in storm.script for word in TWINS)
    outcome.breaches += judged_log(outcome, folder)
    outcome.breaches += judged_runs(outcome.claims, watcher.seen)
    outcome.breaches += judged_parameters(before, after, foreign, outcome.said)
    by_mode = judged_modes(outcome, watcher.seen, flown.vehicle.mode, over_s)
    (outcome.excused if twins else outcome.breaches).extend(by_mode)
    return outcome


# ------------------------------------------------------------------------------------------------ judged


def judged_log(outcome: Outcome, folder: Path) -> list[str]:
    """Of a folder with `flight` and the vehicle's own `sd`: what was said to be there, and is not."""
    claims = outcome.claims
    told: Mapping[str, Any] = claims.get("recording") or {}
    own = [path.read_bytes() for path in sorted((folder / "sd").glob("*.BIN"))]
    broken = []
    for log in told.get("logs", ()):
        streamed = (folder / "flight" / log["path"]).read_bytes()
        mine = max(own, key=lambda one: _alike(one, streamed))
        # What a vehicle wrote in the last moment before it began anew nobody on the ground can know of.
        cut = log["end_cause"] == "restart" and mine.startswith(streamed) and len(mine) - len(streamed) < LAST_MOMENT
        if (claims.get("complete") or log["complete"]) and streamed != mine and not cut:
            broken.append(f"complete: {log['path']} is not the vehicle's own log")
        missing = {n for first, last in log["missing"] for n in range(first, last + 1)}
        wrong = [n for n in range(len(streamed) // BLOCK) if _block(streamed, n) != _block(mine, n)]
        wrong = [n for n in wrong if n not in missing]
        if len(wrong) > log["in_two_versions"]:
            broken.append(f"complete: {log['path']} has {len(wrong)} other blocks than the vehicle's, from {wrong[0]}")
    if outcome.status == 0 and not claims.get("complete") and outcome.storm.kind == "card":
        broken.append("complete: exit status 0 without it")
    if claims.get("complete") and len(claims["runs"]) != claims["planned"]:
        broken.append(f"complete: {len(claims['runs'])} of {claims['planned']} runs")
    return broken


def _block(log: bytes, number: int) -> bytes:
    return log[number * BLOCK : (number + 1) * BLOCK]


def _alike(own: bytes, streamed: bytes) -> int:
    """So many blocks of one are the other's. Logs of one vehicle begin alike: their first half is not enough."""
    return sum(_block(own, n) == _block(streamed, n) for n in range(len(streamed) // BLOCK))


def judged_runs(claims: Mapping[str, Any], seen: Seen) -> list[str]:
    """Runs that are claimed to be flown, and were not so; sweeps that nobody tells of."""
    broken = []
    for run in claims.get("runs", ()):
        asked = [run["parameters"][name] for name in ("SID_AXIS", "SID_MAGNITUDE")]
        flown = [one for one in seen.sweeps if one.flown and _same(asked, (one.axis, one.magnitude))]
        if run["log_start_s"] is not None:
            within_s = 0.05 + run["log_start_within_s"]
            flown = [one for one in flown if abs(one.start_s - run["log_start_s"]) <= within_s]
        kept = run["verdict"] is not None and run["verdict"]["keep"]
        if (kept or run["ending"] == "finished") and not flown:
            worth = "kept" if kept else "finished"
            broken.append(f"verdict: {run['label']} is {worth}, and was not flown so: {seen.sweeps}")
    return broken


def _same(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(math.isclose(a, b, rel_tol=1e-6) for a, b in zip(one, other, strict=False))


def judged_parameters(
    before: Mapping[str, float], after: Mapping[str, float], foreign: set[str], said: str
) -> list[str]:
    """Those that are not as found, were not written by anybody else, and were not said."""
    changed = [name for name in before if after[name] != before[name] and name not in foreign]
    if not changed or any(words in said for words in NOT_BACK):
        return []
    return [f"parameters: {', '.join(changed)} not as found, and not a word"]


def judged_modes(outcome: Outcome, seen: Seen, mode: Mode, over_s: float) -> list[str]:
    """How the flight ended, as against what was said of it; `over_s` is when the command did."""
    claims, broken = outcome.claims, []
    runs = claims.get("runs", ())
    if len(seen.sweeps) > len(runs):
        broken.append(f"starts: {len(seen.sweeps)} sweeps, {len(runs)} runs told")
    if mode is Mode.SYSTEMID:
        to_end_s = seen.modes[-1][0] + 6.0
        heard = sorted(at for at, shown in seen.beats if at > to_end_s and shown == Mode.SYSTEMID)
        ordered = [at for at in seen.delivered if heard[2:] and heard[2] < at]
        if ordered:
            broken.append(f"end: left in the excitation, {len(heard)} heartbeats of it heard until {over_s:.1f}")
        elif not any(words in outcome.said for words in NOT_KNOWN):
            broken.append("end: left in the excitation, and not a word")
    names = {one.name.replace("_", "").lower() for _, one in seen.modes}
    for run in runs:
        shown = run["mode_after"].replace(" ", "").lower()
        if shown not in (*names, "", "unknown"):
            broken.append(f"mode: {run['label']} ends in {run['mode_after']}, which the vehicle never was in")
    if runs and outcome.status == 0 and mode is not Mode.STABILIZE:
        broken.append(f"mode: exit status 0, in {mode.name}")
    return broken


# ------------------------------------------------------------------------------------------------ a push


@cache
def gains_document(input_cost: float) -> dict[str, Any]:
    """What `tippath design` writes, for the vehicle of Table 4."""
    K, L = gains_of(Late(dict(TABLE_4), {}, (), input_cost))
    return {
        "format": "tippath.gains/1",
        "K": K.tolist(),
        "observer_gain": L.tolist(),
        "prefilter": [[input_cost, 0.0], [0.0, input_cost]],
        "model": {"structure": "tpp", "parameters": dict(TABLE_4)},
    }


def _push(storm: Storm, flown: SlowFlight, folder: Path) -> Outcome:
    """Set B over set A, or over none where the seed is even."""
    first, second = read_gains(gains_document(10.0)), read_gains(gains_document(30.0))
    vehicle = flown.vehicle
    before = None if storm.seed % 2 else tuple(float_of_bits(bits) for bits in first.bits)
    if before is not None:
        for name, value in zip(BANK, before, strict=True):
            vehicle.parameters.write(SHADOW + name, value, armed=False)
        vehicle.write_parameter(COMMIT, first.crc)
    assert vehicle.parameters.active_bank() == before
    (folder / "gains.json").write_text(json.dumps(gains_document(30.0)))
    status, out, err, broken = _commanded(flown, _Watcher(flown), "push", folder / "gains.json", "--json")
    flown.close()
    outcome = _outcome(storm, status, out, err)
    if broken:
        outcome.breaches.append(f"ended: {broken}")
    after, whole = vehicle.parameters.active_bank(), tuple(float_of_bits(bits) for bits in second.bits)
    outcome.breaches += judged_bank(before, after, whole, outcome)
    return outcome


Bank = tuple[float, ...] | None


def judged_bank(before: Bank, after: Bank, pushed: Bank, outcome: Outcome) -> list[str]:
    """The bank that flies after a push, as against what was there, what was sent, and what was said."""
    broken = []
    if after not in (before, pushed):
        broken.append("push: the active bank is a mixture")
    if outcome.status == 0 and after != pushed:
        broken.append("push: exit status 0, and the set does not fly")
    denied = re.search("nothing was (committed|written)|is as before", outcome.said)
    if outcome.status != 0 and after == pushed and denied:
        broken.append("push: it flies, and is said not to")
    return broken

"""What to fly: a maneuver, and a test card of maneuvers, read from TOML and believed only where every word makes sense.

A card is written once and flown with rotors turning, so reading it is strict: a key that does not exist, or means
nothing for that kind of maneuver, is an error that names it, never ignored.

Amplitudes are parts of full command. With `target = "rate"` a maneuver is added to the rate command instead, for a
controller to follow, and its amplitude is in rad/s.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

from gcs.cards.envelope import Limits
from gcs.errors import UsageError

KINDS = ("chirp", "doublet", "quiet")
AXES = ("roll", "pitch", "elevator")
TARGETS = ("command", "rate")
PURPOSES = ("fit", "validate", "noise", "build-up")

PULSES_PER_DOUBLET = 6
"""Two pulses and four of rest, so that the answer dies out before the next."""

_ONLY_CHIRP = ("f_start_hz", "f_stop_hz", "noise_fraction", "c1", "fade_in_s", "fade_out_s")
_ONLY_DOUBLET = ("pulse_s",)
_NUMBERS = {
    # key: smallest, largest that is not nonsense
    "amplitude": (0.0, 1.0),
    "duration_s": (1.0, 600.0),
    "f_start_hz": (0.05, 100.0),
    "f_stop_hz": (0.1, 200.0),
    "noise_fraction": (0.0, 2.0),
    "c1": (0.1, 20.0),
    "fade_in_s": (0.0, 60.0),
    "fade_out_s": (0.0, 60.0),
    "pulse_s": (0.02, 10.0),
}
MOST_RATE = 3.0  # rad/s asked of a controller


@dataclass(frozen=True, slots=True)
class Maneuver:
    """One maneuver; what is left out is the paper's Table 1."""

    kind: str
    """`chirp`, `doublet` or `quiet` (nothing is added: what is measured is noise)."""
    axis: str = "roll"
    """`roll`, `pitch` or `elevator`."""
    amplitude: float = 0.0
    """Of full command; rad/s where `target` is `rate`."""
    duration_s: float = 30.0
    target: str = "command"
    f_start_hz: float = 0.5
    f_stop_hz: float = 10.0
    noise_fraction: float = 0.2
    """Deviation of the white noise over the amplitude, before its low-pass at f_stop_hz."""
    c1: float = 4.0
    """How the chirp spends its time: the larger, the longer at low frequencies."""
    fade_in_s: float = 0.0
    fade_out_s: float = 0.0
    pulse_s: float = 0.25
    """A doublet's half: +amplitude for so long, then -amplitude for so long."""
    repeat: int = 1
    purpose: str = ""
    """`fit`, `validate`, `noise` or `build-up`; from the kind where left out."""

    def __post_init__(self) -> None:
        if not self.purpose:
            object.__setattr__(self, "purpose", {"chirp": "fit", "doublet": "validate"}.get(self.kind, "noise"))

    def problem(self) -> str | None:
        """Why this is nonsense, beginning with the key that is at fault; None where it is sound."""
        for key, allowed in (("kind", KINDS), ("axis", AXES), ("target", TARGETS), ("purpose", PURPOSES)):
            if getattr(self, key) not in allowed:
                return f"{key} is one of {', '.join(allowed)}, not {getattr(self, key)!r}"
        for key, (low, high) in _NUMBERS.items():
            value = getattr(self, key)
            top = MOST_RATE if key == "amplitude" and self.target == "rate" else high
            if not (math.isfinite(value) and low <= value <= top):
                return f"{key} is a number from {low:g} to {top:g}, not {value:g}"
        if not 1 <= self.repeat <= 50:
            return f"repeat is a whole number from 1 to 50, not {self.repeat}"
        if self.kind != "quiet" and self.amplitude == 0:
            return 'amplitude is 0: nothing would be flown (a run without excitation is kind = "quiet")'
        if self.kind == "quiet" and self.amplitude != 0:
            return "amplitude means nothing in a quiet run; leave it out"
        if self.kind == "chirp":
            return self._chirp_problem()
        if self.kind == "doublet" and self.duration_s < 2 * self.pulse_s:
            return f"duration_s: {self.duration_s:g} s are too short for two pulses of {self.pulse_s:g} s"
        return None

    def _chirp_problem(self) -> str | None:
        if self.target == "rate":
            return 'target = "rate" is for doublets; a chirp is added to the command'
        if not self.f_start_hz < self.f_stop_hz:
            return f"f_stop_hz: {self.f_stop_hz:g} Hz does not lie above f_start_hz, {self.f_start_hz:g} Hz"
        if self.duration_s <= 2 / self.f_start_hz:
            return (
                f"duration_s: {self.duration_s:g} s hold no two periods of f_start_hz; "
                f"at {self.f_start_hz:g} Hz it must be longer than {2 / self.f_start_hz:g} s"
            )
        if self.fade_in_s + self.fade_out_s > self.duration_s:
            return "fade_in_s and fade_out_s together are longer than duration_s"
        return None

    @property
    def is_table_1(self) -> bool:
        """Whether the signal's law is Table 1's in every number that the table gives."""
        law = (self.f_start_hz, self.f_stop_hz, self.noise_fraction, self.c1, self.fade_in_s, self.fade_out_s)
        return self.kind == "chirp" and law == (0.5, 10.0, 0.2, 4.0, 0.0, 0.0)

    @property
    def words(self) -> str:
        """`roll chirp`, `pitch rate doublet`, `quiet hover`."""
        if self.kind == "quiet":
            return "quiet hover"
        return f"{self.axis} {'rate ' if self.target == 'rate' else ''}{self.kind}"

    @property
    def size(self) -> str:
        """Its amplitude in words, without the unit: `A 0.10`; empty for quiet hover."""
        digits = 2 if abs(self.amplitude - round(self.amplitude, 2)) < 1e-9 else 3
        return "" if self.kind == "quiet" else f"A {self.amplitude:.{digits}f}"

    @property
    def numbers(self) -> str:
        """Its numbers in words: `0.5-10 Hz  30 s  A 0.10`."""
        amplitude = self.size + (" rad/s" if self.target == "rate" else "")
        match self.kind:
            case "chirp":
                return f"{self.f_start_hz:g}-{self.f_stop_hz:g} Hz  {self.duration_s:g} s  {amplitude}"
            case "doublet":
                return f"pulses of {self.pulse_s:g} s  {self.duration_s:g} s  {amplitude}"
            case _:
                return f"{self.duration_s:g} s"

    def to_json(self) -> dict[str, Any]:
        """Every number that means something for this kind."""
        return {key: getattr(self, key) for key in _keys_of(self.kind) if key != "repeat"}


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a build-up: a part of the amplitude, and, for chirps, a lower end of the sweep."""

    amplitude: float
    """Part of the maneuver's own, below 1."""
    f_stop_hz: float | None = None

    def of(self, maneuver: Maneuver) -> Maneuver:
        """The maneuver as this step flies it."""
        stop = maneuver.f_stop_hz
        if maneuver.kind == "chirp" and self.f_stop_hz is not None:
            stop = min(stop, self.f_stop_hz)
        return replace(
            maneuver, amplitude=maneuver.amplitude * self.amplitude, f_stop_hz=stop, repeat=1, purpose="build-up"
        )


@dataclass(frozen=True, slots=True)
class CardRun:
    """One run that a card asks for."""

    maneuver: Maneuver
    """With repeat 1."""
    label: str
    """`roll chirp 1/2`, `roll chirp 25 %`."""
    number: int
    """From 1, in the order flown."""
    of: int
    unlocks_at: float = 1.0
    """Amplitude of this run over that of the step before it, by which its peaks are expected to grow; 1 without one."""
    locked_by: int | None = None
    """The number of the run that must come out clean before this one is flown."""
    probe: bool = False
    """Flown before the card, to see whether the vehicle answers as it should (see `gcs.flight.probe`)."""


@dataclass(frozen=True, slots=True)
class TestCard:
    """Maneuvers in the order in which they are flown."""

    __test__ = False  # not a test, whatever pytest reads into its name

    name: str
    maneuvers: tuple[Maneuver, ...]
    description: str = ""
    rest_s: float = 2.0
    """Hover between two runs."""
    steps: tuple[Step, ...] = ()
    """Flown before each maneuver at full amplitude, in order; each unlocks the next."""
    limits: Limits = field(default_factory=Limits)
    text: str = field(default="", repr=False)
    """The TOML it was read from."""

    def runs(self) -> tuple[CardRun, ...]:
        """Every run in order: a maneuver's build-up steps, then its repeats."""
        planned: list[tuple[Maneuver, str, float, bool]] = []
        for maneuver in self.maneuvers:
            single = replace(maneuver, repeat=1)
            last = 0.0
            for step in self.steps if maneuver.kind != "quiet" else ():
                label = f"{maneuver.words} {100 * step.amplitude:.0f} %"
                planned.append((step.of(single), label, step.amplitude / last if last else 1.0, last > 0))
                last = step.amplitude
            for number in range(1, maneuver.repeat + 1):
                label = maneuver.words + (f" {number}/{maneuver.repeat}" if maneuver.repeat > 1 else "")
                stepped = last > 0 and number == 1
                planned.append((single, label, 1 / last if stepped else 1.0, stepped))
        total = len(planned)
        return tuple(
            CardRun(maneuver, label, number, total, growth, number - 1 if locked else None)
            for number, (maneuver, label, growth, locked) in enumerate(planned, start=1)
        )

    @property
    def duration_s(self) -> float:
        """About how long flying it takes: each run with its second of nothing before and after, and the rests."""
        return sum(run.maneuver.duration_s + 2.0 + self.rest_s for run in self.runs())


def preceded(runs: tuple[CardRun, ...], probes: tuple[CardRun, ...]) -> tuple[CardRun, ...]:
    """A card's runs with probes before them, numbered anew."""
    total, first = len(probes) + len(runs), len(probes)
    before = (replace(run, label=f"probe {run.maneuver.axis}", of=total, probe=True) for run in probes)
    after = (
        replace(
            run,
            number=first + run.number,
            of=total,
            locked_by=None if run.locked_by is None else first + run.locked_by,
        )
        for run in runs
    )
    return (*before, *after)


def single_card(maneuver: Maneuver) -> TestCard:
    """A card of one maneuver. Raises UsageError where it is nonsense."""
    problem = maneuver.problem()
    if problem is not None:
        raise UsageError(problem)
    card = TestCard(f"one {maneuver.words}", (maneuver,))
    return replace(card, text=card_text(card))


def card_text(card: TestCard) -> str:
    """The card as TOML that `parse_card` reads to the same card."""
    lines = [f"name = {_quoted(card.name)}"]
    if card.description:
        lines.append(f"description = {_quoted(card.description)}")
    lines.append(f"rest_s = {card.rest_s!r}")
    default, limits = Limits(), card.limits
    if limits != default:
        lines += ["", "[limits]", f"rate_rad_s = {limits.rate!r}", f"attitude_deg = {math.degrees(limits.attitude)!r}"]
        lines.append(f"command = {limits.command!r}")
    for step in card.steps:
        lines += ["", "[[step]]", f"amplitude = {step.amplitude!r}"]
        if step.f_stop_hz is not None:
            lines.append(f"f_stop_hz = {step.f_stop_hz!r}")
    for maneuver in card.maneuvers:
        lines += ["", "[[maneuver]]"]
        for key in _keys_of(maneuver.kind):
            value = getattr(maneuver, key)
            lines.append(f"{key} = {_quoted(value) if isinstance(value, str) else repr(value)}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    plain = "".join(c if c.isprintable() else " " for c in text)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _keys_of(kind: str) -> tuple[str, ...]:
    """The keys that mean something for a kind, in the order of the fields."""
    out = {"chirp": _ONLY_DOUBLET, "doublet": _ONLY_CHIRP}.get(kind, (*_ONLY_CHIRP, *_ONLY_DOUBLET))
    silent = (*out, "axis", "amplitude", "target") if kind == "quiet" else out
    return tuple(f.name for f in fields(Maneuver) if f.name not in silent)


# ------------------------------------------------------------------------------------------------ reading


def bundled_cards() -> dict[str, str]:
    """The cards that come with the package: name -> TOML."""
    folder = resources.files("gcs") / "cards"
    found = {entry.name: entry for entry in folder.iterdir() if entry.name.endswith(".toml")}
    return {name.removesuffix(".toml"): found[name].read_text("utf-8") for name in sorted(found)}


def load_card(word: str) -> TestCard:
    """A card by its file, or by the name of one that comes with the package.

    Raises UsageError that names the file, the maneuver and the key at fault.
    """
    path = Path(word)
    bundled = bundled_cards()
    if word in bundled and not path.is_file():
        return parse_card(bundled[word], f"card {word}")
    try:
        return parse_card(path.read_text("utf-8"), word)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        near = difflib.get_close_matches(word, bundled, 1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise UsageError(f"{word}: no such card; {hint}Give a TOML file, or one of {', '.join(bundled)}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{word}: cannot be read as a card ({error})") from error


def parse_card(text: str, source: str) -> TestCard:
    """A card from TOML text; `source` names it in messages. Raises UsageError as `load_card`."""
    try:
        document = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise UsageError(f"{source}: not TOML: {error}") from error
    _only(document, ("name", "description", "rest_s", "limits", "step", "maneuver"), source)
    name = _string(document, "name", Path(source).stem, source)
    rest_s = _number(document, "rest_s", 2.0, (0.0, 120.0), source)
    steps = tuple(
        _step(table, f"{source}, step {i}") for i, table in enumerate(_tables(document, "step", source), start=1)
    )
    parts = [step.amplitude for step in steps]
    if parts != sorted(set(parts)):
        raise UsageError(f"{source}: [[step]] amplitudes must grow from step to step")
    maneuvers = tuple(
        _maneuver(table, f"{source}, maneuver {i}")
        for i, table in enumerate(_tables(document, "maneuver", source), start=1)
    )
    if not maneuvers:
        raise UsageError(f"{source}: no [[maneuver]]; a card needs at least one")
    limits = _limits(document.get("limits", {}), f"{source}, [limits]")
    return TestCard(name, maneuvers, _string(document, "description", "", source), rest_s, steps, limits, text)


def _maneuver(table: Mapping[str, Any], where: str) -> Maneuver:
    kind = table.get("kind")
    if kind not in KINDS:
        raise UsageError(f"{where}: kind is one of {', '.join(KINDS)}, not {kind!r}")
    known = {f.name: f for f in fields(Maneuver)}
    _only(table, tuple(known), where)
    for key in table:
        if key not in _keys_of(kind):
            raise UsageError(f"{where}: {key} means nothing for a {kind}; leave it out")
    for key in ("amplitude", "duration_s", "axis"):
        if key not in table and key in _keys_of(kind):
            raise UsageError(f"{where}: {key} is missing")
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key in _NUMBERS:
            values[key] = _number(table, key, 0.0, None, where)
        elif key == "repeat":
            if isinstance(value, bool) or not isinstance(value, int):
                raise UsageError(f"{where}: repeat is a whole number, not {value!r}")
            values[key] = value
        else:
            values[key] = _string(table, key, "", where)
    maneuver = Maneuver(**values)
    problem = maneuver.problem()
    if problem is not None:
        raise UsageError(f"{where}: {problem}")
    return maneuver


def _step(table: Mapping[str, Any], where: str) -> Step:
    _only(table, ("amplitude", "f_stop_hz"), where)
    if "amplitude" not in table:
        raise UsageError(f"{where}: amplitude is missing")
    amplitude = _number(table, "amplitude", 0.0, (0.01, 0.99), where)
    return Step(amplitude, _number(table, "f_stop_hz", 0.0, (0.1, 200.0), where) if "f_stop_hz" in table else None)


def _limits(table: Any, where: str) -> Limits:
    if not isinstance(table, dict):
        raise UsageError(f"{where}: limits is a table")
    _only(table, ("rate_rad_s", "attitude_deg", "command"), where)
    default = Limits()
    return Limits(
        rate=_number(table, "rate_rad_s", default.rate, (0.05, 20.0), where),
        attitude=math.radians(_number(table, "attitude_deg", math.degrees(default.attitude), (1.0, 80.0), where)),
        command=_number(table, "command", default.command, (0.01, 1.0), where),
    )


def _only(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
            raise UsageError(f"{where}: unknown key {key!r}; {hint}")


def _tables(document: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    found = document.get(key, [])
    if not isinstance(found, list) or not all(isinstance(table, dict) for table in found):
        raise UsageError(f"{where}: {key} is written [[{key}]], once for each")
    return found


def _number(table: Mapping[str, Any], key: str, default: float, span: tuple[float, float] | None, where: str) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UsageError(f"{where}: {key} is a number, not {value!r}")
    number = float(value)
    if span is not None and not (math.isfinite(number) and span[0] <= number <= span[1]):
        raise UsageError(f"{where}: {key} is a number from {span[0]:g} to {span[1]:g}, not {value!r}")
    return number


def _string(table: Mapping[str, Any], key: str, default: str, where: str) -> str:
    value = table.get(key, default)
    if not isinstance(value, str):
        raise UsageError(f"{where}: {key} is text in quotes, not {value!r}")
    return value

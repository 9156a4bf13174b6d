"""What to fly: a maneuver, and a test card of maneuvers, read from TOML and believed only where every word makes sense.

A card is written once and flown with rotors turning, so reading it is strict: a key that does not exist, or means
nothing for that kind of maneuver, is an error that names it, never ignored. What a card's tables may hold stands once,
in the structs below; what numbers mean together is checked in `Maneuver.problem`, wherever a maneuver comes from.

Amplitudes are parts of full command. With `target = "rate"` a maneuver is added to the rate command instead, for a
controller to follow, and its amplitude is in rad/s.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from gcs import documents
from gcs.cards.checklist import Question, QuestionDocument
from gcs.cards.envelope import Limits
from gcs.document_faults import first_fault, nearest
from gcs.errors import UsageError

KINDS = ("chirp", "doublet", "quiet")
AXES = ("roll", "pitch", "elevator", "yaw")

PULSES_PER_DOUBLET = 6
"""Two pulses and four of rest, so that the answer dies out before the next."""

MOST_AMPLITUDE = 1.0  # of full command
MOST_RATE = 3.0  # rad/s asked of a controller


# ------------------------------------------------------------------------------------------------ what a card may hold

Seconds = Annotated[float, Meta(ge=0.0, le=60.0)]
Stop = Annotated[float, Meta(ge=0.1, le=200.0)]


class _Any(documents.Strict, frozen=True, kw_only=True):
    """Of every kind of maneuver; what the keys mean stands at `Maneuver`."""

    duration_s: Annotated[float, Meta(ge=1.0, le=600.0)]
    repeat: Annotated[int, Meta(ge=1, le=50)] = 1
    purpose: Literal["fit", "validate", "noise", "build-up"] | None = None


class _Excited(_Any, frozen=True, kw_only=True):
    axis: Literal["roll", "pitch", "elevator", "yaw"]
    target: Literal["command", "rate"] = "command"


class _Chirp(_Excited, frozen=True, kw_only=True, tag_field="kind", tag="chirp"):
    amplitude: Annotated[float, Meta(ge=0.0, le=MOST_AMPLITUDE)]
    f_start_hz: Annotated[float, Meta(ge=0.05, le=100.0)] = 0.5
    f_stop_hz: Stop = 10.0
    noise_fraction: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2
    c1: Annotated[float, Meta(ge=0.1, le=20.0)] = 4.0
    fade_in_s: Seconds = 0.0
    fade_out_s: Seconds = 0.0


class _Doublet(_Excited, frozen=True, kw_only=True, tag_field="kind", tag="doublet"):
    amplitude: Annotated[float, Meta(ge=0.0, le=MOST_RATE)]
    pulse_s: Annotated[float, Meta(ge=0.02, le=10.0)] = 0.25


class _Quiet(_Any, frozen=True, kw_only=True, tag_field="kind", tag="quiet"):
    pass


_TABLES = {"chirp": _Chirp, "doublet": _Doublet, "quiet": _Quiet}


class _Step(documents.Strict, frozen=True, kw_only=True):
    amplitude: Annotated[float, Meta(ge=0.01, le=0.99)]
    f_stop_hz: Stop | None = None


class _Limits(documents.Strict, frozen=True, kw_only=True):
    rate_rad_s: Annotated[float, Meta(ge=0.05, le=20.0)] = Limits().rate
    attitude_deg: Annotated[float, Meta(ge=1.0, le=80.0)] = math.degrees(Limits().attitude)
    command: Annotated[float, Meta(ge=0.01, le=1.0)] = Limits().command

    def limits(self) -> Limits:
        return Limits(self.rate_rad_s, math.radians(self.attitude_deg), self.command)


class CardDocument(documents.Strict, frozen=True, kw_only=True):
    """A card's TOML."""

    name: Annotated[str, Meta(max_length=200)] | None = None
    """The file's name where it is left out."""
    description: Annotated[str, Meta(max_length=2000)] = ""
    rest_s: Annotated[float, Meta(ge=0.0, le=120.0)] = 2.0
    limits: _Limits = _Limits()
    step: Annotated[tuple[_Step, ...], Meta(max_length=100)] = ()
    maneuver: Annotated[tuple[_Chirp | _Doublet | _Quiet, ...], Meta(max_length=1000)] = ()
    checklist: Annotated[tuple[QuestionDocument, ...], Meta(max_length=100)] = ()


# ------------------------------------------------------------------------------------------------ what is flown


@dataclass(frozen=True, slots=True, kw_only=True)
class Maneuver:
    """One maneuver; what is left out is the paper's Table 1."""

    kind: str
    """`chirp`, `doublet` or `quiet` (nothing is added: what is measured is noise)."""
    axis: str = "roll"
    """`roll`, `pitch`, `elevator` or `yaw`."""
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
        if self.kind == "quiet" and self.amplitude != 0:
            return "amplitude means nothing in a quiet run; leave it out"
        fault = first_fault(self._table(), _Chirp | _Doublet | _Quiet)
        if fault is not None:
            return fault.words()
        if self.target == "command" and self.amplitude > MOST_AMPLITUDE:
            return f"amplitude is a number from 0 to {MOST_AMPLITUDE:g}, not {self.amplitude:g}"
        if self.kind != "quiet" and self.amplitude == 0:
            return 'amplitude is 0: nothing would be flown (a run without excitation is kind = "quiet")'
        if self.kind == "chirp":
            return self._chirp_problem()
        if self.kind == "doublet" and self.duration_s < 2 * self.pulse_s:
            return f"duration_s: {self.duration_s:g} s are too short for two pulses of {self.pulse_s:g} s"
        return None

    def _chirp_problem(self) -> str | None:
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

    def _table(self) -> dict[str, Any]:
        """As a card writes it."""
        return {key: getattr(self, key) for key in _keys_of(self.kind)}

    @property
    def is_table_1(self) -> bool:
        """Whether the signal's law is Table 1's in every number that the table gives."""
        law = (self.f_start_hz, self.f_stop_hz, self.noise_fraction, self.c1, self.fade_in_s, self.fade_out_s)
        return self.kind == "chirp" and self.target == "command" and law == (0.5, 10.0, 0.2, 4.0, 0.0, 0.0)

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
        return {key: value for key, value in self._table().items() if key != "repeat"}


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


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
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
    checklist: tuple[Question, ...] = ()
    """To be answered before it is flown."""
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
            CardRun(
                maneuver=maneuver,
                label=label,
                number=number,
                of=total,
                unlocks_at=growth,
                locked_by=number - 1 if locked else None,
            )
            for number, (maneuver, label, growth, locked) in enumerate(planned, start=1)
        )

    @property
    def duration_s(self) -> float:
        """About how long flying it takes."""
        return duration_s(self.runs(), self.rest_s)


def duration_s(runs: Iterable[CardRun], rest_s: float) -> float:
    """About how long flying these takes: each with its second of nothing before and after, and a rest."""
    return sum(run.maneuver.duration_s + 2.0 + rest_s for run in runs)


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
    card = TestCard(name=f"one {maneuver.words}", maneuvers=(maneuver,))
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
    for question in card.checklist:
        lines += ["", "[[checklist]]", f"ask = {_quoted(question.ask)}", f"answer = {_quoted(question.kind)}"]
        lines += [f"unit = {_quoted(question.unit)}"] if question.unit else []
        lines += [
            f"{key} = {at!r}" for key, at in (("least", question.least), ("most", question.most)) if at is not None
        ]
    for maneuver in card.maneuvers:
        lines += ["", "[[maneuver]]"]
        for key in _keys_of(maneuver.kind):
            value = getattr(maneuver, key)
            lines.append(f"{key} = {_quoted(value) if isinstance(value, str) else repr(value)}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    plain = "".join(c if c.isprintable() else " " for c in text)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


@cache
def _keys_of(kind: str) -> tuple[str, ...]:
    """The keys that mean something for a kind, in the order of the fields."""
    known = _TABLES[kind].__struct_fields__ if kind in _TABLES else ()
    return tuple(f.name for f in fields(Maneuver) if f.name == "kind" or f.name in known)


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
    if path.is_dir() or not path.exists():
        hint = nearest(word, bundled)
        raise UsageError(
            f"{word}: no such card; {hint + ' ' if hint else ''}Give a TOML file, or one of {', '.join(bundled)}"
        )
    try:
        return parse_card(documents.read_text(path, "card"), word)
    except documents.DocumentError as error:
        raise UsageError(str(error)) from error


def parse_card(text: str, source: str) -> TestCard:
    """A card from TOML text; `source` names it in messages. Raises UsageError as `load_card`."""
    try:
        table = documents.parse_toml(text, CardDocument, source)
    except documents.DocumentError as error:
        raise UsageError(str(error)) from error
    parts = [step.amplitude for step in table.step]
    if parts != sorted(set(parts)):
        raise UsageError(f"{source}: [[step]] amplitudes must grow from step to step")
    if not table.maneuver:
        raise UsageError(f"{source}: no [[maneuver]]; a card needs at least one")
    checklist = tuple(one.question() for one in table.checklist)
    for i, problem in enumerate((one.problem for one in checklist), start=1):
        if problem is not None:
            raise UsageError(f"{source}: checklist {i}: {problem}")
    return TestCard(
        name=Path(source).stem if table.name is None else table.name,
        maneuvers=tuple(_maneuver(each, f"{source}: maneuver {i}") for i, each in enumerate(table.maneuver, start=1)),
        description=table.description,
        rest_s=table.rest_s,
        steps=tuple(Step(step.amplitude, step.f_stop_hz) for step in table.step),
        limits=table.limits.limits(),
        checklist=checklist,
        text=text,
    )


def _maneuver(table: _Chirp | _Doublet | _Quiet, where: str) -> Maneuver:
    keys = {key: value for key, value in msgspec.structs.asdict(table).items() if value is not None}
    maneuver = Maneuver(kind=str(type(table).__struct_config__.tag), **keys)
    problem = maneuver.problem()
    if problem is not None:
        raise UsageError(f"{where}: {problem}")
    return maneuver

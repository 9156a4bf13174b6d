"""The sealed answer of a vehicle with a hidden effect: opened, and held against what diagnoses had said.

The vehicle writes the file (`tippath sim --hidden`), another program in another process, so its layout is a format:

    8 bytes    TPSEAL1 and a line feed
    16 bytes   nonce
    32 bytes   SHA-256 of nonce and body
    the rest   the body, with a keystream laid over it by exclusive or; block i of the keystream (32 bytes, from 0) is
               SHA-256 of the nonce and i as 8 bytes big-endian
    the body   4 bytes big-endian: length of what follows; JSON in UTF-8, deflated (zlib); zeros as padding

It is a seal against peeking, not cryptography. The document (tippath.answer/1) says `plant`, `seed`, `hidden` (the
draw's name), `answer` (catalogue id or null), `accepts`, `sizes`, `expect` (catalogue parameter -> what it should come
near), `level` (catalogue, below, beyond, none), `condition` and `sentence`.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gcs import documents
from gcs.errors import TippathError, UsageError

FILE_NAME = "answer"
_MAGIC = b"TPSEAL1\n"
_HEAD = len(_MAGIC) + 16 + 32
FORMAT = "tippath.answer/1"
LARGEST = 1 << 20
"""Bytes of a sealed file, and of the document in it: an answer has two thousand."""


class _AnswerDocument(documents.Open, frozen=True, kw_only=True):
    plant: str
    seed: int
    hidden: str
    answer: str | None
    accepts: tuple[str, ...]
    sizes: dict[str, float]
    expect: dict[str, float]
    level: Literal["catalogue", "below", "beyond", "none"]
    condition: str
    sentence: str


class _Candidate(documents.Open, frozen=True, kw_only=True):
    effect: str | None = None
    parameters: dict[str, float | None] | None = None


class _Diagnosis(documents.Open, frozen=True, kw_only=True):
    """Of a diagnosis what is judged."""

    format: Literal["tippath.diagnosis/1"]
    verdict: str
    effect: str | None = None
    stands_in: bool = False
    candidates: tuple[_Candidate, ...] = ()
    indistinguishable: tuple[str, ...] = ()
    equivalent: dict[str, tuple[str, ...]] = {}


OUTCOMES = {
    "right": "right",
    "same": "accepted: physically the same on these data",
    "not_told_apart": "not told apart: the answer is among those that the data cannot tell from it",
    "stand_in": "named, but called implausible",
    "missed": "missed",
    "wrong": "wrong",
}
"""How a diagnosis came out, and its words."""


@dataclass(frozen=True)
class Answer:
    """What was hidden."""

    path: Path
    sha256: str
    """Of the file: what was printed when it was sealed."""
    document: Mapping[str, Any]

    @property
    def named(self) -> tuple[str, ...]:
        """The answer and what is accepted for it; none where the catalogue has none."""
        answer = self.document["answer"]
        return () if answer is None else (answer, *self.document["accepts"])


@dataclass(frozen=True)
class Judgement:
    """One diagnosis beside the truth."""

    path: Path
    verdict: str
    effect: str | None
    outcome: str
    """A key of `OUTCOMES`."""
    parameters: tuple[tuple[str, float, float], ...]
    """(name, what the diagnosis said, truth), where both are known."""

    def to_json(self) -> dict[str, Any]:
        return {
            "path": str(self.path),
            "verdict": self.verdict,
            "effect": self.effect,
            "outcome": self.outcome,
            "parameters": [{"name": name, "said": said, "truth": truth} for name, said, truth in self.parameters],
        }


def open_answer(directory: Path) -> Answer:
    """The answer in that folder. Raises UsageError where there is no folder, TippathError with the reason otherwise."""
    if not directory.is_dir():
        raise UsageError(f"there is no folder {directory}")
    path = directory / FILE_NAME
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except FileNotFoundError:
        raise TippathError(
            f"no answer is sealed in {directory}: it lies where `tippath sim --hidden` put its logs"
        ) from None
    except OSError as error:
        raise TippathError(f"{path} cannot be read ({error.strerror or error})") from error
    return Answer(path, hashlib.sha256(data).hexdigest(), _unsealed(path, data))


def _unsealed(path: Path, data: bytes) -> dict[str, Any]:
    if not data.startswith(_MAGIC) or len(data) > LARGEST:
        raise TippathError(f"{path} is no sealed answer of this program")
    nonce, digest, covered = data[len(_MAGIC) : len(_MAGIC) + 16], data[len(_MAGIC) + 16 : _HEAD], data[_HEAD:]
    stream = b"".join(
        hashlib.sha256(nonce + block.to_bytes(8, "big")).digest() for block in range(-(-len(covered) // 32))
    )
    body = bytes(a ^ b for a, b in zip(covered, stream, strict=False))
    if hashlib.sha256(nonce + body).digest() != digest:
        raise TippathError(f"{path} is damaged: its content does not fit its own checksum; nothing is said about it")
    try:
        text = _inflated(body[4 : 4 + int.from_bytes(body[:4], "big")]).decode()
    except (ValueError, zlib.error) as error:
        raise TippathError(f"{path} cannot be understood ({error})") from error
    document = documents.json_value(text, str(path), largest=LARGEST)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TippathError(f"{path} was sealed by another version of this program")
    documents.convert(document, _AnswerDocument, str(path))
    return document


def _inflated(packed: bytes) -> bytes:
    """Raises ValueError where there is more than an answer has, zlib.error for what is damaged."""
    unpacking = zlib.decompressobj()
    text = unpacking.decompress(packed, LARGEST)
    if not unpacking.eof:
        raise ValueError("cut, or larger than any answer")
    return text


def judge_folder(answer: Answer, more: Sequence[Path] = ()) -> list[Judgement]:
    """Every diagnosis in the answer's folder, and those named besides. Raises TippathError where such a one is none."""
    found = []
    for path in sorted(answer.path.parent.glob("*.json")):
        document = _diagnosis(path)
        if document is not None:
            found.append(judge(answer, path, document))
    for path in more:
        document = _diagnosis(path)
        if document is None:
            raise TippathError(f"{path} is no diagnosis (format tippath.diagnosis/1)")
        found.append(judge(answer, path, document))
    return found


def _diagnosis(path: Path) -> _Diagnosis | None:
    """None of a file that is none, or damaged."""
    try:
        return documents.read_json(path, _Diagnosis)
    except documents.DocumentError:
        return None


def judge(answer: Answer, path: Path, diagnosis: _Diagnosis) -> Judgement:
    """What the diagnosis is worth, now that the truth is known."""
    verdict, effect = diagnosis.verdict, diagnosis.effect
    if verdict == "unexplained" and diagnosis.stands_in and diagnosis.candidates:
        effect = diagnosis.candidates[0].effect
    same = [name for others in diagnosis.equivalent.values() for name in others]
    outcome = _outcome(answer, verdict, effect, [*diagnosis.indistinguishable, *same])
    said = next((one.parameters for one in diagnosis.candidates if one.effect == effect), None) or {}
    truth = answer.document["expect"] if effect in answer.named else {}
    pairs = [(name, said.get(name), value) for name, value in truth.items()]
    known = tuple((name, number, float(value)) for name, number, value in pairs if number is not None)
    return Judgement(path, verdict, effect, outcome, known)


def _outcome(answer: Answer, verdict: str, effect: str | None, alike: Sequence[str]) -> str:
    level, named = answer.document["level"], answer.named
    if verdict == "complete":
        return "right" if level == "none" else "missed"
    if verdict == "unexplained":
        if level == "beyond":
            return "right"
        if level == "none":
            return "wrong"
        return "stand_in" if effect in named else "missed"
    if effect in named:
        return "right" if effect == named[0] else "same"
    return "not_told_apart" if set(named) & set(alike) else "wrong"

"""TOML and JSON documents, read into typed structs, or refused in one sentence that names file, table and key.

What a document may hold is written once, as msgspec structs with their limits (`Annotated[float, Meta(ge=0, le=1)]`).
msgspec reads by them and makes the JSON schema. It says of a damaged document what a programmer wants to know; so where
it refuses, the struct's own description is walked beside the document for the first fault, in words of the person who
wrote it. A document is a stranger's: its size, its depth and its numbers are bounded before anything is believed, and
what it holds is shown only in quotes.

    class Step(documents.Strict, frozen=True, kw_only=True):
        amplitude: Annotated[float, Meta(ge=0.01, le=0.99)]

    documents.read_toml(path, Step)    # DocumentError: "my.toml: unknown key 'amplitud'; did you mean amplitude?"
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from gcs.document_faults import Fault, Language, Place, as_told, first_fault, is_finite
from gcs.errors import TippathError

LARGEST_TOML: Final = 256 * 1024  # bytes; what people write by hand is a hundred times smaller
LARGEST_JSON: Final = 64 * 1024 * 1024
DEEPEST: Final = 64
"""Tables within tables."""
_LONG_KEY = re.compile(rf"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{DEEPEST}}}""", re.ASCII)
"""`a.a.a.a. ...`, which the TOML reader would work at for minutes, in gigabytes."""

T = TypeVar("T")


class DocumentError(TippathError):
    """The document is not what it should be; the message names it, the place in it, and what would be right."""


class Strict(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """A table that people write: a key that does not exist is an error."""


class Open(msgspec.Struct, frozen=True, kw_only=True):
    """A table that programs write: keys may be added to it, and what is not known is left alone."""


def read_toml(path: Path, kind: type[T], *, what: str = "TOML", largest: int = LARGEST_TOML) -> T:
    """A TOML file as a struct of this kind; `what` it should be ("card") stands in the error where it cannot be read.

    Raises DocumentError.
    """
    return parse_toml(read_text(path, what, largest), kind, str(path), largest=largest)


def read_json(path: Path, kind: type[T], *, what: str = "JSON", largest: int = LARGEST_JSON) -> T:
    """A JSON file as a struct of this kind; as `read_toml`."""
    return parse_json(read_text(path, what, largest), kind, str(path), largest=largest)


def read_text(path: Path, what: str = "text", largest: int = LARGEST_TOML) -> str:
    """A text file, its line ends as `\\n`. Raises DocumentError where it cannot be read, or is larger than this."""
    try:
        with path.open("rb") as stream:
            body = stream.read(largest + 1)
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read as a {what} ({error.strerror or error})") from error
    if len(body) > largest:
        raise DocumentError(f"{path}: cannot be read as a {what}: larger than {_bytes(largest)}")
    try:
        return body.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise DocumentError(f"{path}: cannot be read as a {what}: not text in UTF-8") from error


def parse_toml(text: str, kind: type[T], source: str, *, largest: int = LARGEST_TOML) -> T:
    """TOML text as a struct of this kind; `source` names it in messages. Raises DocumentError."""
    return convert(toml_table(text, source, largest=largest), kind, source, "TOML")


def parse_json(text: str, kind: type[T], source: str, *, largest: int = LARGEST_JSON) -> T:
    """JSON text as a struct of this kind; as `parse_toml`. A number that is not finite is refused."""
    return convert(json_value(text, source, largest=largest), kind, source, "JSON")


def toml_table(text: str, source: str, *, largest: int = LARGEST_TOML) -> dict[str, Any]:
    """TOML text as tables, of bounded size and depth. Raises DocumentError."""
    _bounded_text(text, "TOML", source, largest)
    if _LONG_KEY.search(text):
        raise DocumentError(f"{source}: not TOML of ours: a key of more than {DEEPEST} parts")
    table: dict[str, Any] = _bounded(_parsed(tomllib.loads, text, "TOML", source), source, "TOML")
    return table


def json_value(text: str, source: str, *, largest: int = LARGEST_JSON) -> Any:
    """JSON text as dict, list, number, text, bool or None, of bounded size and depth. Raises DocumentError."""
    _bounded_text(text, "JSON", source, largest)
    if not text.strip():
        raise DocumentError(f"{source}: not JSON: there is nothing in it")
    return _bounded(_parsed(json.loads, text, "JSON", source), source, "JSON")


def convert(document: object, kind: type[T], source: str, language: Language = "JSON") -> T:
    """What was parsed already, as a struct of this kind. Raises DocumentError."""
    _bounded(document, source, language)
    try:
        value = msgspec.convert(document, kind, str_keys=True)
    except msgspec.ValidationError as error:
        fault = first_fault(document, kind) or as_told(error)
        raise DocumentError(f"{source}: {fault.words(language)}") from error
    endless = _not_finite(document)
    if endless is not None:
        fault = first_fault(document, kind) or Fault(endless, "is not finite")
        raise DocumentError(f"{source}: {fault.words(language)}")
    return value


def schema(kind: Any) -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a struct."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(kind)}


def _parsed(parse: Callable[[str], Any], text: str, language: Language, source: str) -> Any:
    try:
        return parse(text)
    except RecursionError:
        raise DocumentError(f"{source}: not {language} of ours: nested too deep") from None
    except ValueError as error:  # syntax, or a number of thousands of digits
        reason = (
            str(error) if isinstance(error, tomllib.TOMLDecodeError | json.JSONDecodeError) else "a number too long"
        )
        raise DocumentError(f"{source}: not {language}: {reason}") from error


def _bounded_text(text: str, language: Language, source: str, largest: int) -> None:
    if len(text) > largest:
        raise DocumentError(f"{source}: not {language} of ours: larger than {_bytes(largest)}")


def _bytes(count: int) -> str:
    return f"{count // 2**20} MB" if count >= 2**20 else f"{count // 2**10} kB"


def _bounded(document: Any, source: str, language: Language) -> Any:
    """The document, where it is not too deep. Walks without recursion."""
    level, depth = [document], 0
    while level:
        if depth > DEEPEST:
            raise DocumentError(f"{source}: not {language} of ours: nested more than {DEEPEST} deep")
        level = [child for node in level for child in _inside(node) if isinstance(child, dict | list)]
        depth += 1
    return document


def _inside(node: object) -> Iterable[Any]:
    return node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()


def _not_finite(document: object) -> Place | None:
    """Where a number stands that is NaN, infinite, or too large for a float."""
    if isinstance(document, dict | list):
        for key, child in document.items() if isinstance(document, dict) else enumerate(document):
            below = _not_finite(child)
            if below is not None:
                return (key, *below)
        return None
    return () if isinstance(document, int | float) and not is_finite(document) else None

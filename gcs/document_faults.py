"""What is wrong with a document: the struct's own description walked beside it, to the first fault, in plain words.

In the words of the person who wrote it: the table, the key, what stands there and what may stand there; see
`gcs.documents`.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec
from msgspec import inspect

Place = tuple[str | int, ...]
"""Keys and numbers from the document down to the value."""
Language = Literal["TOML", "JSON"]


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong at one place."""

    place: Place
    text: str
    """`is a number, not 'x'`, of the value there; or, with `of_table`, a sentence about the table there."""
    of_table: bool = False

    def words(self, language: Language = "TOML") -> str:
        """`maneuver 2, [limits]: command is a number, not 'x'`; in JSON `runs[1].limits.command is ...`."""
        if language == "JSON":
            path = _json_path(self.place)
            if self.of_table:
                return f"{path}: {self.text}" if path else self.text
            return f"{path or 'it'} {self.text}"
        if self.of_table:
            table, key = self.place, ""
        else:
            keys = max((k for k, step in enumerate(self.place) if isinstance(step, str)), default=0)
            table, key = self.place[:keys], _toml_key(self.place[keys:])
        where = _toml_table(table)
        return f"{where + ': ' if where else ''}{key + ' ' if key else ''}{self.text}"


def nearest(word: object, known: Iterable[str], *, otherwise: str = "") -> str:
    """`did you mean amplitude?`, or `otherwise` where nothing is near."""
    near = difflib.get_close_matches(word, list(known), 1) if isinstance(word, str) and len(word) <= 80 else []
    return f"did you mean {near[0]}?" if near else otherwise


def first_fault(document: object, kind: Any) -> Fault | None:
    """The first place where a document is not what the struct describes; None where it is."""
    return _fault(document, _description(kind), ())


@cache
def _description(kind: Any) -> inspect.Type:
    """What msgspec knows of a struct, with the words of each `Literal` in the order in which they are written."""
    description: inspect.Type = _in_order(inspect.type_info(kind), _literals(kind))
    return description


def _literals(kind: Any) -> dict[frozenset[Any], tuple[Any, ...]]:
    """The `Literal`s of a struct and of those within it, in the order written."""
    if get_origin(kind) is Literal:
        return {frozenset(get_args(kind)): get_args(kind)}
    struct = isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    inner = get_type_hints(kind, include_extras=True).values() if struct else get_args(kind)
    return {words: order for each in inner for words, order in _literals(each).items()}


def _in_order(node: Any, orders: Mapping[frozenset[Any], tuple[Any, ...]]) -> Any:
    if isinstance(node, inspect.LiteralType):
        return inspect.LiteralType(orders[frozenset(node.values)])
    if isinstance(node, tuple):
        return tuple(_in_order(each, orders) for each in node)
    if isinstance(node, inspect.Type | inspect.Field):
        return msgspec.structs.replace(
            node, **{name: _in_order(getattr(node, name), orders) for name in node.__struct_fields__}
        )
    return node


def _fault(value: object, kind: inspect.Type, place: Place) -> Fault | None:
    match kind:
        case inspect.Metadata():
            fault = _fault(value, kind.type, place)
            meaning = (kind.extra_json_schema or {}).get("description")
            if fault is None or meaning is None or fault.place != place or fault.of_table:
                return fault
            return Fault(place, f"{fault.text} ({meaning})")
        case inspect.StructType():
            return _in_struct(value, (kind,), place)
        case inspect.UnionType():
            return _in_union(value, kind, place)
        case inspect.DictType():
            return _in_dict(value, kind, place)
        case inspect.ListType() | inspect.VarTupleType() | inspect.SetType() | inspect.FrozenSetType():
            return _in_list(value, kind, place)
        case inspect.TupleType():
            return _in_tuple(value, kind, place)
        case inspect.AnyType():
            return None
    wrong = _scalar(value, kind)
    return None if wrong is None else Fault(place, wrong)


def _in_struct(value: object, kinds: tuple[inspect.StructType, ...], place: Place) -> Fault | None:
    """A table of one kind, or of the kind that its tag names."""
    if not isinstance(value, dict):
        return Fault(place, f"is a table, not {shown(value)}")
    kind, tag = kinds[0], kinds[0].tag_field
    if tag is not None:
        tags = [str(each.tag) for each in kinds]
        if tag not in value:
            return Fault((*place, tag), f"is missing: {'one of ' if len(tags) > 1 else ''}{', '.join(tags)}")
        if value[tag] not in tags:
            return Fault((*place, tag), _not_among(value[tag], tags))
        kind = kinds[tags.index(value[tag])]
    return _unknown_key(value, kind, kinds, place) or _in_fields(value, kind, place)


def _unknown_key(
    value: Mapping[str, object], kind: inspect.StructType, kinds: tuple[inspect.StructType, ...], place: Place
) -> Fault | None:
    names = [field.encode_name for field in kind.fields]
    names = names if kind.tag_field is None else [kind.tag_field, *names]
    for key in value if kind.forbid_unknown_fields else ():
        if key not in names:
            if any(key == field.encode_name for other in kinds for field in other.fields):
                return Fault((*place, key), f"means nothing for a {kind.tag}; leave it out")
            hint = nearest(key, names, otherwise=f"there are: {', '.join(names)}")
            return Fault(place, f"unknown key {shown(key)}; {hint}", of_table=True)
    return None


def _in_fields(value: Mapping[str, object], kind: inspect.StructType, place: Place) -> Fault | None:
    for field in kind.fields:
        if field.encode_name in value:
            fault = _fault(value[field.encode_name], field.type, (*place, field.encode_name))
            if fault is not None:
                return fault
    missing = next((f for f in kind.fields if f.required and f.encode_name not in value), None)
    if missing is None:
        return None
    more = missing.type.extra_json_schema if isinstance(missing.type, inspect.Metadata) else None
    meaning = "" if more is None or "description" not in more else f": {more['description']}"
    return Fault((*place, missing.encode_name), f"is missing{meaning}")


def _in_union(value: object, kind: inspect.UnionType, place: Place) -> Fault | None:
    if value is None and any(isinstance(each, inspect.NoneType) for each in kind.types):
        return None
    given = [each for each in kind.types if not isinstance(each, inspect.NoneType)]
    if len(given) == 1:
        return _fault(value, given[0], place)
    structs = tuple(each for each in kind.types if isinstance(each, inspect.StructType))
    others = [each for each in kind.types if not isinstance(each, inspect.StructType)]
    faults = [_fault(value, each, place) for each in others]
    if None in faults:
        return None
    if structs and (isinstance(value, dict) or not others):
        return _in_struct(value, structs, place)
    return _likeliest(value, others, [fault for fault in faults if fault is not None], place) or Fault(
        place, f"is {' or '.join(_kind_words(each) for each in given)}, not {shown(value)}"
    )


def _likeliest(value: object, kinds: Iterable[inspect.Type], faults: list[Fault], place: Place) -> Fault | None:
    """Of the faults by each kind that it could be: one inside it, or one of the right sort of thing."""
    deeper = [fault for fault in faults if len(fault.place) > len(place)]
    alike = [fault for each, fault in zip(kinds, faults, strict=True) if _alike(value, each)]
    return next(iter((*deeper, *alike)), None)


def _alike(value: object, kind: inspect.Type) -> bool:
    """Whether it is the right sort of thing, whatever is wrong with it."""
    match kind:
        case inspect.Metadata():
            return _alike(value, kind.type)
        case inspect.FloatType() | inspect.IntType():
            return isinstance(value, int | float) and not isinstance(value, bool)
        case inspect.StrType() | inspect.LiteralType():
            return isinstance(value, str)
        case inspect.DictType():
            return isinstance(value, dict)
        case inspect.ListType() | inspect.VarTupleType() | inspect.TupleType():
            return isinstance(value, list)
    return False


def _in_dict(value: object, kind: inspect.DictType, place: Place) -> Fault | None:
    if not isinstance(value, dict):
        return Fault(place, f"is a table, not {shown(value)}")
    for key, child in value.items():
        wrong = _key(key, kind.key_type)
        if wrong is not None:
            return Fault(place, wrong, of_table=True)
        fault = _fault(child, kind.value_type, (*place, key))
        if fault is not None:
            return fault
    wrong = _length(len(value), kind.min_length, kind.max_length, "entries")
    return None if wrong is None else Fault(place, wrong)


def _key(key: str, kind: inspect.Type) -> str | None:
    if isinstance(kind, inspect.Metadata):
        return _key(key, kind.type)
    if isinstance(kind, inspect.LiteralType):
        known = [str(value) for value in kind.values]
        hint = nearest(key, known, otherwise=f"there are: {', '.join(known)}")
        return None if key in known else f"unknown key {shown(key)}; {hint}"
    if isinstance(kind, inspect.IntType):
        return None if re.fullmatch(r"-?\d{1,9}", key) else f"key {shown(key)} is no whole number"
    wrong = _scalar(key, kind)
    return None if wrong is None else f"key {shown(key)} {wrong}"


def _in_list(value: object, kind: Any, place: Place) -> Fault | None:
    item = kind.item_type
    tables = isinstance(item, inspect.StructType) or (
        isinstance(item, inspect.UnionType) and all(isinstance(each, inspect.StructType) for each in item.types)
    )
    if not isinstance(value, list) or (tables and not all(isinstance(child, dict) for child in value)):
        if tables and place and isinstance(place[-1], str):
            return Fault(place, f"is a list of tables, written [[{place[-1]}]], once for each")
        return Fault(place, f"is a list, not {shown(value)}")
    for number, child in enumerate(value):
        fault = _fault(child, item, (*place, number))
        if fault is not None:
            return fault
    wrong = _length(len(value), kind.min_length, kind.max_length, "entries")
    return None if wrong is None else Fault(place, wrong)


def _in_tuple(value: object, kind: inspect.TupleType, place: Place) -> Fault | None:
    words = _kind_words(kind)
    rows = [each for each in kind.item_types if isinstance(each, inspect.TupleType)]
    if not isinstance(value, list) or len(value) != len(kind.item_types):
        return Fault(place, f"is {words}")
    if rows and not all(isinstance(row, list) and len(row) == len(rows[0].item_types) for row in value):
        return Fault(place, f"is {words}")
    pairs = enumerate(zip(value, kind.item_types, strict=True))
    faults = (_fault(child, each, (*place, number)) for number, (child, each) in pairs)
    return next((fault for fault in faults if fault is not None), None)


def _scalar(value: object, kind: inspect.Type) -> str | None:
    match kind:
        case inspect.FloatType() | inspect.IntType():
            return _number(value, kind)
        case inspect.StrType():
            return _text(value, kind)
        case inspect.BoolType():
            return None if isinstance(value, bool) else f"is true or false, not {shown(value)}"
        case inspect.LiteralType():
            known = [str(each) for each in kind.values]
            return None if value in kind.values else _not_among(value, known)
        case inspect.NoneType():
            return None if value is None else f"is null, not {shown(value)}"
    return None


def _number(value: object, kind: inspect.FloatType | inspect.IntType) -> str | None:
    words = "a whole number" if isinstance(kind, inspect.IntType) else "a number"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"is {words}, not {shown(value)}"
    if isinstance(kind, inspect.IntType) and (not isinstance(value, int) or value.bit_length() > 63):
        return f"is {words}{_span(kind)}, not {shown(value)}"
    inside = (
        (kind.ge is None or value >= kind.ge)
        and (kind.gt is None or value > kind.gt)
        and (kind.le is None or value <= kind.le)
        and (kind.lt is None or value < kind.lt)
    )
    return None if is_finite(value) and inside else f"is {words}{_span(kind) or ' that is finite'}, not {shown(value)}"


def _span(kind: inspect.FloatType | inspect.IntType) -> str:
    if kind.ge is not None and kind.le is not None:
        return f" from {kind.ge:g} to {kind.le:g}"
    parts = [
        f"{word} {bound:g}"
        for word, bound in (("above", kind.gt), ("from", kind.ge), ("below", kind.lt), ("up to", kind.le))
        if bound is not None
    ]
    return "".join(f" {part}" for part in [" and ".join(parts)] if part)


def _text(value: object, kind: inspect.StrType) -> str | None:
    if not isinstance(value, str):
        return f"is text in quotes, not {shown(value)}"
    if kind.pattern is not None and not re.search(kind.pattern, value):
        return f"is text like {kind.pattern}, not {shown(value)}"
    if kind.min_length and not value:
        return "is empty"
    return _length(len(value), kind.min_length, kind.max_length, "characters")


def _length(count: int, fewest: int | None, most: int | None, what: str) -> str | None:
    if fewest is not None and count < fewest:
        return "is empty" if not count else f"has {count} {what}; it needs {fewest}"
    if most is not None and count > most:
        return f"has {count} {what}; {most} are the most"
    return None


def _not_among(value: object, known: list[str]) -> str:
    hint = nearest(value, known)
    among = f"one of {', '.join(known)}" if len(known) > 1 else repr(known[0])
    return f"is {among}, not {shown(value)}{f'; {hint}' if hint else ''}"


def _kind_words(kind: inspect.Type) -> str:
    match kind:
        case inspect.Metadata():
            return _kind_words(kind.type)
        case inspect.FloatType():
            return "a number"
        case inspect.IntType():
            return "a whole number"
        case inspect.StrType():
            return "text in quotes"
        case inspect.BoolType():
            return "true or false"
        case inspect.LiteralType():
            return f"one of {', '.join(map(str, kind.values))}"
        case inspect.TupleType():
            inner = kind.item_types[0] if kind.item_types else None
            if isinstance(inner, inspect.TupleType):
                return f"{len(kind.item_types)} rows of {len(inner.item_types)} numbers"
            numbers = all(isinstance(each, inspect.FloatType | inspect.IntType) for each in kind.item_types)
            return f"a list of {len(kind.item_types)}{' numbers' if numbers else ''}"
        case inspect.ListType() | inspect.VarTupleType():
            return "a list"
    return "a table"


def shown(value: object) -> str:
    """A value of a document for a message: short, and without what a terminal would obey."""
    match value:
        case dict():
            return "a table"
        case list():
            return "a list"
        case bool() | None:
            return {True: "true", False: "false", None: "null"}[value]
        case int() if value.bit_length() > 64:
            return "a number of very many digits"
        case float():
            return f"{value:g}" if not value.is_integer() or abs(value) > 1e15 else f"{value:.1f}"
    text = repr(value)
    return text if len(text) <= 60 else text[:56] + "...'"


def as_told(error: msgspec.ValidationError) -> Fault:
    """What msgspec, or a struct's own check, said of a place: `message - at `$.maneuver[0]``."""
    text, _, path = str(error).partition(" - at `$")
    steps = re.findall(r"\.([^.\[`]+)|\[(\d+)\]", path)
    return Fault(tuple(name or int(number) for name, number in steps), text, of_table=True)


def _json_path(place: Place) -> str:
    path = "".join(f"[{step}]" if isinstance(step, int) else f".{_plain(step)}" for step in place)
    return path.removeprefix(".")


def _toml_table(place: Place) -> str:
    """`maneuver 2, [limits]`: the numbered entries of lists of tables, and the table within."""
    words: list[str] = []
    names: list[str] = []
    for step in place:
        if isinstance(step, int):
            words.append(f"{'.'.join(names)} {step + 1}".strip())
            names = []
        else:
            names.append(_plain(step))
    return ", ".join([*words, f"[{'.'.join(names)}]"] if names else words)


def _toml_key(place: Place) -> str:
    name, numbers = place[:1], place[1:]
    return "".join([*(_plain(str(step)) for step in name), *(f"[{step}]" for step in numbers)])


def _plain(name: str) -> str:
    return name if name.isprintable() and 0 < len(name) <= 60 else shown(name)


def is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:
        return False

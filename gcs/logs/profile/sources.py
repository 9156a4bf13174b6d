"""Sources of a profile, which are fields or arithmetic on fields, against what a log holds."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from gcs.errors import TippathError
from gcs.logs.formats.tables import Log, covered_s
from gcs.logs.profile.expression import Expression
from gcs.logs.profile.profiles import Profile


def fields_in(text: str) -> tuple[str, ...]:
    """The fields of arithmetic; none where it makes no sense (whoever applies it says so)."""
    try:
        return Expression.parse(text).fields
    except TippathError:
        return ()


def keys_of(text: str, log: Log) -> tuple[str, ...]:
    """The fields that a source asks for: one where the log has it by that name; none where it makes no sense."""
    return (text,) if log.has(text) else fields_in(text)


def fields_of(profile: Profile) -> tuple[str, ...]:
    """Every field a profile may ask for, the names of columns that are no arithmetic among them."""
    keys: dict[str, None] = dict.fromkeys([profile.time_source] if profile.time_source else [])
    its_settings = () if profile.settings is None else profile.settings.sources
    for texts in (*(channel.sources for channel in profile.channels.values()), its_settings):
        for text in texts:
            keys.update(dict.fromkeys((text, *fields_in(text))))
    return tuple(keys)


def found_in(profile: Profile, fields: Collection[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Channel -> the first of its sources of which all fields are there; channel -> that there is none."""
    sources, absent = {}, {}
    for name, channel in profile.channels.items():
        there = (
            text
            for text in channel.sources
            if text in fields or ((keys := fields_in(text)) and set(keys) <= set(fields))
        )
        text = next(there, None)
        if text is None:
            absent[name] = f"the log has no {' or '.join(channel.sources)}"
        else:
            sources[name] = text
    return sources, absent


def bind(text: str, log: Log) -> Expression:
    """A source as arithmetic on fields that the log has; a field's bare name may hold any characters.

    Raises TippathError for what names no field.
    """
    if log.has(text):
        return Expression.field(text)
    expression = Expression.parse(text)
    if not expression.fields:
        raise TippathError(f"source {text!r} names no field; write a field of the log, such as {log.fields()[0]}")
    return expression


@dataclass(frozen=True, eq=False)
class Stretch:
    """A log between two times of its own clock, either of which may be infinite."""

    log: Log
    start_s: float
    stop_s: float

    def has(self, text: str) -> bool:
        """Whether every field has begun before the stretch ends, and one of them has samples in it."""
        keys = bind(text, self.log).fields
        if not all(self.log.has(key) for key in keys):
            return False
        return all(self.log.series(key).t[0] <= self.stop_s for key in keys) and self.covered_s(text) > 0

    def covered_s(self, text: str) -> float:
        """How much of the stretch the best of its fields covers."""
        parts = [self.log.series(key).part(self.start_s, self.stop_s) for key in bind(text, self.log).fields]
        return max((covered_s(part.t) for part in parts), default=0.0)

    def first_of(self, texts: Collection[str]) -> str | None:
        """The first source that is there."""
        return next((text for text in texts if self.has(text)), None)

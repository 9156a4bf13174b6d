"""Text in keyed blocks: whoever shows it takes blocks by their key and has sentences set; nobody reads them again.

A block's lines are rows of a table, set already, or sentences, which are broken only when they are shown: what a face
offers at the end of a sentence (an option in a shell, a key in the app) is put in before.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

WIDTH = 78

Offers = Mapping[str, str]
"""What a face offers, by what it does, with the joint to the text before it: `card` writes the proposed card."""
SHELL: Offers = {
    "card": "; --card CARD.toml writes that as a test card",
    "fit runs": "; name them as RUN beside the others",
    "validate some": "; name some with --validate",
    "validate one": ": name one with --validate",
    "cut off": " cut them off with --window, or",
}


@dataclass(frozen=True, slots=True)
class Sentence:
    """To be broken into lines of 78 columns, a value together with its name and its error."""

    text: str
    first: str = ""
    """Before the first line,"""
    rest: str = ""
    """and before the others."""
    offer: str = ""
    """Key of what can be done about it; said by faces that offer it, directly behind the text,"""
    last: str = ""
    """and before this, which all say."""


Line = str | Sentence
"""A row that is set already, or what is still to be broken."""


@dataclass(frozen=True, slots=True)
class Block:
    """Lines that belong together."""

    key: str
    """What they are: `answer`, `candidates`, `next`."""
    lines: tuple[Line, ...]
    joined: bool = False
    """Stands directly under the block before, without an empty line."""


Blocks = tuple[Block, ...]


def block(key: str, lines: Sequence[Line], *, joined: bool = False) -> Block:
    """A block of these lines."""
    return Block(key, tuple(lines), joined)


def whole(sentence: Sentence, offers: Offers = SHELL) -> str:
    """A sentence with what a face offers, on one line."""
    return f"{sentence.text}{offers.get(sentence.offer, '')}{sentence.last}"


def broken(sentence: Sentence, offers: Offers = SHELL) -> list[str]:
    """A sentence in lines."""
    text = whole(sentence, offers)
    for mark in ("=", "±", "→"):
        text = text.replace(f" {mark} ", f"\N{NO-BREAK SPACE}{mark}\N{NO-BREAK SPACE}")
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in wrapped(text, sentence.first, sentence.rest)]


def lines_of(one: Block, offers: Offers = SHELL) -> list[str]:
    """A block in lines of at most 78 columns."""
    return [line for each in one.lines for line in (broken(each, offers) if isinstance(each, Sentence) else (each,))]


def spaced(blocks: Sequence[Block], offers: Offers = SHELL, *, but: Collection[str] = ()) -> list[str]:
    """Blocks in lines, less those of some keys; an empty line between two that do not belong together."""
    lines: list[str] = []
    for one in blocks:
        its_own = [] if one.key in but else lines_of(one, offers)
        if its_own:
            lines += [*([""] if lines and not one.joined else []), *its_own]
    return lines


def text_of(blocks: Sequence[Block], offers: Offers = SHELL) -> str:
    """All of them as a shell prints them."""
    return "\n".join(spaced(blocks, offers))


def wrapped(text: str, first: str = "", rest: str = "") -> list[str]:
    """Sentences to lines of at most 78 columns."""
    return textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=rest)


def command(words: str, lead: str = "next: ") -> list[str]:
    """What to type next; on several lines in a way that a shell takes: a quoted word stays on one."""
    whole_words = re.sub("'[^']*'", lambda quoted: quoted[0].replace(" ", "\N{NO-BREAK SPACE}"), words)
    *lines, last = textwrap.wrap(
        f"{lead}{whole_words}",
        WIDTH - 2,
        initial_indent=" ",
        subsequent_indent="   ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in (*(f"{line} \\" for line in lines), last)]

"""A storm as a file: TOML with the words of the options, one of each or a list.

    loss = 0.02
    lag = "3.5@sweep+2:"
    outage = ["up@20:24", "both@40:45"]
    second-attitude = true

What is wrong is said in one line that names the file and the place in it.
"""

from __future__ import annotations

import argparse
import difflib
import math
import tomllib
from pathlib import Path

from sitl.faults import words

_LARGEST = 1 << 20


class _Parser(argparse.ArgumentParser):
    """Never ends the program: its words were checked before."""

    def error(self, message: str) -> None:  # type: ignore[override]
        raise ValueError(message)


def read_script(path: Path) -> list[str]:
    """The options that a script stands for, each a word such as `--loss=0.02`. Raises ValueError."""
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror or error})") from error
    if len(content) > _LARGEST:
        raise ValueError(f"{path}: larger than {_LARGEST} bytes, which no list of faults is")
    try:
        return options(content.decode())
    except (UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: no TOML ({type(error).__name__})") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def options(text: str) -> list[str]:
    """The same of a script's text. Raises ValueError with the place in it."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"no TOML: {error}") from error
    return [option for name, value in table.items() for option in _of_name(name, value)]


def arguments(options: list[str], seed: int) -> argparse.Namespace:
    """As `words.read` takes them. Raises ValueError."""
    parser = _Parser(add_help=False, allow_abbrev=False)
    words.add_options(parser)
    return parser.parse_args(options, argparse.Namespace(seed=seed))


def _of_name(name: str, value: object) -> list[str]:
    if name not in (*words.MANY, *words.ONE, *words.FLAGS):
        near = difflib.get_close_matches(name, (*words.MANY, *words.ONE, *words.FLAGS), n=1)
        meant = f"; {near[0]} is meant?" if near else "; `tippath sim --help` lists them"
        raise ValueError(f"{name}: there is no such fault{meant}")
    if name in words.FLAGS:
        if not isinstance(value, bool):
            raise ValueError(f"{name}: true or false is wanted")
        return [f"--{name}"] if value else []
    if name in words.ONE and isinstance(value, list):
        raise ValueError(f"{name}: one value is wanted, no list")
    values = value if isinstance(value, list) else [value]
    places = [f"{name}[{number}]" for number in range(len(values))] if isinstance(value, list) else [name]
    return [_option(name, one, place) for one, place in zip(values, places, strict=True)]


def _option(name: str, value: object, place: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"{place}: a number, or a word in quotes as behind --{name}, is wanted")
    option = f"--{name}={value}"
    try:
        words.read(arguments([option], 0), lambda: math.inf)
    except ValueError as error:
        raise ValueError(f"{place}: {str(error).removeprefix(f'--{name} ')}") from error
    return option

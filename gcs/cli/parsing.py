"""The parser of `tippath` and of each of its commands: what is wrong in one line, and what was probably meant."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from gcs.document_faults import nearest


class Parser(argparse.ArgumentParser):
    """argparse's, but that each command names its own faults, and says what a typo was meant for."""

    _words: Sequence[str] = ()
    """What is being parsed."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse's, but that words which nothing takes are refused by the command that they were given to."""
        self._words = sys.argv[1:] if args is None else list(args)
        known, others = super().parse_known_args(args, namespace)
        if others:
            option = next((word for word in others if word.startswith("-")), None)
            self.error(f"{others[0]} is one word too many" if option is None else f"there is no option {option}")
        return known, others

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        known = [str(one) for one in action.choices]
        meant = nearest(value, known, otherwise=f"there are {', '.join(known)}")
        raise argparse.ArgumentError(action, f"there is no {value!r}; {meant}")

    def error(self, message: str) -> NoReturn:
        """Ends the program with status 2; a mistyped option is told first, for it may be what is missing."""
        self.exit(2, f"{self.prog}: {self._mistyped() or message}\n{self.prog} --help tells what it takes\n")

    def _mistyped(self) -> str:
        """The first word that is no option of this command and looks like one; empty where there is none."""
        options = [name for name in self._option_string_actions if name.startswith("--")]
        for word in self._words:
            name = word.partition("=")[0]
            if name == "--":
                break
            known = any(option.startswith(name) for option in options)
            if name.startswith("--") and not known and (meant := nearest(name, options)):
                return f"there is no option {name}; {meant}"
        return ""

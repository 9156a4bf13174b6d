"""A page for every command, from its parser: usage, options, and what its help ends with."""

from __future__ import annotations

import argparse
import re
from typing import Any

from gcs.cli import COMMANDS, parser

INTRODUCTION = """\
# Commands

What `tippath COMMAND --help` says, written from the same parsers. Exit status: 0 done, 1 data or vehicle says no, 2
wrong usage, 130 interrupted.

| command | |
|---|---|
"""
SPECIAL = re.compile(r"([\\*_<>\[\]|#])")


def command_pages() -> dict[str, str]:
    """Path -> text, `commands/index.md` first."""
    (commands,) = (one for one in parser()._actions if isinstance(one, argparse._SubParsersAction))
    helps = {one.dest: one.help or "" for one in commands._choices_actions}
    rows = "".join(f"| [{name}]({name}.md) | {plain(helps[name])} |\n" for name in COMMANDS)
    contents = "\n".join(["", "```{toctree}", ":hidden:", "", *COMMANDS, "```", ""])
    pages = {"commands/index.md": INTRODUCTION + rows + contents}
    return pages | {f"commands/{name}.md": page(name, commands.choices[name]) for name in COMMANDS}


def page(name: str, command: argparse.ArgumentParser) -> str:
    usage = re.sub(r"\s+", " ", command.format_usage()).removeprefix("usage: ")
    lines = [f"# tippath {name}", "", plain(command.description or ""), "", "```text", *folded(usage), "```", ""]
    for group in command._action_groups:
        actions = [one for one in group._group_actions if one.help is not argparse.SUPPRESS]
        if actions:
            lines += [f"## {(group.title or 'more').capitalize()}", ""]
            for one in actions:
                lines += [f"`{called(one)}`", f": {plain(explained(one, command)) or 'see above'}", ""]
    if command.epilog:
        lines += ["## More", "", "```text", command.epilog.replace("%(prog)s", command.prog).rstrip(), "```", ""]
    return "\n".join(lines)


def called(action: argparse.Action) -> str:
    """`-o FILE, --output FILE`, or a positional's name."""
    formatter: Any = argparse.HelpFormatter("")
    return str(formatter._format_action_invocation(action))


def explained(action: argparse.Action, command: argparse.ArgumentParser) -> str:
    formatter: Any = command._get_formatter()
    return str(formatter._expand_help(action)) if action.help else ""


def plain(text: str) -> str:
    """Help as Markdown that shows just that: code stays code, nothing else is markup."""
    parts = re.split(r"(`[^`]*`)", re.sub(r"\s+", " ", text).strip())
    parts[::2] = [SPECIAL.sub(r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


def folded(usage: str, width: int = 78) -> list[str]:
    """Usage in lines, never within a bracket."""
    pieces = re.findall(r"\[[^\]]*\](?:\.\.\.)?|\S+", usage)
    lines = [""]
    for piece in pieces:
        if lines[-1] and len(lines[-1]) + 1 + len(piece) > width:
            lines.append("   ")
        lines[-1] = f"{lines[-1]} {piece}" if lines[-1] else piece
    return lines

"""The commands that do in a shell what the desk did; a user may copy each as it stands."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.fit.result import Fit


def word(text: object) -> str:
    """As a shell takes it; `LOG#n` needs no quotes, and reads better without."""
    plain = str(text)
    return plain if shlex.quote(plain.replace("#", "")) == plain.replace("#", "") else shlex.quote(plain)


def words(texts: Sequence[object]) -> str:
    return " ".join(map(word, texts))


def user_files(fit: Fit) -> list[str]:
    """Files of the user's own that a fit uses, base or effects: their code runs only where they are named."""
    return list(fit.model.structure.files)


def named(*fits: Fit) -> list[str]:
    """`--with` and the user's effect files of these fits; nothing where there are none."""
    files = list(dict.fromkeys(path for fit in fits for path in user_files(fit)))
    return ["--with", ",".join(files)] if files else []


Making = tuple[Sequence[str], str, Sequence[str], Sequence[str]]
"""What a fit is made of: the runs, the model, its effects, the runs that judge."""


def fit(runs: Sequence[str], model: str, effects: Sequence[str], validation: Sequence[str], path: Path, /) -> str:
    parts: list[object] = ["tippath", "fit", *runs, "--model", model]
    parts += ["--with", ",".join(effects)] if effects else []
    parts += ["--validate", *validation] if validation else []
    return words([*parts, "-o", path])


def compare(fit: Fit, fit_path: Path, path: Path) -> str:
    return f"{words(['tippath', 'compare', fit_path, *named(fit)])} --json > {word(path)}"


def diagnose(fit: Fit, fit_path: Path, path: Path) -> str:
    return f"{words(['tippath', 'diagnose', fit_path, *named(fit)])} --json > {word(path)}"


def next_card(fit: Fit, fit_path: Path, path: Path) -> str:
    return words(["tippath", "diagnose", fit_path, *named(fit), "--card", path])


def add(fit: Fit, fit_path: Path, effect: str, path: Path) -> str:
    return words(["tippath", "add", fit_path, effect, *named(fit), "-o", path])


def design(fit: Fit, fit_path: Path, options: Sequence[object], path: Path) -> str:
    return words(["tippath", "design", fit_path, *options, *named(fit), "-o", path])


def report(fits: Sequence[Fit], fit_paths: Sequence[Path], gains: Path | None, path: Path, *, paper: bool) -> str:
    given = [] if gains is None else ["--gains", gains]
    return words(["tippath", "report", *fit_paths, *given, *named(*fits), *(["--pdf"] if paper else []), "-o", path])

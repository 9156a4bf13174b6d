"""The list of studies and benchmarks: what each asks, from its own first line, and the command that repeats it."""

from __future__ import annotations

import ast
from pathlib import Path

INTRODUCTION = """\
# Repeat them

Every study and benchmark there is, with what it says of itself. `make study` runs all of the first kind (hours), `make
bench` all of the second (minutes, on an idle machine); one alone by its file:

```text
python -m pytest FILE --override-ini 'python_files=study_*.py' --override-ini 'python_functions=study_*' -s -q
python -m pytest FILE --override-ini 'python_files=bench_*.py' --override-ini 'python_functions=bench_*' -s -q
```

"""
SCRIPTS = ("blind", "judge", "over_the_link", "rate_loop_truth", "same_results", "house", "walk")
"""Programs of their own in tests/study."""


def study_list(root: Path) -> str:
    studies, benchmarks = root / "tests" / "study", root / "tests" / "benchmarks"
    return INTRODUCTION + "\n".join(
        [
            *table("Studies", root, sorted(studies.glob("study_*.py"))),
            *table("Programs beside them", root, [studies / f"{name}.py" for name in SCRIPTS]),
            *table("Benchmarks", root, sorted(benchmarks.glob("bench_*.py"))),
        ]
    )


def table(title: str, root: Path, files: list[Path]) -> list[str]:
    rows = [f"| `{path.relative_to(root).as_posix()}` | {asked(path)} |" for path in files]
    return [f"## {title}", "", "| file | asks |", "|---|---|", *rows, ""]


def asked(path: Path) -> str:
    """The first sentence or line of a module's docstring."""
    words = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n\n")[0]
    return " ".join(words.split()).replace("|", r"\|").replace("<", r"\<")

"""The directions of import, proved by what a fresh interpreter has loaded."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

RULES = [
    ("sysid.identify", ("gcs", "sitl", "pymavlink", "serial", "textual", "matplotlib", "control"), "mathematics only"),
    ("sitl.plants", ("gcs", "sysid", "pymavlink"), "truth is independent of the models under test"),
    ("sitl.vehicle", ("gcs", "sysid"), "truth is independent of the models under test"),
    ("sitl.server", ("gcs", "sysid"), "truth is independent of the models under test"),
    ("gcs.session", ("sitl", "textual", "scipy", "matplotlib"), "the engine needs no screen and no mathematics"),
    ("gcs.sweep", ("sitl", "textual", "gcs.tui", "gcs.cli"), "one engine, three faces"),
    ("gcs.analysis", ("sitl", "pymavlink", "textual", "matplotlib", "control"), "start-up: import where used"),
    ("gcs.cli", ("pymavlink", "scipy", "control", "matplotlib", "textual", "sitl"), "--help answers at once"),
]


@pytest.mark.parametrize(("module", "forbidden", "reason"), RULES, ids=[rule[0] for rule in RULES])
def test_a_fresh_interpreter_loads_only_what_it_may(module: str, forbidden: tuple[str, ...], reason: str) -> None:
    code = (
        f"import {module}, sys\n"
        f"print(*[n for n in sys.modules if any(n == f or n.startswith(f + '.') for f in {forbidden!r})])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == [], reason


def test_the_contract_names_every_module_below_the_faces() -> None:
    """A new module of gcs is bound by the contract, or somebody decided that it is a face."""
    root = Path(__file__).resolve().parents[2]
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (engine,) = [one for one in contracts if one["name"].startswith("one engine")]
    there = {path.stem for path in (root / "gcs").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert {f"gcs.{name}" for name in there - {"__init__", "cli", "tui"}} == set(engine["source_modules"])

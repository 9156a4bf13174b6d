"""The directions of import, proved by what a fresh interpreter has loaded."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

RULES = [
    ("sysid.fit.identify", ("gcs", "sitl", "pymavlink", "serial", "textual", "matplotlib", "control"), "mathematics"),
    ("sitl.plants", ("gcs", "sysid", "pymavlink"), "truth is independent of the models under test"),
    ("sitl.autopilot.vehicle", ("gcs", "sysid"), "truth is independent of the models under test"),
    ("sitl.protocol.server", ("gcs", "sysid"), "truth is independent of the models under test"),
    ("gcs.flight.session", ("sitl", "textual", "scipy", "matplotlib"), "the engine needs no screen and no mathematics"),
    ("gcs.flight.sweep", ("sitl", "textual", "gcs.tui", "gcs.cli"), "one engine, three faces"),
    ("gcs.analysis.fits", ("sitl", "pymavlink", "textual", "matplotlib", "control"), "start-up: import where used"),
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


@pytest.mark.parametrize("package", ["gcs", "sysid", "sitl"])
def test_the_layers_name_every_room(package: str) -> None:
    """A new folder has its place in the directions of import, or somebody decided that it needs none."""
    root = Path(__file__).resolve().parents[2]
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = [c["layers"] for c in contracts if c["type"] == "layers" and c["containers"] == [package]]
    named = {name.strip(" ()") for layer in layers for name in layer.split("|")}
    there = {path.parent.name for path in (root / package).glob("*/__init__.py")}
    loose = {path.stem for path in (root / package).glob("*.py")}
    assert there == named - loose, "a room that is missing in pyproject.toml, or one that is gone"

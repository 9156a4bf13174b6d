"""`import sysid`: quick, complete, and its examples run."""

from __future__ import annotations

import ast
import doctest
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import sysid
import sysid.notebook


def test_it_loads_nothing_until_a_name_is_used() -> None:
    code = "import sysid, sys; print(*[n for n in sys.modules if n in ('numpy', 'scipy') or n.startswith('sysid.')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == []


def declared() -> dict[str, tuple[str, str]]:
    """What type checkers see: public name -> (module, name there)."""
    tree = ast.parse(Path(sysid.__file__).read_text(encoding="utf-8"))
    return {
        alias.asname: (node.module or "", alias.name)
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname is not None
    }


def test_type_checkers_see_the_same_names() -> None:
    assert declared() == {name: (home, name) for name, home in sysid._HOMES.items()}


@pytest.mark.parametrize("name", sorted(sysid._HOMES))
def test_every_name_is_there_and_explained(name: str) -> None:
    value: Any = getattr(sysid, name)
    if name != "CHANNELS":
        assert len((inspect.getdoc(value) or "").split()) >= 4


def test_no_public_name_is_a_folder() -> None:
    """An attribute with a folder's name would be the folder as soon as anything imports it."""
    folders = {path.parent.name for path in Path(sysid.__file__).parent.glob("*/__init__.py")}
    assert not folders & set(sysid._HOMES)
    with pytest.raises(AttributeError, match="no public name"):
        _ = sysid.no_such_name  # type: ignore[attr-defined]


def test_the_examples_run() -> None:
    """The tour first; every function's example goes on from it."""
    surroundings: dict[str, Any] = {}
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    functions = [value for name, value in vars(sysid.notebook).items() if name in sysid._NOTEBOOK]
    examples = 0
    explained: list[Any] = [sysid, *(value for value in functions if inspect.isfunction(value))]
    for told in explained:
        text = inspect.getdoc(told) or ""
        test = parser.get_doctest(text, surroundings, told.__name__, None, 0)
        test.globs = surroundings  # not a copy: what the tour made is there for those that follow
        runner.run(test, clear_globs=False)
        examples += bool(test.examples)
    assert runner.failures == 0
    assert examples >= 12

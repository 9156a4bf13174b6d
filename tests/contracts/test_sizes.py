"""What grows is split by what it does: files, functions, branches, and constructors whose arguments have no names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from house import (
    FILE_LINES,
    PACKAGES,
    Source,
    circles,
    complex_functions,
    graphs,
    long_functions,
    positional_dataclasses,
    sources,
)

ROOT = Path(__file__).resolve().parents[2]
IN_A_NOTEBOOK = ("Record", "Parameter")
"""Written by hand in notebooks and effect files, in the order that everybody knows."""


@cache
def product() -> list[Source]:
    return sources(ROOT, PACKAGES)


def test_no_file_is_above_500_lines() -> None:
    assert [f"{one.path}, {one.lines} lines" for one in product() if one.lines > FILE_LINES] == []


@pytest.mark.parametrize("those", [long_functions, complex_functions])
def test_no_function_is_longer_than_60_lines_or_branches_more_than_20_times(
    those: Callable[[Source], Iterator[str]],
) -> None:
    assert [place for one in product() for place in those(one)] == []


def test_what_has_six_fields_is_built_by_name() -> None:
    places = [place for one in product() for place in positional_dataclasses(one)]
    assert [place for place in places if place.split()[1].rstrip(",") not in IN_A_NOTEBOOK] == []


def test_nothing_imports_in_circles() -> None:
    for graph in graphs(product()):
        assert circles(graph) == []

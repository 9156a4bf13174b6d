"""The drawings: what is in them, that nothing overlaps or lies outside, and the three kinds of files."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from planted import PLANTED, axes, fly

from gcs.analysis.pages.diagnosis import diagnosis_picture
from gcs.analysis.pages.ladder import ladder_picture
from gcs.analysis.pages.pictures import compare_picture, picture_kind, write_picture
from gcs.errors import TippathError, UsageError
from sysid.compare.compare import compare
from sysid.compare.values import Comparison
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.model.compose import compose


@pytest.fixture(scope="module")
def found() -> Comparison:
    """A TPP without the servo that flew."""
    flown = fly("servo_lag", PLANTED["servo_lag"], seed=3, duration_s=15.0)
    records = [
        Record(f"#{i}", {k: v for k, v in run.items() if k not in ("phi", "theta")}, maneuver="chirp", axis=axis)
        for i, (run, axis) in enumerate(zip(flown, axes(False), strict=True), 1)
    ]
    return compare(identify(compose("tpp"), records).model, records, (0.0, 15.0))


CANDIDATES = [
    ("servo_lag", 0.94, "tau_s = 31.2 ± 0.4 ms"),
    ("second_order_flapping", 0.78, "implausible: lock_number 7.4, stands in"),
    ("quadratic_damping", 0.0, ""),
    ("disc_incidence", None, "alpha is not logged"),
]
RUNGS = [
    ("TPP", {"p": 64.1, "q": 70.9}, {"p": 61.7, "q": 66.0}),
    ("+ servo_lag", {"p": 81.0, "q": 87.6}, {"p": 80.2, "q": 86.9}),
    ("+ servo_backlash", {"p": 81.6, "q": 87.9}, None),
]


def drawn(name: str, found: Comparison) -> Any:
    if name == "compare":
        return compare_picture(found)
    if name == "diagnosis":
        return diagnosis_picture(CANDIDATES, found.densities, found.densities, "with servo_lag")
    return ladder_picture(RUNGS, {"p": 82.0, "q": 88.3})


def texts(figure: Any) -> list[Any]:
    """What stands in and around the panels: titles, labels, ticks, numbers, notes."""
    each = []
    for axis in figure.axes:
        each += [axis.title, axis._left_title, axis.xaxis.label, axis.yaxis.label, *axis.texts]
        each += [*axis.get_xticklabels(), *axis.get_yticklabels()]
    return [one for one in each if one.get_text() and one.get_visible()]


@pytest.mark.parametrize("name", ["compare", "diagnosis", "ladder"])
def test_nothing_overlaps_and_nothing_is_cut_off(name: str, found: Comparison, tmp_path: Path) -> None:
    figure = drawn(name, found)
    write_picture(tmp_path / "x.png", figure, "x")
    renderer = FigureCanvasAgg(figure).get_renderer()
    width, height = figure.bbox.width, figure.bbox.height
    assert width == 1200
    boxes = [(one.get_text(), one.get_window_extent(renderer)) for one in texts(figure)]
    assert len(boxes) > 20
    limits = [axis.get_tightbbox(renderer) for axis in figure.axes]
    for box in limits:
        assert box.x0 > -1
        assert box.y0 > -1
        assert box.x1 < width + 1
        assert box.y1 < height + 1
    for one, other in itertools.combinations(limits, 2):
        assert not (
            min(one.x1, other.x1) - max(one.x0, other.x0) > 1 and min(one.y1, other.y1) - max(one.y0, other.y0) > 1
        ), "two panels overlap"
    for axis in figure.axes:
        if axis.get_legend() is not None:
            legend, panel = axis.get_legend().get_window_extent(renderer), axis.get_window_extent(renderer)
            assert panel.x0 <= legend.x0
            assert legend.x1 <= panel.x1
            assert legend.y1 <= panel.y1 + 1
        notes = [one.get_window_extent(renderer) for one in axis.texts if one.get_text()]
        for one, other in itertools.combinations(notes, 2):
            assert not one.overlaps(other)


def test_a_comparison_shows_both_axes(found: Comparison) -> None:
    figure = compare_picture(found)
    assert len(figure.axes) == 16
    titles = [axis._left_title.get_text() for axis in figure.axes]
    assert titles[0].startswith("roll: NRMSE fit")
    assert titles[1].startswith("pitch: NRMSE fit")
    assert "with noise alone" in titles[0]
    measured = figure.axes[0].lines[0].get_ydata()
    modelled = figure.axes[0].lines[1].get_ydata()
    residual = figure.axes[2].lines[0].get_ydata()
    np.testing.assert_allclose(measured - modelled, residual, atol=1e-12)
    bars = figure.axes[14].patches
    assert sum(bar.get_height() for bar in bars) == pytest.approx(100, abs=0.1), "shares of one axis"


def test_runs_that_separate_nothing_are_drawn_as_well() -> None:
    (flown, *_) = fly(None, {}, seed=3, duration_s=8.0)
    names = ("t", "p", "q", "delta_x", "delta_y")
    record = Record("one", {name: flown[name] for name in names})
    model = identify(compose("cd"), [record]).model
    figure = compare_picture(compare(model, [record.window(2.0, 4.5)], (0.0, 15.0)))
    words = [one.get_text() for axis in figure.axes for one in axis.texts]
    assert words.count("the runs do not separate the commands") == 4


def test_a_diagnosis_says_what_is_not_testable(found: Comparison) -> None:
    figure = diagnosis_picture(CANDIDATES, found.densities)
    words = [one.get_text() for one in figure.axes[0].texts]
    assert "not testable" in words
    assert "94 %" in words
    assert "alpha is not logged" in words
    assert [bar.get_width() for bar in figure.axes[0].patches] == [94.0, 78.0, 0.0, 0.0]
    assert diagnosis_picture([], found.densities) is not None


def test_a_ladder_shows_the_error_and_the_fit() -> None:
    figure = ladder_picture(RUNGS, {"p": 82.0, "q": 88.3})
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), [35.9, 19.0, 18.4])
    np.testing.assert_allclose(figure.axes[1].lines[1].get_ydata()[:2], [34.0, 13.1])
    assert [one.get_text() for one in figure.axes[0].texts] == ["64.1 %", "81.0 %", "81.6 %"]
    alone = ladder_picture([("TPP", {"p": -5.0, "q": 70.0}, None)], None)
    assert len(alone.axes[0].lines) == 1


@pytest.mark.parametrize(
    ("name", "begins"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.HTML", b"<!doctype html>")]
)
def test_three_kinds_of_files(name: str, begins: bytes, found: Comparison, tmp_path: Path) -> None:
    path = tmp_path / name
    write_picture(path, ladder_picture(RUNGS, None), "a ladder", "said <so>")
    content = path.read_bytes()
    assert content.startswith(begins)
    if name.endswith("HTML"):
        text = content.decode()
        assert text.count("<svg") == 1
        assert "said &lt;so&gt;" in text
        assert "src=" not in text
        assert 'href="http' not in text
    assert [one.name for one in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.json", ".png"])
def test_other_endings_are_refused(name: str) -> None:
    with pytest.raises(UsageError, match=r"\.png, \.svg or \.html"):
        picture_kind(Path(name))


def test_a_picture_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.png").mkdir()
    with pytest.raises(TippathError, match="cannot be written"):
        write_picture(tmp_path / "a.png", ladder_picture(RUNGS, None), "x")
    assert [one.name for one in tmp_path.iterdir()] == ["a.png"]

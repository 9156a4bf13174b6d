"""Pages: what strangers wrote is harmless in them, figures stay small and true, and the PDF is one."""

from __future__ import annotations

import io
import re
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from gcs.analysis.pages.discovery import discovery, told
from gcs.analysis.pages.page import literal, page, svg
from gcs.analysis.pages.parts import Document, Facts, Listing, Part, Picture, Section, Sentences, Table
from gcs.analysis.pages.pdf import pdf
from gcs.analysis.pages.pictures import thinned
from gcs.analysis.pages.provenance import about_of, audit_parts, flight_parts, flown_when, title_of
from gcs.flight.folder import FlightFolder
from gcs.vehicle.identity import is_simulated
from sysid.compare.values import Densities
from sysid.data.airframe import Airframe
from sysid.data.record import Record

HOSTILE = "</style><script>alert(1)</script><img src=x onerror=alert(1)>\" ' & $x^{ 日本"


class Elements(HTMLParser):
    """All elements and their attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.attributes: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data: str) -> None:
        self.text += data


def figure(label: str = "measured") -> Figure:
    drawn = Figure(figsize=(4, 3))
    axis = drawn.subplots()
    axis.plot(np.linspace(0, 1, 50), np.sin(np.linspace(0, 6, 50)), label=literal(label))
    axis.set_title(literal(label))
    axis.legend()
    return drawn


def document(text: str) -> Document:
    """With this text everywhere."""
    parts: tuple[Part, ...] = (
        Sentences((text, text)),
        Sentences((text,), listed=True),
        Listing(text),
        Facts(((text, text),)),
        Table(text, (text, text), ((text, text),)),
        Picture(figure(text), text),
    )
    return Document(text, text, (Section(text, parts), Section(text, parts, fresh=True), Section(text, ())))


def test_whatever_strangers_wrote_is_text_in_a_page() -> None:
    html = page(document(HOSTILE))
    read = Elements()
    read.feed(html)
    assert read.names.isdisjoint({"script", "img", "link", "iframe", "object"})
    assert not any(name.startswith("on") for name in read.attributes)
    assert read.text.count(HOSTILE) >= 18
    assert re.findall("<b>(Figure|Table) ([0-9])", html) == [
        *(("Table", "1"), ("Figure", "1"), ("Table", "2"), ("Figure", "2")),
    ]
    assert "default-src 'none'" in html


@pytest.mark.filterwarnings("error")
def test_a_pdf_has_its_sheets_whatever_it_says() -> None:
    raw = pdf(document(HOSTILE), datetime(2026, 5, 4, tzinfo=UTC))
    assert raw.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", raw)) >= 2
    assert raw == pdf(document(HOSTILE), datetime(2026, 5, 4, tzinfo=UTC))


def test_the_summary_stands_below_the_contents_on_the_first_sheet() -> None:
    few = tuple(Section(name, (Sentences(("Told.",)),)) for name in ("Summary", "Flight", "Source"))
    raw = pdf(Document("Hover", "", few), datetime(2026, 5, 4, tzinfo=UTC))
    assert len(re.findall(rb"/Type /Page\b", raw)) == 1
    assert len(re.findall(rb"/Subtype /Link\b", raw)) == 6  # of each its name and its page


def points(text: str) -> list[tuple[float, float]]:
    """Of the longest path, absolute."""
    path = max(re.findall(r' d="([^"]*)"', text), key=len)
    x = y = 0.0
    found = []
    for command, right, down in re.findall(r"([Ml])(-?[.\d]+?)\s*?(?: |(?=-))(-?[.\d]+)", path):
        x, y = (float(right), float(down)) if command == "M" else (x + float(right), y + float(down))
        found.append((x, y))
    return found


def test_a_line_is_written_in_small_steps_and_stays_where_it_was() -> None:
    x = np.linspace(0, 1, 3000)
    drawn = Figure(figsize=(6, 4))
    (line,) = drawn.subplots().plot(x, np.sin(40 * x) + 0.3 * np.sin(300 * x))
    written = points(svg(drawn))
    place = line.axes.transData.transform(np.column_stack(line.get_data())) * 72 / drawn.dpi
    height = 72 * 4
    assert len(written) > 500
    at = np.array(written)
    ends = np.array([place[0], place[-1]])
    np.testing.assert_allclose(at[[0, -1], 0], ends[:, 0], atol=0.11)  # steps are rounded, places do not drift
    np.testing.assert_allclose(height - at[[0, -1], 1], ends[:, 1], atol=0.11)
    plain = io.StringIO()
    drawn.savefig(plain, format="svg")
    assert len(svg(drawn)) < 0.6 * len(plain.getvalue())


def test_an_area_that_leaves_its_axes_is_clipped_on_paper() -> None:
    """fpdf2 clips what is a path, and nothing within a clipped group."""
    drawn = Figure(figsize=(6, 4))
    axis = drawn.subplots()
    axis.set_ylim(0.0, 1.0)
    axis.fill_between(np.linspace(0, 1, 20), -0.4, 0.5, color="#123456")  # below its axes, and smaller than the figure
    assert len(re.findall(r"<path [^>]* clip-path=[^>]*#123456", svg(drawn, outlined=True))) == 1


def test_thinning_keeps_every_peak() -> None:
    t = np.arange(100_000) / 500
    values = np.random.default_rng(1).normal(size=t.size)
    values[50_123], values[70_001] = 9.0, -9.0
    at, kept = thinned(t, values, 300)
    assert at.size <= 602
    assert (float(kept.max()), float(kept.min())) == (9.0, -9.0)
    assert np.all(np.diff(at) >= 0)
    assert set(zip(at, kept, strict=True)) <= set(zip(t, values, strict=True))


DIAGNOSIS: dict[str, Any] = {
    "format": "tippath.diagnosis/1",
    "verdict": "missing",
    "chain": ["servo_lag"],
    "equivalent": {"servo_lag": ["gyro_lag"]},
    "confidence": 0.97,
    "candidates": [
        {"effect": "gyro_lag", "explained_share": 0.9, "delta_bic": -9.0, "nrmse_percent": {"p": 88.1, "q": None}},
        {
            "effect": "servo_lag",
            "explained_share": 0.95,
            "delta_bic": -8.0,
            "parameters": {"tau_s": 0.0312, "wild": None},
            "standard_errors": {"tau_s": 0.0004},
        },
        {"effect": HOSTILE, "explained_share": 0.4, "implausible_parameters": [HOSTILE], "parameters": {"a": 1.0}},
        {"effect": "dynamic_inflow", "explained_share": None, "not_testable": "no airspeed"},
        {"effect": "evil.py", "explained_share": 0.2, "parameters": {"a": 1.0}},
    ],
    "explanation": {"what": ["a lag"], "why": ["phase falls", HOSTILE]},
    "could_hide": [HOSTILE],
    "next_maneuver": {"maneuver": "elevator chirp", "why": HOSTILE},
}


def densities() -> Densities:
    f = np.linspace(0.5, 15, 30)
    spectrum = np.column_stack([1 / f, 2 / f])
    return Densities(frequency_hz=f, measured=spectrum, residual=0.3 * spectrum, noise=0.1 * spectrum)


def test_a_kept_diagnosis_is_told_with_its_answer_first() -> None:
    found = told(DIAGNOSIS)
    assert found is not None
    assert found.answer == "missing: servo_lag (not to be told from gyro_lag), confidence 0.97"
    parts = discovery(found, densities(), densities(), ("p", "q"))
    (table,) = (part for part in parts if isinstance(part, Table))
    assert [row[0] for row in table.rows][:2] == ["servo_lag", "gyro_lag"]
    assert table.rows[0][-1] == "tau_s = 31.2 ± 0.4 ms"
    assert table.rows[1][2:4] == ("88.1", "")
    assert all("dynamic_inflow" not in row[0] for row in table.rows)  # was not refitted
    read = Elements()
    read.feed(page(Document("x", "", (Section("lacks", tuple(parts)),))))
    assert "script" not in read.names
    assert "phase falls." in read.text


@pytest.mark.parametrize(
    "damage", [{"verdict": 5}, {"candidates": [{"effect": None}]}, {"confidence": "sure"}, {"could_hide": "all"}]
)
def test_a_damaged_diagnosis_is_none(damage: dict[str, Any]) -> None:
    assert told(DIAGNOSIS | damage) is None
    assert told([]) is None


def test_what_it_may_be_beyond_the_catalogue_is_on_the_page() -> None:
    term = "a simple term alone does more than hub_gyroscopics: p_dot += L_q_abs_p q|p|"
    found = told(DIAGNOSIS | {"verdict": "unexplained", "beyond": [term]})
    assert found is not None
    parts = discovery(found, densities(), None, ("p", "q"))
    told_as = [row for part in parts if isinstance(part, Facts) for row in part.rows]
    assert ("beyond the catalogue", f"{term}.") in told_as


def test_a_complete_one_draws_no_candidates() -> None:
    found = told({"verdict": "complete", "log10_chance": -0.5, "confidence": 0.98})
    assert found is not None
    assert found.answer == "complete: what is left is noise, confidence 0.98"
    assert not [part for part in discovery(found, densities(), None, ("p", "q")) if isinstance(part, Picture)]


@pytest.mark.parametrize(("log10_chance", "says"), [(-1.3, False), (-6.0, True)])
def test_of_noise_nothing_is_told_but_that_it_is(log10_chance: float, says: bool) -> None:
    """Significant and complete is what does not matter: that it follows a command is worth a sentence."""
    finding = "roll: 44 % of the error sits in 1.2-2.3 Hz, coherent with delta_x (0.27): linear dynamics are missing"
    document = {"verdict": "complete", "log10_chance": log10_chance, "character": {"findings": [finding]}}
    found = told(document)
    assert found is not None
    (sentences,) = (part for part in discovery(found, densities(), None, ("p", "q")) if isinstance(part, Sentences))
    assert (f"{finding}." in sentences.lines) == says
    assert found.answer == f"complete: what is left {'and seen does not matter' if says else 'is noise'}"


@pytest.mark.parametrize(("needed", "marked"), [(0.9, [90.0]), (0.8, [80.0]), (None, []), (7.0, []), (-1.0, [])])
def test_the_share_that_is_needed_is_marked_where_it_is_known(needed: float | None, marked: list[float]) -> None:
    found = told(DIAGNOSIS | {"needed_share": needed})
    assert found is not None
    (picture,) = (part for part in discovery(found, densities(), None, ("p", "q")) if isinstance(part, Picture))
    words = [one for one in picture.figure.axes[0].texts if one.get_text() == "needed to be named"]
    assert [one.get_position()[0] for one in words] == pytest.approx(marked)


def test_the_flight_is_told_with_what_people_said_of_it(tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path)
    folder.write(
        {
            "started": "2026-05-04T12:30:00+00:00",
            "vehicle": {"profile": "arducopter", "version": "4.5.7", "system": 3, "battery_v": 22.14159, "type": 4},
            "pilot": HOSTILE,
            "mass": 4.2,
            "place": ["no", "text"],
            "checklist": [{"ask": "blades tight", "answer": True}, {"ask": 5}],
            "notes": [{"time": "2026-05-04T12:31:00.000+00:00", "text": HOSTILE, "air_s": 65.0}],
            "runs": [
                {"label": "roll chirp 1/2", "verdict": {"keep": True, "reasons": []}},
                {"label": "roll chirp 2/2", "verdict": {"keep": False, "reasons": ["gust"]}},
                {"label": "odd", "verdict": "keep", "reason": "aborted"},
            ],
        }
    )
    folder.audit(datetime(2026, 5, 4, 12, 40, tzinfo=UTC), "pushed gains b9e9e2", "tippath push gains.json")
    parts = [*flight_parts(folder), *audit_parts(folder)]
    (facts,) = (part for part in parts if isinstance(part, Facts))
    told_of = dict(facts.rows)
    assert told_of["vehicle"] == "helicopter, arducopter, version 4.5.7, system 3"
    assert told_of["at the start"] == "battery 22.14 V"
    assert (told_of["mass"], told_of["started"], "place" in told_of) == ("4.2", "2026-05-04 12:30", False)
    said = [line for part in parts if isinstance(part, Sentences) for line in part.lines]
    assert {"blades tight: yes", "roll chirp 1/2: keep", "roll chirp 2/2: fly again: gust"} <= set(said)
    assert f"2026-05-04 12:31:00, 1:05 in the air: {HOSTILE}" in said
    (done,) = (part for part in parts if isinstance(part, Table))
    assert done.rows[-1] == ("2026-05-04 12:40:00", "pushed gains b9e9e2", "tippath push gains.json")
    assert flown_when(folder) == "2026-05-04 12:30"


def run(axis: str, **more: Any) -> Record:
    channels = {name: np.arange(3.0) for name in ("t", "p", "q", "delta_x", "delta_y")}
    return Record(f"X.BIN#{axis}", channels, axis=axis, path="gone/X.BIN", **more)


def test_a_page_is_called_after_what_flew_what_and_when(tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path)
    chirps = [run(axis, maneuver="chirp", airframe=Airframe.HELICOPTER) for axis in ("roll", "pitch", "roll")]
    assert title_of(folder, chirps) == "Helicopter, roll and pitch chirps"
    assert title_of(folder, [run("roll")]) == "Vehicle, X.BIN"
    folder.write({"started": "2026-05-04T12:30:00+00:00", "card": "hover"})
    assert title_of(folder, chirps) == "Helicopter, card hover, 2026-05-04"
    assert about_of(folder, chirps, ["TPP"]) == "flown 2026-05-04 12:30 UTC, 3 runs of X.BIN, TPP"
    folder.rename("windy")
    assert title_of(folder, chirps) == "windy"
    assert is_simulated(["SIDX_LAW"])
    assert is_simulated(["SIM_WIND_SPD"])
    assert not is_simulated(["SID_AXIS", "SIMPLE", "FRAME_CLASS"])


def test_a_log_without_a_flight_has_nothing_to_tell_of_it(tmp_path: Path) -> None:
    alone = FlightFolder(tmp_path, "X.BIN")
    assert (flight_parts(alone), flown_when(alone), audit_parts(alone)) == ([], "", [])

"""The Fit screen says first what decides, of the model whose curves it draws."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from fake_app import IDLE, app_on, screen_text, settle
from fake_desk import ADDED, COMPARED_RUNG, DESKS, FITTED
from rich.cells import cell_len

from gcs.analysis.quantities import amount
from gcs.tui.fit_words import fit_lines
from gcs.tui.state import joined
from sysid.fit.check_kinds import InsideSweep
from sysid.fit.checks import Check
from sysid.model.parameter import Parameter


def said(desk, width=80) -> list[str]:
    return [one if isinstance(one, str) else one[0] for one in fit_lines(joined(IDLE, desk), width)]


def test_what_decides_comes_before_the_tables_and_is_the_top_rung_s():
    lines = said(DESKS["added"])
    at = next(i for i, line in enumerate(lines) if "TPP + servo_lag: NRMSE" in line)
    assert lines[at + 1].split() == ["fitted", "81.0", "87.6"]
    assert lines[at + 2].split()[-2:] == ["80.3", "86.4"]
    assert lines[at + 3].split()[-2:] == ["82.0", "88.3"]
    text = "\n".join(lines)
    assert text.index("tau_s") < text.index("both bases on flight.BIN#1, #3") < text.index("row   0")
    assert "tau_s" not in "\n".join(said(DESKS["compared"]))


def test_the_check_is_of_the_model_that_is_shown():
    inside = Check("inside the sweep", True, InsideSweep((0.5, 10.0)))
    rung = replace(ADDED, addition=SimpleNamespace(checks=(inside,), placebo_rung=None, signs=()))  # type: ignore[arg-type]
    assert any(
        line.startswith("   ✓ inside the sweep") for line in said(replace(DESKS["added"], ladder=(COMPARED_RUNG, rung)))
    )
    fitted = replace(FITTED, found=SimpleNamespace(tpp=COMPARED_RUNG.fit, cd=FITTED.found.cd, checks=(inside,)))  # type: ignore[arg-type]
    assert any("✓ inside" in line for line in said(replace(DESKS["compared"], fitted=fitted)))
    assert any("not made of this model" in line for line in said(DESKS["added"]))


def test_parameters_take_the_width_there_is():
    rows = {width: [line for line in said(DESKS["added"], width) if "±" in line] for width in (80, 200)}
    assert len(rows[200]) < len(rows[80])
    assert all(cell_len(line) <= width for width, lines in rows.items() for line in lines)
    assert max(map(cell_len, rows[200])) > 100


def test_values_are_rounded_by_their_errors():
    one = Parameter("L_b", "1/s^2", "stiffness")
    assert amount(one, 138.3752, 0.98) == "138.4 ± 1.0 1/s^2"
    assert amount(one, 138.3752, 0.98, 12.34) == "138.4 ± 1.0 (± 12) 1/s^2"
    assert amount(Parameter("tau_f", "s", "lag"), 0.1012, 0.0014, 0.011) == "101.2 ± 1.4 (± 11) ms"


async def test_other_models_are_set_beside_on_the_strips():
    app, _ = app_on(joined(IDLE, DESKS["compared"]))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("4", "g")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "─ ─ CD" in text
        await pilot.press("g")
        await settle(app)
        assert "─ ─ CD" not in "\n".join(screen_text(app))

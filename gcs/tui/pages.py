"""The screens in the order of the work, and the keys that work on all of them."""

from __future__ import annotations

from gcs.tui.actions import GUIDE, HELP, NOTE, QUIT, REPLAY, REVEAL, Act
from gcs.tui.base import Page
from gcs.tui.compare import CompareScreen
from gcs.tui.connect import ConnectScreen
from gcs.tui.controller import ControllerScreen
from gcs.tui.diagnose import DiagnoseScreen
from gcs.tui.fit import FitScreen
from gcs.tui.fly import FlyScreen
from gcs.tui.ladder import LadderScreen
from gcs.tui.report import ReportScreen
from gcs.tui.runs import RunsScreen

PAGES: tuple[type[Page], ...] = (
    ConnectScreen,
    FlyScreen,
    RunsScreen,
    FitScreen,
    CompareScreen,
    DiagnoseScreen,
    LadderScreen,
    ControllerScreen,
    ReportScreen,
)
"""On the keys 1 to 9."""


def mode_of(page: type[Page]) -> str:
    """What Textual calls a screen."""
    return page.NAME.lower()


GENERAL = (
    Act("f12", "app.abort", "ABORT", "abort: back to the mode before the run", "F12"),
    *(
        Act(str(k), f"app.screen('{mode_of(page)}')", page.NAME, f"screen {page.NAME}")
        for k, page in enumerate(PAGES, 1)
    ),
    HELP,
    NOTE,
    GUIDE,
    REVEAL,
    REPLAY,
    Act("k,K", "app.cancel", "", "call off what is being worked on"),
    Act("f9", "app.theme", "", "other colours: dark, black on white for the sun, high contrast, light", "F9"),
    QUIT,
)
"""What works on every screen; the palette lists it."""

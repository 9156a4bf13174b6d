"""What is done with a flight after it was flown: `Desk`, and its state."""

from __future__ import annotations

from gcs.desk.gains_work import GainsDesk as Desk
from gcs.desk.state import Base, Choice, Designed, DeskState, Fitted, Rung, RunRow, TimedNote
from gcs.desk.working import Cancelled

__all__ = ["Base", "Cancelled", "Choice", "Designed", "Desk", "DeskState", "Fitted", "RunRow", "Rung", "TimedNote"]

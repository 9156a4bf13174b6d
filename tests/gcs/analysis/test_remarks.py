"""What the runs, and the search, cost the answer of a diagnosis, in words."""

from __future__ import annotations

import pytest

from gcs.analysis.diagnosis import StepsLost
from gcs.analysis.text.remarks import remark_text
from sysid.diagnose.unsearched import BudgetSpent, LittleLeft, MuchLeft


@pytest.mark.parametrize(
    ("finding", "text"),
    [
        (LittleLeft(0.041), "chains of two were not searched: at most 0.1 points of NRMSE are left"),
        (LittleLeft(0.1), "chains of two were not searched: at most 0.1 points of NRMSE are left"),
        (
            BudgetSpent((("servo_lag", "servo_deadband"),), ("yaw_coupling",)),
            "chains of two not tried, because they cost much and promised less: servo_lag + servo_deadband and all "
            "beside yaw_coupling",
        ),
        (
            BudgetSpent((("servo_lag", "servo_deadband"),), (), interrupted=True),
            "chains of two not tried, because the search was interrupted: servo_lag + servo_deadband",
        ),
        (BudgetSpent((), (), interrupted=True), "the search for chains of two was interrupted"),
        (
            MuchLeft(("lead_lag", "effects/worn_hinge.py"), 0.541),
            "other chains of two were not searched: the best with the likeliest effect, lead_lag + worn_hinge.py, "
            "explains 54 % of what is there, and where a chain is the answer it is nearly all",
        ),
        (
            StepsLost(("flight.BIN#5", "flight.BIN#6")),
            "not judged by flight.BIN#5 and flight.BIN#6: the log is slower than the loop and does not tell when their "
            "commands stepped. Log every loop, or validate by chirps",
        ),
    ],
)
def test_what_was_not_asked_in_words(finding: LittleLeft | BudgetSpent | MuchLeft | StepsLost, text: str) -> None:
    assert remark_text(finding) == text

"""Commands that act before their time stamps, as people read it."""

from __future__ import annotations

from gcs.analysis.diagnosis import ClocksDiffer
from gcs.analysis.text.checks import check_text
from gcs.analysis.text.remarks import remark_text
from sysid.fit.check_kinds import CommandsLate, CommandsThinned
from sysid.fit.checks import Check


def test_a_thinned_log_is_told_with_what_to_do() -> None:
    check = Check("time of commands", False, CommandsThinned(0.00404, 0.00013, 0.01))
    assert check_text(check) == (
        "commands act 4.0 ± 0.1 ms before their time stamps, as those of a faster loop do in a log of 100 Hz: lags "
        "come out short by that; say the loop's rate with --loop-rate, or loop_rate_hz in a profile"
    )


def test_clocks_that_differ_are_told_with_what_to_do() -> None:
    assert remark_text(ClocksDiffer(CommandsLate(0.0061, 0.0002))) == (
        "commands are stamped 6.1 ± 0.2 ms late, or rates as much early: two clocks differ, or a filter is in the log "
        "that the vehicle does not have; commands_late_s in a profile's [time] sets it right. That explains what the "
        "model leaves, and no effect does it better"
    )

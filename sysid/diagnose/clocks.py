"""Whether what a model leaves is not the vehicle's at all: commands that were stamped late, or thinned by the log."""

from __future__ import annotations

from sysid.diagnose.evidence import error_share
from sysid.diagnose.shares import least
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.check_kinds import CommandsLate, CommandsThinned
from sysid.fit.clocks import early_commands


def clocks(found: Diagnosis) -> CommandsLate | CommandsThinned | None:
    """What it is where a shift of all commands explains what can be explained, and no effect does more; else None."""
    parent, winner = found.parent, found.winner
    if found.verdict == "complete" or found.thinned is not None:
        return None
    fixed = {name: parent.model[name] for name in parent.held}
    early = early_commands(parent.model, parent.dataset, fixed)
    if early is None:
        return None
    left = error_share(early.error)
    explained = (parent.error_share - left) / max(parent.error_share - found.noise_share, 1e-300)
    better = winner is None or winner.fit is None or found.verdict != "missing" or left < winner.fit.error_share
    return early.what if explained >= least(parent.division) and better else None

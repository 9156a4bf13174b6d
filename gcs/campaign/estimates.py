"""What one log's fit says of each parameter, as the statistics take it."""

from __future__ import annotations

from gcs.campaign.work import Outcome
from sysid.campaign.values import Estimate


def estimates_of(one: Outcome) -> dict[str, Estimate]:
    """Parameter -> its estimate; nothing of a log without a fit. Without a date it is of day 0."""
    if one.fit is None:
        return {}
    day = 0 if one.when is None else one.when.day
    return {
        name: Estimate(flight=one.key, day=day, value=each.value, error=each.standard_error, conditions=one.conditions)
        for name, each in one.fit.parameters.items()
    }

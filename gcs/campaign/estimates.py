"""What one log's fit says of each parameter, as the statistics take it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from gcs.campaign.work import Number, Numbers, Outcome
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


def with_bounds(flights: Sequence[Outcome]) -> list[Outcome]:
    """A group's flights, in each of which what ended at its bound is an estimate, too: there, and as well known as the
    others know it in the middle; what ended there in all is none.

    A delay of 0 ends at its bound in every other flight. Left out, it could not be seen to come, and its mean were that
    of the flights whose errors made it positive. Where nothing changed the orders of the days stay as likely as each
    other, for it depends on no order what is at a bound: chances hold, while a size is one of values cut off there.
    """
    errors: dict[str, list[float]] = defaultdict(list)
    for one in flights:
        for name, each in one.fit.parameters.items() if one.fit is not None else ():
            errors[name].append(each.standard_error)
    known = {name: float(np.median(each)) for name, each in errors.items()}
    return [one if one.fit is None else msgspec.structs.replace(one, fit=_freed(one.fit, known)) for one in flights]


def _freed(fit: Numbers, known: Mapping[str, float]) -> Numbers:
    """With what is at a bound, which goes with no other parameter."""
    more = {name: each for name, each in fit.at_bound.items() if name in known}
    count, size = len(fit.parameters), len(fit.parameters) + len(more)
    covariance = np.zeros((size, size))
    covariance[:count, :count] = fit.covariance
    covariance[range(count, size), range(count, size)] = [known[name] ** 2 for name in more]
    numbers = {
        name: Number(value=each.value, unit=each.unit, standard_error=known[name], model_error=0.0)
        for name, each in more.items()
    }
    return msgspec.structs.replace(
        fit, parameters={**fit.parameters, **numbers}, covariance=tuple(tuple(map(float, row)) for row in covariance)
    )

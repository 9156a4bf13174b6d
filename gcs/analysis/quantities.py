"""Numbers as people read them: a parameter's value with its error and unit, and what is plausible for it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence

from sysid.model.effect import tied
from sysid.model.parameter import Parameter


def quantity(parameter: Parameter, value: float, error: float | None = None) -> str:
    """`tau_s = 31.2 ± 0.4 ms`; times below a second in milliseconds."""
    return f"{parameter.name} = {amount(parameter, value, error)}"


def amount(parameter: Parameter, value: float, error: float | None = None, model_error: float | None = None) -> str:
    """The value with its unit; `138.4 ± 1.0 (± 12) 1/s^2` with what standard errors do not know of."""
    if not math.isfinite(value):
        return "no limit"
    return amount_in(parameter.unit, value, error, model_error)


def amount_in(unit: str, value: float, error: float | None = None, model_error: float | None = None) -> str:
    """As `amount`, of a number that is no parameter's: `20 ± 3 ms` of seconds."""
    times, word = _unit(unit, value)
    if error is None or not (error > 0 and math.isfinite(error)):
        return f"{times * value:.3g}{word}"
    digits = decimals(times * error)
    model = "" if model_error is None else f" (± {float(f'{times * model_error:.2g}'):g})"
    return f"{times * value:.{digits}f} ± {times * error:.{digits}f}{model}{word}"


def decimals(error: float) -> int:
    """How many decimals a value with this standard error is worth, which is above zero and finite."""
    digits = max(0, 1 - math.floor(math.log10(error)))
    return digits - (digits > 0 and error * 10**digits >= 20)  # one digit of an error is enough above 2


def plausible_range(parameter: Parameter) -> str:
    """`0 to 80 ms`; empty where anything goes."""
    low, high = parameter.plausible
    ends = [x for x in (low, high) if math.isfinite(x)]
    if not ends:
        return ""
    times, unit = _unit(parameter.unit, max(ends, key=abs))
    if low == high:
        return f"{times * low:g}{unit}"
    if len(ends) == 2:
        return f"{times * low:g} to {times * high:g}{unit}"
    return f"{'at least' if math.isfinite(low) else 'at most'} {times * ends[0]:g}{unit}"


def _unit(unit: str, value: float) -> tuple[float, str]:
    if unit == "s" and abs(value) < 1:
        return 1000.0, " ms"
    return 1.0, "" if unit == "-" else f" {unit}"


def stands_in(names: str, effects: Iterable[str], outside: Collection[str]) -> str:
    """What is said of effects, under these names, that explain what is left with parameters `outside` what physics
    allows."""
    if outside and set(outside) <= tied(effects):
        return f"{names} would do it on a tether or a stand; in free flight it stands in"
    return f"{names} would do it, but only at implausible values: it stands in"


def listed(words: Sequence[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def amount_signed(one: Parameter, value: float) -> str:
    """`M_q = +4.69 1/s`: where the sign is the news."""
    said = quantity(one, value)
    return said.replace("= ", "= +", 1) if value > 0 else said

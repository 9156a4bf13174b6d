"""Which profile suits a log: of the bundled ones by what the log holds, or one made of a CSV's own header."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from gcs.logs.formats.tables import Log
from gcs.logs.profile.profiles import ChannelSource, Profile, bundled_profiles
from gcs.logs.profile.sources import keys_of
from gcs.logs.profile.units import factor_or_ask
from sysid.data.record import CHANNELS, RATES, REQUIRED


def choose(log: Log, candidates: Sequence[Profile]) -> Profile | None:
    """The fitting profile of the highest priority, unless another has rates and commands at least twice as often.

    (Old logs keep RATE at 10 Hz, and the gyro itself and the motors at 50.) None where none fits.
    """
    fitting = [(profile, _spacing(profile, log)) for profile in candidates if profile.fits(log)]
    if not fitting:
        return None
    fastest = min(spacing for _, spacing in fitting)
    return next(profile for profile, spacing in fitting if spacing <= 2 * fastest or math.isinf(fastest))


def _spacing(profile: Profile, log: Log) -> float:
    """Median spacing of rates or commands, whichever are logged more slowly; infinite where either is not."""
    worst = 0.0
    for name in ("p", "delta_x"):
        spacings = [math.inf]
        for text in profile.channels[name].sources if name in profile.channels else ():
            keys = keys_of(text, log)
            if keys and all(log.has(key) for key in keys):
                spacings.append(max(log.series(key).spacing_s for key in keys))
        worst = max(worst, min(spacings))
    return worst


def contract_profile(header: Sequence[str], units: Mapping[str, str] | None = None, path: str = "") -> Profile:
    """For a CSV whose columns carry the channels' own names.

    units: column -> unit as the file writes it, where it does; others are taken to be the channel's own. Raises
    TippathError for a unit that is not known.
    """
    names = [name for name in header if name in CHANNELS]
    where = f"{path}, line 1" if path else "line 1"
    written = {name: (units or {}).get(name, "") for name in names}
    scales = {name: factor_or_ask(name, written[name], f"{where}, column {name}") for name in names}
    converted = [f"{name} from {written[name]}" for name in names if scales[name] != 1.0]
    channels = {name: ChannelSource(name, (name,), scales[name]) for name in names if name != "t"}
    notes = (f"units converted as the header gives them: {', '.join(converted)}",) if converted else ()
    return Profile(
        name="channels", channels=channels, kind="csv", time_source="t", time_scale=scales.get("t"), notes=notes
    )


def contract_profile_within(fields: Collection[str], kind: str) -> Profile:
    """For arrays that carry the channels' own names, all of them or all those of one struct (`run.p`)."""
    structs = dict.fromkeys(name.rpartition(".")[0] for name in fields if name.rpartition(".")[2] == "p")
    around = [f"{struct}." if struct else "" for struct in structs]
    prefix = next((each for each in around if all(f"{each}{name}" in fields for name in REQUIRED)), "")
    names = [name for name in CHANNELS if f"{prefix}{name}" in fields and name != "t"]
    channels = {name: ChannelSource(name, (f"{prefix}{name}",)) for name in names}
    return Profile(name="channels", channels=channels, kind=kind, time_source=f"{prefix}t")


def taking_one_of(kinds: Collection[str]) -> str:
    """`--profile NAME` of the bundled profile that takes the rates from one of these kinds of message alone."""
    for profile in reversed(bundled_profiles()):  # the plainest last
        sources = {source.split(".")[0] for name in RATES for source in profile.channels[name].sources}
        if len(sources) == 1 and sources <= set(kinds):
            return f"--profile {profile.name}"
    return "--profile FILE.toml"

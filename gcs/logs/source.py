"""A log as it was read: what is known of the file itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.logs.formats.damage import Damage
from gcs.logs.formats.joined import Joined
from gcs.logs.profile.profiles import Profile


@dataclass(frozen=True, kw_only=True)
class Source:
    """A log as it was read."""

    path: str
    sha256: str
    """Of its bytes; of logs read together, of theirs, unless the others add nothing to it."""
    kind: str
    """The log's, such as `dataflash`; `record` for what tippath wrote."""
    profile: Profile | None = None
    damage: Damage | None = None
    """None where the format has no way to tell."""
    fields: tuple[str, ...] = ()
    """What the log holds, for writing a profile."""
    notes: tuple[str, ...] = ()
    """What is wrong with the log and so with every run of it."""
    hints: tuple[str, ...] = ()
    """What whoever ingests it should know, but not whoever fits its runs."""
    joined: Joined | None = None
    """What came of reading it with others of the same flight; None where it was read alone."""
    apart: Mapping[str, str] = field(default_factory=dict)
    """Path of a log beside it -> why it was not joined."""

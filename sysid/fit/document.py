"""What a saved fit must hold (`tippath.fit/1`) before any of it is believed: of its keys those that are read again."""

from __future__ import annotations

from sysid.document import Open

Number = float | None
"""null where it is not finite."""
ByOutput = dict[str, Number]


class StructureDocument(Open, frozen=True, kw_only=True):
    base: str
    effects: tuple[str, ...]
    user_base: dict[str, str] = {}
    """Path -> sha256 of the file that the fit was made with;"""
    user_effects: dict[str, str] = {}
    """the same."""
    outputs: tuple[str, ...] | None = None
    channels: tuple[str, ...] = ()
    constants: dict[str, float] = {}


class ParameterDocument(Open, frozen=True, kw_only=True):
    value: float
    at_bound: bool
    fixed: bool
    model_error_by: dict[str, Number] | None = None


class RecordDocument(Open, frozen=True, kw_only=True):
    id: str
    path: str
    sha256: str
    maneuver: str
    axis: str | None = None
    duration_s: float
    samples: int
    rate_hz: float
    gaps: tuple[tuple[float, float], ...]
    airframe: str | None = None
    loop_rate_hz: float | None = None
    loop_told_by: str = ""


class RungDocument(Open, frozen=True, kw_only=True):
    effects: tuple[str, ...]
    nrmse_percent: ByOutput
    validation_nrmse_percent: ByOutput | None


class FitDocument(Open, frozen=True, kw_only=True):
    structure: StructureDocument
    parameters: dict[str, ParameterDocument]
    covariance: tuple[tuple[Number, ...], ...]
    nrmse_percent: ByOutput
    validation_nrmse_percent: ByOutput | None
    records: tuple[RecordDocument, ...]
    validation_records: tuple[RecordDocument, ...] = ()
    lineage: tuple[RungDocument, ...]
    band_hz: tuple[float, float]
    band_from: str | None = None
    warnings: tuple[str, ...]
    profile: str | None
    window_s: tuple[Number, Number] | None = None
    weights: str | None = None
    instrument: str | None = None

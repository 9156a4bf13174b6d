"""The JSON documents that other programs rely on, as JSON Schema."""

from __future__ import annotations

from typing import Any

NUMBER = {"type": "number"}
MAYBE = {"type": ["number", "null"]}
TEXT = {"type": "string"}


def exactly(required: dict[str, Any]) -> dict[str, Any]:
    """An object with at least these keys; more may be added within a format number."""
    return {"type": "object", "properties": required, "required": list(required)}


def listed(item: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": item}


def matrix(rows: int, columns: int) -> dict[str, Any]:
    row = {"type": "array", "items": NUMBER, "minItems": columns, "maxItems": columns}
    return {"type": "array", "items": row, "minItems": rows, "maxItems": rows}


NRMSE = exactly({"p": MAYBE, "q": MAYBE})
MAYBE_NRMSE = {"anyOf": [NRMSE, {"type": "null"}]}

FIT = exactly(
    {
        "format": {"const": "tippath.fit/1"},
        "structure": exactly({"base": {"enum": ["cd", "tpp", "multirotor"]}, "effects": listed(TEXT)}),
        "parameters": {
            "type": "object",
            "minProperties": 5,
            "additionalProperties": exactly(
                {
                    "value": NUMBER,
                    "unit": TEXT,
                    "standard_error": MAYBE,
                    "cramer_rao_percent": MAYBE,
                    "insensitivity_percent": MAYBE,
                    "at_bound": {"type": "boolean"},
                    "implausible": {"type": "boolean"},
                    "fixed": {"type": "boolean"},
                    "determined": {"type": "boolean"},
                }
            ),
        },
        "modes": listed(exactly({"frequency_hz": NUMBER, "damping_ratio": NUMBER})),
        "stable": {"type": "boolean"},
        "nrmse_percent": NRMSE,
        "validation_nrmse_percent": MAYBE_NRMSE,
        "records": listed(
            exactly(
                {
                    "id": TEXT,
                    "path": TEXT,
                    "sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
                    "maneuver": TEXT,
                    "duration_s": NUMBER,
                    "samples": {"type": "integer"},
                    "rate_hz": NUMBER,
                    "gaps": listed({"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}),
                }
            )
        ),
        "lineage": listed(
            exactly({"effects": listed(TEXT), "nrmse_percent": NRMSE, "validation_nrmse_percent": MAYBE_NRMSE})
        ),
        "matrices": exactly({**{name: listed(listed(NUMBER)) for name in "ABCD"}, "input_delay_s": listed(NUMBER)}),
        "covariance": listed(listed(MAYBE)),
        "correlations": listed(exactly({"parameters": listed(TEXT), "correlation": MAYBE})),
        "band_hz": {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2},
        "weights": {"enum": ["residual spectrum", "constant"]},
        "instrument": {"enum": ["excitation logged", "excitation rebuilt", "prediction error", "commands", None]},
        "profile": {"type": ["string", "null"]},
        "warnings": listed(TEXT),
        "version": TEXT,
    }
)

OF_OUTPUTS = {"type": "object", "minProperties": 1, "additionalProperties": MAYBE}
FIT_ALONE = exactly(
    {
        **FIT["properties"],
        "structure": exactly({"base": {"enum": ["roll", "pitch", "yaw", "heave"]}, "effects": listed(TEXT)}),
        "parameters": {**FIT["properties"]["parameters"], "minProperties": 2},
        "nrmse_percent": OF_OUTPUTS,
        "validation_nrmse_percent": {"anyOf": [OF_OUTPUTS, {"type": "null"}]},
        "lineage": listed(exactly({"effects": listed(TEXT), "nrmse_percent": OF_OUTPUTS})),
    }
)
"""Of one axis alone, which has other outputs than p and q."""

RESPONSE = exactly(
    {
        "output": {"enum": ["p", "q"]},
        "input": TEXT,
        "band_hz": {"anyOf": [{"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}, {"type": "null"}]},
        **dict.fromkeys(("rms_db", "rms_deg", "largest_db", "largest_deg", "cost"), MAYBE),
    }
)
JUDGED = exactly(
    {
        "guides": exactly(dict.fromkeys(("cramer_rao_percent", "insensitivity_percent", "coherence", "cost"), NUMBER)),
        "responses": listed(RESPONSE),
        "responses_reference": {"type": "object", "additionalProperties": TEXT},
        "checks": listed(exactly({"name": TEXT, "passed": {"type": ["boolean", "null"]}, "text": TEXT})),
        "spread": {
            "anyOf": [
                exactly({"sets": {"type": "integer"}, "standard_errors": {"type": "object"}, "moved": listed(TEXT)}),
                {"type": "null"},
            ]
        },
        "low_edges": {
            "anyOf": [
                exactly(
                    {
                        "low_hz": listed(NUMBER),
                        "values": {"type": "object", "additionalProperties": listed(NUMBER)},
                        "standard_errors": {"type": "object", "additionalProperties": NUMBER},
                        "moved": listed(TEXT),
                    }
                ),
                {"type": "null"},
            ]
        },
        "implied": listed(
            exactly(
                {
                    "name": TEXT,
                    "unit": TEXT,
                    "value": MAYBE,
                    "standard_error": MAYBE,
                    "measured": MAYBE,
                    "implausible": {"type": "boolean"},
                }
            )
        ),
    }
)
"""What the `fit` command adds to a fit's own document."""

GAINS = exactly(
    {
        "format": {"const": "tippath.gains/1"},
        "K": matrix(2, 4),
        "observer_gain": matrix(4, 2),
        "prefilter": matrix(2, 2),
        "poles": listed(exactly({"real": NUMBER, "imag": NUMBER})),
        "observer_poles": listed(exactly({"real": NUMBER, "imag": NUMBER})),
        "elevator": {"type": ["object", "null"]},
        "dynamic_prefilter": {"type": ["object", "null"]},
        "margins": exactly({"gain_db": MAYBE, "phase_deg": MAYBE, "delay_ms": MAYBE}),
        "model": exactly({"structure": TEXT, "parameters": {"type": "object", "additionalProperties": NUMBER}}),
    }
)

RUNS = exactly(
    {
        "format": {"const": "tippath.runs/1"},
        "runs": listed(
            exactly(
                {
                    "id": TEXT,
                    "path": TEXT,
                    "maneuver": TEXT,
                    "axis": {"type": ["string", "null"]},
                    "start_s": NUMBER,
                    "duration_s": NUMBER,
                    "rate_hz": MAYBE,
                    "gaps": listed({"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}),
                    "usable": {"type": "boolean"},
                    "reasons": listed(TEXT),
                }
            )
        ),
        "damage": {"type": "object"},
    }
)

SHARES = exactly({"p": MAYBE, "q": MAYBE})
LEVEL = exactly(
    {"axis": TEXT, "channel": TEXT, "low": NUMBER, "high": NUMBER, "time_share": NUMBER, "error_share": NUMBER}
)
COMPARE = exactly(
    {
        "format": {"const": "tippath.compare/1"},
        "nrmse_percent": NRMSE,
        "bands": listed(
            exactly(
                {
                    "axis": {"enum": ["roll", "pitch"]},
                    "low_hz": NUMBER,
                    "high_hz": NUMBER,
                    "error_share": {"type": "number", "minimum": 0, "maximum": 1},
                    "coherence": {
                        "type": "object",
                        "additionalProperties": {"type": "number", "minimum": 0, "maximum": 1},
                    },
                }
            )
        ),
        "windows": listed(
            exactly({"axis": TEXT, "run": TEXT, "start_s": NUMBER, "stop_s": NUMBER, "error_share": NUMBER})
        ),
        "noise_share": SHARES,
        "noise_share_is": {"enum": ["measured", "upper bound, closed loop"]},
        "noise_from": {"enum": ["quiet hover", "logged excitation", "commands"]},
        "noise_floor_percent": MAYBE_NRMSE,
        "more_than_noise": {"type": ["boolean", "null"]},
        "findings": {"type": "array", "items": TEXT, "minItems": 1},
        "responses": listed(exactly({**RESPONSE["properties"], "noticed_hz": listed(listed(NUMBER))})),
        "amplitude": exactly({"levels": listed(LEVEL), "growth": listed({"type": "object"})}),
        "conditions": listed(LEVEL),
        "runs": listed(exactly({"id": TEXT, "nrmse_percent": NRMSE, "error_share": SHARES})),
        "suspicions": listed(exactly({"kind": TEXT, "runs": listed(TEXT), "text": TEXT})),
    }
)

SHARE = {"type": ["number", "null"], "minimum": 0, "maximum": 1}
MAYBE_TEXT = {"type": ["string", "null"]}
CANDIDATE = exactly(
    {
        "effect": TEXT,
        "explained_share": SHARE,
        "delta_bic": MAYBE,
        "nrmse_percent": MAYBE_NRMSE,
        "validation_nrmse_percent": MAYBE_NRMSE,
        "parameters": {"type": "object", "additionalProperties": MAYBE},
        "implausible": {"type": "boolean"},
        "not_testable": MAYBE_TEXT,
    }
)
MAYBE_NEXT = {
    "anyOf": [
        exactly(
            {
                "maneuver": TEXT,
                "separates": {"type": "array", "items": TEXT, "minItems": 2},
                "why": TEXT,
                "fit_runs": listed(TEXT),
            }
        ),
        {"type": "null"},
    ]
}
DIAGNOSIS = exactly(
    {
        "format": {"const": "tippath.diagnosis/1"},
        "verdict": {"enum": ["complete", "missing", "unexplained"]},
        "reason": {"enum": ["clocks", "feedback", None]},
        "effect": MAYBE_TEXT,
        "chain": {"type": "array", "items": TEXT, "maxItems": 2},
        "stands_in": {"type": "boolean"},
        "indistinguishable": listed(TEXT),
        "indistinguishable_pairs": listed(listed(TEXT)),
        "equivalent": {"type": "object", "additionalProperties": listed(TEXT)},
        "confidence": {"type": "number", "minimum": 0, "maximum": 1},
        "explained_share": SHARE,
        "candidates": {"type": "array", "items": CANDIDATE, "minItems": 1},
        "pairs": listed(CANDIDATE),
        "placebo": MAYBE_TEXT,
        "noise_floor_percent": NRMSE,
        "could_hide": listed(TEXT),
        "character": exactly({"findings": listed(TEXT), "bands": listed({"type": "object"})}),
        "next_maneuver": MAYBE_NEXT,
        "explanation": exactly({part: listed(TEXT) for part in ("effects", "what", "why", "changes", "resembles")}),
        "suspicions": COMPARE["properties"]["suspicions"],
        "remarks": listed(TEXT),
        "first_answer": {
            "anyOf": [exactly({"verdict": TEXT, "chain": listed(TEXT), "confidence": NUMBER}), {"type": "null"}]
        },
        "unsearched_chains": {
            "anyOf": [
                exactly({"reason": {"const": "little left"}, "points": NUMBER}),
                exactly({"reason": {"const": "budget"}, "chains": listed(TEXT), "firsts": listed(TEXT)}),
                exactly({"reason": {"const": "much left"}, "chain": listed(TEXT), "explained": NUMBER}),
                {"type": "null"},
            ]
        },
        "rungs": {
            "type": "array",
            "minItems": 1,
            "items": exactly(
                {
                    "effects": listed(TEXT),
                    "nrmse_percent": NRMSE,
                    "validation_nrmse_percent": MAYBE_NRMSE,
                    "verdict": TEXT,
                    "effect": MAYBE_TEXT,
                    "confidence": NUMBER,
                }
            ),
        },
    }
)

ADDED = exactly(
    {
        "noise_floor_percent": NRMSE,
        "placebo": {"anyOf": [CANDIDATE, {"type": "null"}]},
        "signs": {
            "type": "array",
            "minItems": 3,
            "maxItems": 3,
            "items": exactly(
                {
                    "key": {"enum": ["validation", "agreement", "plausible"]},
                    "name": TEXT,
                    "seen": {"type": ["boolean", "null"]},
                    "text": TEXT,
                }
            ),
        },
    }
)
"""What the `add` command adds to a fit's own document."""

REVEAL = exactly(
    {
        "format": {"const": "tippath.reveal/1"},
        "sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "plant": TEXT,
        "seed": {"type": "integer"},
        "condition": TEXT,
        "hidden": TEXT,
        "answer": MAYBE_TEXT,
        "accepts": listed(TEXT),
        "level": {"enum": ["catalogue", "below", "beyond", "none"]},
        "sizes": {"type": "object", "additionalProperties": NUMBER},
        "expect": {"type": "object", "additionalProperties": NUMBER},
        "sentence": TEXT,
        "diagnoses": listed(
            exactly(
                {
                    "path": TEXT,
                    "verdict": TEXT,
                    "effect": MAYBE_TEXT,
                    "outcome": {"enum": ["right", "same", "not_told_apart", "stand_in", "missed", "wrong"]},
                    "parameters": listed(exactly({"name": TEXT, "said": NUMBER, "truth": NUMBER})),
                }
            )
        ),
    }
)

MAYBES = listed(MAYBE)
FREQUENCY_RESPONSE = exactly(
    {
        "format": {"const": "tippath.response/1"},
        "band_hz": listed(NUMBER),
        "inputs": listed(TEXT),
        "outputs": listed(TEXT),
        "frequency_hz": listed(NUMBER),
        "references": {"type": "object", "additionalProperties": TEXT},
        "feedback_kept_out_by": {
            "type": "object",
            "additionalProperties": {"enum": ["excitation logged", "excitation rebuilt", "commands"]},
        },
        "bounds_percent": NUMBER,
        "responses": listed(
            exactly(
                {
                    **dict.fromkeys(("output", "input", "unit"), TEXT),
                    "reason": MAYBE_TEXT,
                    "valid_hz": {"anyOf": [{"type": "null"}, listed(NUMBER)]},
                    "valid": listed({"type": "boolean"}),
                    **dict.fromkeys(("db", "deg", "real", "imaginary", "coherence"), MAYBES),
                    **dict.fromkeys(("bound_db", "bound_deg", "window_hz"), MAYBES),
                }
            )
        ),
        "multiple_coherence": {"type": "object", "additionalProperties": MAYBES},
        "runs": listed({"type": "object"}),
        "remarks": listed(TEXT),
        "warnings": listed(TEXT),
    }
)

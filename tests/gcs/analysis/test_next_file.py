"""The file that a diagnosis proposes for the fit with what was found."""

from __future__ import annotations

import pytest

from gcs.analysis.text.diagnosis import next_file


@pytest.mark.parametrize(
    ("fit", "proposed"),
    [
        ("tpp.json", "tpp-2.json"),
        ("flights/tpp-2.json", "flights/tpp-3.json"),
        ("heli-9.json", "heli-10.json"),
        ("flight-0001.json", "flight-0001-2.json"),
    ],
)
def test_a_rung_higher_has_the_next_number(fit: str, proposed: str) -> None:
    assert next_file(fit) == proposed

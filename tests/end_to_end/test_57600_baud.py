"""A stock ArduCopter with its default parameters over 57,600 baud, in fake time: from `check` to a fitted model.

What is compared with is what the simulated vehicle flies with: its plant's own numbers, and the file on its card.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from slow_flight import BYTES_S, SlowFlight

from gcs.cli import main
from sitl.plants.table4 import TABLE_4

CARD = """
name = "short"
rest_s = 2
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.08
duration_s = 10
f_start_hz = 1
noise_fraction = 0
fade_in_s = 1
[[maneuver]]
kind = "chirp"
axis = "pitch"
amplitude = 0.08
duration_s = 10
f_start_hz = 1
noise_fraction = 0
fade_in_s = 1
"""
TRUTH = {name: getattr(TABLE_4, name) for name in ("L_b", "M_a", "tau_f", "A_lat", "A_lon", "B_lat")}


@pytest.mark.thorough
def test_from_check_to_a_fitted_model_with_default_parameters(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = SlowFlight(monkeypatch, "hover-ideal", "ardupilot-heli", tmp_path / "sd")
    (tmp_path / "card.toml").write_text(CARD)
    flight = tmp_path / "flight-0001"
    flown.sleep(42.0)  # it boots

    assert flown.tippath("check", "--card", tmp_path / "card.toml", "-o", tmp_path / "heli.param") == 0
    said = capsys.readouterr().out
    assert "its log comes from the vehicle's card afterwards" in said
    assert "LOG_BITMASK 180222" in said

    flown.pilot("takeoff")
    flown.sleep(8.0)
    assert flown.tippath("sweep", "--log", "card", "--card", tmp_path / "card.toml", "-o", flight) == 0
    said = capsys.readouterr().out
    assert f"`tippath fetch --connect LINK -o {flight}`" in said

    assert flown.tippath("fetch", "-o", flight) == 1, "still in the air"
    flown.pilot("land")
    flown.sleep(25.0)
    began = flown.now()
    capsys.readouterr()
    assert flown.tippath("fetch", "-o", flight, "--json") == 0
    took_s = flown.now() - began
    out, err = capsys.readouterr()
    fetched = json.loads(out)
    assert fetched["runs"] == [1, 2]
    whole = (tmp_path / "sd" / "vehicle-1.BIN").read_bytes()
    part = Path(fetched["file"]).read_bytes()
    assert len(part) < 0.9 * len(whole)
    assert 0.7 * BYTES_S < fetched["bytes_per_s"] <= BYTES_S
    said_s = float(re.search(r"alone, .* in about ([\d.]+)( s| minutes)", err)[1]) * (60 if "minutes" in err else 1)  # type: ignore[index]
    assert took_s == pytest.approx(said_s, abs=45.0), "said first"

    assert main(["ingest", str(flight), "--flight", str(flight)]) == 0
    assert capsys.readouterr().out.count(" chirp is fetched-") == 2
    assert main(["fit", str(flight), "--model", "tpp", "-o", str(tmp_path / "tpp.json")]) == 0
    fit = json.loads((tmp_path / "tpp.json").read_text())
    assert {name: fit["parameters"][name]["value"] for name in TRUTH} == pytest.approx(TRUTH, rel=0.1)
    assert min(fit["nrmse_percent"].values()) > 80.0

"""Files of frequency responses as runs: every kind of file, what is told of it, and what damage does."""

from __future__ import annotations

import io
import json
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from injuries import COUNTS, bounded_turns, injure
from scipy.io import savemat

import sysid
from gcs.analysis.response_files import KINDS
from gcs.analysis.text.response import response_document
from gcs.cli import main
from gcs.errors import TippathError
from gcs.logs import Run, ingest
from sysid.response.flown import flown_responses

Saved = Callable[[bytes, str], Path]
OMEGA = np.geomspace(3.0, 60.0, 90)
PAIR = b'[response]\ninput = "delta_y"\noutput = "q"\n'
NUMBERS = {"L_p": -2.0, "L_q": -8.0, "M_p": 10.5, "M_q": -4.8}
NUMBERS |= {"L_lat": -5.4, "L_lon": 9.9, "M_lat": -67.6, "M_lon": 11.1}


def answer(omega: np.ndarray = OMEGA) -> np.ndarray:
    return 30 / (1j * omega + 4)


def columns(*named: tuple[str, np.ndarray], separator: str = ",", falling: bool = False) -> bytes:
    table = np.column_stack([values for _, values in named])
    rows = [separator.join(f"{x:.9g}" for x in row) for row in (table[::-1] if falling else table)]
    return "\n".join([separator.join(name for name, _ in named), *rows, ""]).encode()


def read(path: Path, profile: Path | None = None) -> Run:
    (run,) = ingest([path], profile).runs
    return run


def real(omega: np.ndarray = OMEGA) -> list[tuple[str, np.ndarray]]:
    return [("real", answer(omega).real), ("imaginary", answer(omega).imag)]


WRITTEN: dict[str, bytes] = {
    "omega": columns(("omega", OMEGA), *real()),
    "falling": columns(("omega", OMEGA), *real(), falling=True),
    "semicolons": columns(("omega", OMEGA), *real(), separator=";"),
    "hertz": columns(("frequency_hz", OMEGA / 2 / np.pi), *real()),
    "unit in the header": columns(("frequency [rad/s]", OMEGA), *real()),
    "decibels": columns(
        ("f", OMEGA / 2 / np.pi),
        ("dB", 20 * np.log10(np.abs(answer()))),
        ("phase (deg)", np.rad2deg(np.angle(answer()))),
    ),
    "size": columns(("w", OMEGA), ("mag", np.abs(answer())), ("deg", np.rad2deg(np.angle(answer())))),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_every_way_to_write_columns(saved: Saved, how: str) -> None:
    run = read(saved(WRITTEN[how], "r.csv"), saved(PAIR, "p.toml"))
    assert (run.maneuver, run.axis, run.usable) == ("response", "pitch", True)
    assert run.swept_band_hz == pytest.approx((OMEGA[0] / 2 / np.pi, OMEGA[-1] / 2 / np.pi))
    assert run.record is not None
    fit = sysid.fit_model([run.record], "pitch", band_hz=run.swept_band_hz)
    assert fit.model["M_q"] == pytest.approx(-4, rel=0.02)
    assert fit.model["M_lon"] == pytest.approx(30, rel=0.02)


def test_columns_without_names_and_a_sign(saved: Saved) -> None:
    body = WRITTEN["omega"].split(b"\n", 1)[1]
    profile = PAIR + b'columns = ["omega", "real", "imaginary"]\nscale = -1\n'
    for raw in (body, body.replace(b",", b"  "), b"# flown\n" + body):
        run = read(saved(raw, "r.txt"), saved(profile, "p.toml"))
        assert run.record is not None
        fit = sysid.fit_model([run.record], "pitch", band_hz=run.swept_band_hz)
        assert fit.model["M_lon"] == pytest.approx(-30, rel=0.02)


def test_arrays_of_matlab(saved: Saved) -> None:
    stream = io.BytesIO()
    savemat(stream, {"w": OMEGA, "G": answer(), "gamma2": np.full(OMEGA.size, 0.9)})
    profile = PAIR + b'frequency = "w"\nunit = "rad/s"\nresponse = "G"\n'
    run = read(saved(stream.getvalue(), "r.mat"), saved(profile, "p.toml"))
    assert run.record is not None
    fit = sysid.fit_model([run.record], "pitch", band_hz=run.swept_band_hz)
    assert fit.model["M_lon"] == pytest.approx(30, rel=0.02)
    assert "weighed by their errors" in run.notes[0]


def test_coherence_weighs(saved: Saved) -> None:
    coherence = np.where(OMEGA < 12, 0.3, 0.98)
    wrong = answer() * np.where(OMEGA < 12, 2, 1)
    table = columns(("omega", OMEGA), ("real", wrong.real), ("imaginary", wrong.imag), ("coherence", coherence))
    record = read(saved(table, "r.csv"), saved(PAIR, "p.toml")).record
    assert record is not None
    spectrum = np.abs(np.fft.rfft(record.channels["delta_y"]))
    f = np.fft.rfftfreq(record.t.size, record.t[1])
    inside = spectrum > 1e-3 * spectrum.max()
    assert np.median(spectrum[inside & (f < 1.8)]) < 0.3 * np.median(spectrum[inside & (f > 2.2) & (f < 4)])


@pytest.fixture(scope="module")
def flown() -> dict[str, bytes]:
    """What `tippath response -o` writes of two sweeps, by the ending."""
    truth = sysid.make_model("cd", NUMBERS)
    t = np.arange(0, 40, 0.004)
    sweep = 0.1 * np.sin(2 * np.pi * (0.3 * t + 0.1 * t**2)) * np.clip(np.minimum(t, 40 - t), 0, 1)
    runs = [sysid.simulate(name, truth, t, {name: sweep}) for name in ("delta_x", "delta_y")]
    document = response_document(flown_responses(runs, (0.4, 8.0)), [])
    return {ending: write(document) for ending, write in KINDS.items()}


@pytest.mark.parametrize("ending", KINDS)
def test_what_response_writes_is_read_and_fitted(
    saved: Saved, flown: dict[str, bytes], ending: str, tmp_path: Path
) -> None:
    path = saved(flown[ending], f"r{ending}")
    roll, pitch = ingest([path]).runs
    assert (roll.axis, pitch.axis) == ("roll", "pitch")
    assert main(["fit", str(path), "--model", "cd", "-o", str(tmp_path / "fit.json")]) == 0
    found = json.loads((tmp_path / "fit.json").read_text())
    for name, value in NUMBERS.items():
        assert found["parameters"][name]["value"] == pytest.approx(value, abs=0.03 * abs(value) + 0.15), name
    assert found["instrument"] == "excitation logged"
    assert min(found["nrmse_percent"].values()) > 97


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "motor_lag", "servo_lag", "transport_delay")], indirect=True)
def test_compare_and_diagnose_take_them(saved: Saved, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    late = columns(("omega", OMEGA), *[(name, values) for name, values in _late(0.03)])
    path, profile = saved(late, "r.csv"), saved(PAIR, "p.toml")
    fit = str(tmp_path / "fit.json")
    assert main(["fit", str(path), "--profile", str(profile), "--model", "pitch", "-o", fit]) == 0
    assert main(["compare", fit]) == 0
    capsys.readouterr()
    assert main(["diagnose", fit, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["effect"]) == ("missing", "transport_delay")
    assert found["next_maneuver"] is None
    assert main(["report", fit, "-o", str(tmp_path / "r.html")]) == 0


def test_a_lag_with_a_delay_is_hinted_at(saved: Saved) -> None:
    """The wrong way round the bare base fits as well as with either of them; the sign was all that was told."""
    omega = np.linspace(10.0, 50.0, 400)
    H = 170 * np.exp(-0.022j * omega) / ((1j * omega + 3) * (0.05j * omega + 1))
    table = columns(("omega", omega), ("real", H.real), ("imaginary", H.imag))
    run = read(saved(table, "late.csv"), saved(PAIR, "p.toml"))
    assert run.record is not None
    told = " ".join(sysid.fit_model([run.record], "pitch").warnings)
    assert "with a delay of half that" in told
    assert "refit with --with servo_lag,transport_delay" in told


def _late(by_s: float) -> list[tuple[str, np.ndarray]]:
    noise = np.random.default_rng(2)
    H = answer() * np.exp(-1j * OMEGA * by_s)
    H = H * (1 + 0.02 * (noise.standard_normal(OMEGA.size) + 1j * noise.standard_normal(OMEGA.size)))
    return [("real", H.real), ("imaginary", H.imag)]


def test_a_tail_sitter_s_response(shared_data: Path, saved: Saved) -> None:
    """k exp(-tau s) / ((s + a)(T s + 1)), T 44 to 56 ms and tau 21 to 24 ms."""
    path = shared_data / "measured" / "tailsitter_frf_ele2q_5mps.csv"
    if not path.exists():
        pytest.skip(f"NOT CHECKED: {path} is absent")
    run = read(path, saved(PAIR + b'columns = ["omega", "real", "imaginary"]\n', "p.toml"))
    assert run.record is not None
    fit = sysid.fit_model([run.record], "pitch", ["servo_lag", "transport_delay"], band_hz=run.swept_band_hz)
    assert 0.044 < fit.model["tau_s"] < 0.056
    assert 0.021 < fit.model["T_d"] < 0.024


# ------------------------------------------------------------------------------------------------ refused


@pytest.mark.parametrize(
    ("raw", "profile", "words"),
    [
        (WRITTEN["omega"], None, "nothing tells of what: name it in a profile"),
        (WRITTEN["omega"], b'[response]\ninput = "p"\noutput = "q"\n', "q per p is no output per command"),
        (columns(("omega", OMEGA), ("x", OMEGA)), PAIR, "no frequency with its response in columns omega, x"),
        (columns(("omega", OMEGA[:5]), *real(OMEGA[:5])), PAIR, "5 points of q per delta_y are known"),
        (WRITTEN["omega"][:20], PAIR, "no rows|points of q per delta_y are known|header"),
        (b"", PAIR, "empty"),
    ],
)
def test_what_is_refused(saved: Saved, raw: bytes, profile: bytes | None, words: str) -> None:
    named = None if profile is None else saved(profile, "p.toml")
    try:
        (run,) = ingest([saved(raw, "r.csv")], named).runs
        said = run.reasons[0]
    except TippathError as error:
        said = str(error)
    assert re.search(words, said)


def test_a_response_has_no_seconds_and_no_other_axis(saved: Saved, capsys: pytest.CaptureFixture[str]) -> None:
    path, profile = saved(WRITTEN["omega"], "r.csv"), saved(PAIR, "p.toml")
    with pytest.raises(TippathError, match="has no seconds to cut"):
        ingest([path], profile, (1.0, 2.0))
    asked = ["fit", str(path), "--profile", str(profile)]
    assert main([*asked, "--model", "cd"]) == 0
    assert "only pitch was excited: fitted alone" in capsys.readouterr().err
    assert main([*asked, "--model", "tpp"]) == 1
    assert "the response of p is not in it; --model pitch fits what it holds" in capsys.readouterr().err
    assert main([*asked, "--model", "pitch", "--with", "servo_backlash"]) == 1
    assert "a measured frequency response is linear" in capsys.readouterr().err


def test_a_json_that_is_none_is_refused(saved: Saved) -> None:
    for raw in (b"", b"{}", b"[1]", b'{"format": "tippath.fit/1"}', b'{"format": "tippath.response/1"}', b"\xff"):
        with pytest.raises(TippathError, match=r"not a tippath\.response/1 document"):
            ingest([saved(raw, "r.json")])


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("ending", KINDS)
def test_no_damage_is_a_traceback(saved: Saved, flown: dict[str, bytes], ending: str, count: int) -> None:
    raw = flown[ending]
    for seed in bounded_turns(count):
        chance = random.Random(seed)
        damaged = injure(raw, chance, lambda chance: raw[: chance.randrange(1, 200)], cut=True)
        told: Any = None
        try:
            told = ingest([saved(damaged, f"r{ending}")])
        except TippathError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017
        assert told is None or told.runs

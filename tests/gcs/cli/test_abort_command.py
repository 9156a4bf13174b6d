"""`tippath abort`: what it prints, before a vehicle and a session in fake time."""

from __future__ import annotations

import contextlib
import json

import pytest
from fake_flight import FakeSession, FakeVehicle

import gcs.flight.session
from gcs.cli import main

KEYS = {"format", "was_excited", "ended", "mode_before", "mode_after", "asked", "reason"}


def test_with_no_excitation_to_end_it_says_so_as_one_document(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    session = FakeSession(FakeVehicle())
    monkeypatch.setattr(gcs.flight.session.Session, "open", lambda link, **more: contextlib.nullcontext(session))
    assert main(["abort", "--connect", "udpin:127.0.0.1:1", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == KEYS
    assert (document["was_excited"], document["ended"], document["asked"]) == (False, True, 0)

"""Another distribution's `gcs`, `sysid` or `sitl` is noticed before anything is imported from it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.cli.namesakes import NamesakeError, refuse_namesakes


def test_ours_are_ours() -> None:
    refuse_namesakes()


def test_a_package_that_stands_before_ours_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sitl").mkdir()
    (tmp_path / "sitl" / "__init__.py").write_text("raise RuntimeError('imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "sitl", raising=False)
    assert main(["effects"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "sitl") in line
    assert "environment of its own" in line


def test_a_single_file_that_stands_before_ours_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitl.py").write_text("raise RuntimeError('imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "sitl", raising=False)
    with pytest.raises(NamesakeError, match=rf"^{re.escape(str(tmp_path / 'sitl.py'))} stands before"):
        refuse_namesakes()


def test_a_distribution_that_was_installed_over_ours_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.cli.namesakes._place", lambda name: tmp_path / name)
    for name, files in {"tippath-1": "gcs/__init__.py,,\n", "other-2": "other.py,,\nsysid/__init__.py,,\n"}.items():
        (tmp_path / f"{name}.dist-info").mkdir()
        (tmp_path / f"{name}.dist-info" / "RECORD").write_text(files)
    with pytest.raises(NamesakeError, match=r"^other-2 is installed over tippath's own package sysid;"):
        refuse_namesakes(tmp_path)
    (tmp_path / "other-2.dist-info" / "RECORD").write_text("other/sysid/__init__.py,,\n")
    refuse_namesakes(tmp_path)

"""What several folders of tests share: where the real logs are."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from made_once import share_what_is_made

if TYPE_CHECKING:
    from sysid.data.record import Record

share_what_is_made()
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell starts the suite in the background
os.environ["TIPPATH_CACHE"] = "off"  # tests read logs anew, and write nothing beside those they do not own
gc.disable()  # what collecting makes stays: a third of its time went into looking for garbage


def pytest_collection_finish() -> None:
    """Thousands of tests are no garbage, and are looked at no more."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)  # looking for garbage as often as usual takes a tenth of the time
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def own_cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The key of this user's cache is not touched."""
    folder = tmp_path_factory.mktemp("user")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gcs.logs.cache.user_cache_path", lambda name, **_: folder / name)
        yield


@pytest.fixture(scope="session", autouse=True)
def few_of_the_errors() -> Iterator[int]:
    """Of a fit's errors, on which gains are judged: a tenth of the usual ones, which take most of a design's time."""
    import gcs.analysis.clearance
    import gcs.analysis.rate_gains

    few = 50
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gcs.analysis.clearance, "SAMPLES", few)
        patch.setitem(gcs.analysis.clearance.clearance.__kwdefaults__, "samples", few)
        patch.setitem(gcs.analysis.rate_gains.ardupilot_gains.__kwdefaults__, "samples", few)
        yield few


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real logs; without it the test is skipped and says what was not proved."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("TIPPATH_SHARED_DATA", beside))
    if not folder.is_dir():
        pytest.skip(
            f"NO REAL LOGS: {folder} is absent, so nothing was checked against real flights; "
            "set TIPPATH_SHARED_DATA to the folder that holds ardupilot/ and crazyflie/"
        )
    return folder


EFFECTS = Path(__file__).resolve().parents[1] / "sysid" / "effects"
FEW = (
    *("angular_damping", "disc_incidence", "dynamic_inflow", "elevator", "flapping", "gyro_lag"),
    *("servo_lag", "servo_second_order", "transport_delay"),
)
"""Quick to ask, each of its own kind: rotor, body, actuator, sensor; two that cannot act without their channels."""


@contextlib.contextmanager
def catalogue_of(names: Iterable[str], folder: Path) -> Iterator[Path]:
    """Only these effects are in the catalogue; the empty folder stands in for its own."""
    import sysid.model.effect

    for name in names:
        assert (EFFECTS / f"{name}.py").exists()
        (folder / f"{name}.py").touch()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sysid.model.effect, "FOLDER", folder)
        sysid.model.effect.catalogue.cache_clear()
        yield folder
    sysid.model.effect.catalogue.cache_clear()


@pytest.fixture
def few_effects(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A catalogue of `FEW`, and of those that a test names by `parametrize(..., indirect=True)`.

    For tests of what is done with an answer: which of all effects it is, others ask. Fixtures of modules see them all.
    """
    names = (*FEW, *getattr(request, "param", ()))
    with catalogue_of(names, tmp_path_factory.mktemp("effects")) as folder:
        yield folder


@pytest.fixture
def only_effects(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A catalogue of those that a test names by `parametrize(..., indirect=True)`, and of no others."""
    with catalogue_of(request.param, tmp_path_factory.mktemp("effects")) as folder:
        yield folder


@pytest.fixture(scope="module")
def few_effects_in_module(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The same for a whole module, from where it is first asked for."""
    with catalogue_of(FEW, tmp_path_factory.mktemp("effects")) as folder:
        yield folder


@pytest.fixture(scope="module")
def fitted_stranger(request: pytest.FixtureRequest) -> list[Record]:
    """Runs to fit of the stranger that a module names by its SEED."""
    from strangers.asking import fitted_runs
    from strangers.flights import fly

    return fitted_runs(fly(request.module.SEED))


@pytest.fixture(scope="module")
def answers_kept() -> Iterator[None]:
    """In this module a question is worked out once, and a log read once; see `asked_once`."""
    from asked_once import answers_kept

    with answers_kept():
        yield


@pytest.fixture(scope="module")
def logs_kept() -> Iterator[None]:
    """In this module a log is read once; see `asked_once`."""
    from asked_once import logs_kept

    with logs_kept():
        yield


@pytest.fixture
def tippath(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """The command line in this process: words -> exit status, standard output and error; never a traceback."""
    from gcs.cli import main

    def run(*words: object) -> tuple[int, str, str]:
        try:
            status = main([str(word) for word in words])
        except SystemExit as stop:  # argparse
            status = int(stop.code or 0)
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return status, out, err

    return run

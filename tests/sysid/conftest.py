"""Runs flown by the independent simulator's physics, without its logger or link: truth that sysid did not make."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from made_once import made_once

from sitl.autopilot.control_laws import AttitudeController
from sitl.autopilot.excitation import Excitation, ExcitationSettings
from sitl.plants import Plant, make_plant
from sitl.plants.actuators import clip
from sitl.plants.sensors import Gyro
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.paper import CD, TPP

DT = 0.002


def fly(plant: Plant, settings: ExcitationSettings, seed: int, label: str) -> Record:
    """One maneuver in closed loop, a second of hover before and after."""
    gyro, controller, excitation = Gyro(seed), AttitudeController(), Excitation(settings, seed + 1)
    samples = round((settings.duration_s + 2.0) / DT)
    rows = np.empty((samples, 6))
    angle = 0.0
    for k in range(samples):
        angle += plant.omega * DT
        p, q, _ = gyro.measure(plant.p, plant.q, plant.r, angle)
        x, y = controller.step(plant.phi, plant.theta, p, q, 0.0, 0.0)
        if k * DT >= 1.0:
            added = excitation.step()
            x, y = x + added.x, y + added.y
        x, y = clip(x), clip(y)
        rows[k] = k * DT, p, q, x, y, plant.omega
        plant.step(x, y, 0.0, 0.0)
    names = ("t", "p", "q", "delta_x", "delta_y", "omega")
    band = (settings.f_start_hz, settings.f_stop_hz) if settings.kind == "chirp" else None
    return Record(
        label,
        dict(zip(names, rows.T, strict=True)),
        maneuver=settings.kind,
        axis=settings.axis,
        rate_source="SIDD",
        swept_band_hz=band,
    )


CHIRPS = (("roll", 0.10), ("pitch", 0.15), ("roll", 0.10), ("pitch", 0.15))


def chirps_of(plant: Plant, seed: int, duration_s: float = 30.0, count: int = len(CHIRPS)) -> list[Record]:
    """The first so many of a card."""
    return [
        fly(
            plant,
            ExcitationSettings(kind="chirp", law="tischler", axis=axis, magnitude=size, duration_s=duration_s),
            50 * seed + 7 * i,
            f"#{i}",
        )
        for i, (axis, size) in enumerate(CHIRPS[:count])
    ]


def _card(name: str, seed: int) -> tuple[list[Record], list[Record]]:
    """Two roll and two pitch chirps with Table 1's settings, and a doublet on each axis."""
    plant = make_plant(name, seed)
    chirps = chirps_of(plant, seed)
    doublets = [
        fly(
            plant,
            ExcitationSettings(kind="doublet", law="tischler", axis=axis, magnitude=size, duration_s=8.0, pulse_s=0.25),
            50 * seed + 31 + i,
            f"#{axis} doublet",
        )
        for i, (axis, size) in enumerate([("roll", 0.10), ("pitch", 0.15)])
    ]
    return chirps, doublets


def card(name: str, seed: int) -> tuple[list[Record], list[Record]]:
    return made_once(_card, name, seed)


@pytest.fixture(scope="session")
def fly_chirps() -> Callable[..., list[Record]]:
    """(plant's name, seed, duration in s, how many): the chirps of a card alone."""
    return lambda name, seed, duration_s, count: chirps_of(make_plant(name, seed), seed, duration_s, count)


@pytest.fixture(scope="session")
def ideal_card() -> tuple[list[Record], list[Record]]:
    return card("hover-ideal", 3)


@pytest.fixture(scope="session")
def hover_card() -> tuple[list[Record], list[Record]]:
    return card("hover", 3)


@pytest.fixture(scope="session")
def ideal_tpp(ideal_card: tuple[list[Record], list[Record]]) -> Fit:
    """Of the chirps, judged by the doublets."""
    return identify(TPP, *ideal_card)


@pytest.fixture(scope="session")
def ideal_cd(ideal_card: tuple[list[Record], list[Record]]) -> Fit:
    """Of the chirps alone."""
    return identify(CD, ideal_card[0])

"""The radio between the app and the simulated vehicle: datagrams pass both ways until somebody cuts it."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from pathlib import Path
from typing import Any

from gcs.demo.pilot import SimulatedVehicle


class Radio:
    """A simulated vehicle behind a radio that can be `cut`; for the app it is the vehicle."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        """The vehicle must listen on UDP (`udpin`)."""
        self.cut = False
        self._vehicle = vehicle
        _, host, port = vehicle.ground_link.split(":")
        self._far = (host, int(port))
        self._near: tuple[str, int] | None = None
        self._ground, self._air = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for one in (self._ground, self._air):
            one.bind(("127.0.0.1", 0))
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.ground_link = f"udpout:127.0.0.1:{self._ground.getsockname()[1]}"
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._pass, name="radio", daemon=True)
        self._thread.start()

    def _pass(self) -> None:
        while not self._ending.is_set():
            for one in select.select([self._ground, self._air], [], [], 0.05)[0]:
                data, address = one.recvfrom(2048)
                if one is self._ground:
                    self._near = address
                if self.cut or self._near is None:
                    continue
                with contextlib.suppress(OSError):
                    if one is self._ground:
                        self._air.sendto(data, self._far)
                    else:
                        self._ground.sendto(data, self._near)

    def say(self, line: str) -> str:
        return self._vehicle.say(line)

    def close(self) -> None:
        """End the vehicle, then the radio. Twice is no harm."""
        self._vehicle.close()
        self._ending.set()
        self._thread.join(2.0)
        for one in (self._ground, self._air):
            one.close()


def on_radio(plant: str, directory: Path, **how: Any) -> Radio:
    """A simulated vehicle, started, behind a radio."""
    return Radio(SimulatedVehicle(plant, directory, listen="udpin:127.0.0.1:0", **how))

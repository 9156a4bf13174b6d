"""The serial ports that this computer has: where a telemetry radio or a flight controller may be."""

from __future__ import annotations

from dataclasses import dataclass

from serial.tools import list_ports

from gcs.link.decode import sanitise

RADIO_BAUD, USB_BAUD = 57600, 115200


@dataclass(frozen=True, slots=True)
class SerialPort:
    """One port."""

    device: str
    about: str
    """What the device says it is, made harmless; empty where it says nothing."""
    baud: int
    """The usual one: of telemetry radios, or of a flight controller's own USB, which takes any."""

    @property
    def link(self) -> str:
        """The LINK word."""
        return f"{self.device},{self.baud}"


def serial_ports() -> tuple[SerialPort, ...]:
    """Those that something may be plugged into; the computer's own, which say nothing of themselves, come last."""
    found = []
    for port in list_ports.comports():
        said = "" if port.description in (None, "n/a") else sanitise(str(port.description))
        own_usb = "ACM" in port.device or "usbmodem" in port.device
        found.append(SerialPort(str(port.device), said, USB_BAUD if own_usb else RADIO_BAUD))
    return tuple(sorted(found, key=lambda one: (not one.about, one.device)))

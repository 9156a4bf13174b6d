"""Textual's web driver, which can also be asked to paint everything: for a viewer who comes later."""

from __future__ import annotations

from textual.drivers.web_driver import WebDriver


class ViewedWebDriver(WebDriver):
    """The server's packets of kind `repaint` paint the whole screen again."""

    def on_meta(self, packet_type: str, payload: dict[str, object]) -> None:
        """Called in the thread that reads what the server sends."""
        if packet_type == "repaint":
            self._app.call_later(self._app.refresh)
        else:
            super().on_meta(packet_type, payload)

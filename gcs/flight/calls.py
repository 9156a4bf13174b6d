"""A procedure under way on a session, and whoever waits for it."""

from __future__ import annotations

import threading
from typing import Any

from gcs.link.procedures import Procedure


class Call:
    """Over once `ended` is set."""

    def __init__(self, procedure: Procedure[Any]) -> None:
        self.procedure = procedure
        self.ended = threading.Event()
        self.crash: BaseException | None = None
        """A fault in the procedure, which is its caller's matter."""

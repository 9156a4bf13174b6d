"""What the mathematics refuses to answer: every message says what is wrong and what to do."""

from __future__ import annotations


class SysidError(ValueError):
    """The data do not allow the answer, or a file is not what it should be."""


class FitError(SysidError):
    """The data cannot identify the structure; the message names the axis and what to do."""


class NotShownError(FitError):
    """Parameters that do nothing where a fit ended, of which there is then no derivative."""

    def __init__(self, names: tuple[str, ...]) -> None:
        super().__init__(
            f"the data do not determine the model: {', '.join(names)} does not show in the response on these runs"
        )
        self.names = names

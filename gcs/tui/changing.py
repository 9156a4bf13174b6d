"""Changes of screen that are seen at once: every screen is made before it is asked for, while nothing else is done."""

from __future__ import annotations

import gc
from collections.abc import Sequence

from textual.app import App
from textual.screen import Screen

BEGIN_S, EVERY_S = 2.0, 0.25
"""After the app's start, and between two screens: each takes about 50 ms."""
SETTLES_S = 0.005
"""Until a screen that was changed to is drawn. Textual waits for 50 ms, by when a screen that is new has settled."""


class ChangingApp(App[None]):
    """An app whose screens are modes."""

    def delay_update(self, delay: float = SETTLES_S) -> None:
        super().delay_update(min(delay, SETTLES_S))

    def make_screens(self, modes: Sequence[str]) -> None:
        """Make the screens of these modes from now on, one by one."""
        self._unmade = [*modes]
        self.set_timer(BEGIN_S, lambda: self._make_one())

    def may_make_screens(self) -> bool:
        """Whether there is time for it now."""
        return len(self.screen_stack) == 1

    def show_on(self, screen: Screen[object]) -> None:
        """Show this moment on a screen."""

    async def _make_one(self) -> None:
        """Beside the one that is seen: Textual's own way there would change to it and back, with the keys."""
        if self._unmade and self.is_running and self.may_make_screens():
            mode = self._unmade.pop(0)
            await self._init_mode(mode)
            if self.is_running:
                made = self._screen_stacks[mode][0]
                made._css_update_count = self._css_update_count  # mounting it has just styled it
                self.show_on(made)
                made._screen_resized(self.size)
        if not self.is_running:  # its screens are being closed
            return
        if self._unmade:
            self.set_timer(EVERY_S, lambda: self._make_one())
        else:  # what stays is not looked through again: that takes 100 ms, in the middle of anything
            gc.collect()
            gc.freeze()

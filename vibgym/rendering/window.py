"""A window on the screen for ``render_mode="human"``."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym.rendering.view import SurfacePainter, require_pygame


class Window:
    """Shows frames of a painter's size at a steady rate.

    pygame has one display per process, so one window can be open at a time. After the user has closed it, further frames are
    dropped. Copies and pickles open a separate window.

    Args:
        painter: its width and height become the window's.
        fps: frames per second that :meth:`show` keeps to.
        title: of the window.
    """

    def __init__(self, painter: SurfacePainter, fps: float, title: str = "vibgym") -> None:
        self._pygame = require_pygame()
        self._painter, self._fps, self._title = painter, fps, title
        self._clock: Any = None
        self._open = self._closed = False

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without pygame's module and clock; a copy opens its window on the first frame."""
        return {**vars(self), "_pygame": None, "_clock": None, "_open": False}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _pygame=require_pygame())

    @property
    def is_open(self) -> bool:
        """Whether the window is on the screen."""
        return self._open

    def show(self, frame: np.ndarray) -> None:
        """Show ``frame`` (H, W, 3) uint8 and wait until the next one is due; the first call opens the window."""
        if self._closed:
            return
        display, size = self._pygame.display, (self._painter.width, self._painter.height)
        if not self._open:
            display.init()
            display.set_mode(size)
            display.set_caption(self._title)
            self._clock = self._pygame.time.Clock()
            self._open = True
        # Without event handling, the window manager reports the program as hanging.
        if not display.get_init() or any(e.type == self._pygame.QUIT for e in self._pygame.event.get()):
            self.close()
            return
        picture = self._pygame.image.frombuffer(np.ascontiguousarray(frame), size, "RGB")
        display.get_surface().blit(picture, (0, 0))
        display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window permanently; further calls have no effect."""
        if self._open and self._pygame.display.get_init():
            self._pygame.display.quit()
        self._open, self._closed = False, True

"""The one place that imports pygame."""

from __future__ import annotations

import os
from types import ModuleType


def require_pygame() -> ModuleType:
    """Import pygame without its greeting.

    Raises:
        ImportError: pygame is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
    except ImportError as error:
        raise ImportError("drawing needs pygame: pip install vibgym[render]") from error
    return pygame

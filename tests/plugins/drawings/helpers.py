"""Helpers for tests of drawings."""

from vibgym.plugins.drawings import reading
from vibgym.scene.part_settings import DrawingSettings
from vibgym.settings import read as settings_from


def read(path, surface=None, **given):
    """Return the drawing in a file, which is read with settings."""
    return reading.read(settings_from(DrawingSettings, {"file": str(path), **given}, ""), surface)


def saved(document, path):
    """Save a document of ezdxf, and return the path."""
    document.saveas(path)
    return path

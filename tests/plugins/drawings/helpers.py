"""Helpers for tests of drawings."""

from vibgym.plugins.drawings import reading
from vibgym.scene.part_settings import DrawingSettings
from vibgym.settings import read as settings_from


def read(path, surface=None, **settings):
    """Return the drawing in a file, which is read with settings."""
    return reading.read(settings_from(DrawingSettings, {"file": str(path), **settings}, ""), surface)


def page(path, inner, size='width="100mm" height="80mm" viewBox="0 0 100 80"'):
    """Save elements in line 2 of an SVG file, and return the path."""
    space = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    path.write_text(
        f'<svg {space} xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" {size}>\n{inner}\n</svg>'
    )
    return path


def saved(document, path):
    """Save a document of ezdxf, and return the path."""
    document.saveas(path)
    return path

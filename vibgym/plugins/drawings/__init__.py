"""Parts from drawings: DXF, SVG and STL files; the command ``python -m vibgym part``."""

from vibgym.plugins.drawings.reading import read_part

__all__ = ["read_part"]

"""Parts from drawings: DXF, SVG and STL files."""

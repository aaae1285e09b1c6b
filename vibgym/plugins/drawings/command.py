"""``python -m vibgym part FILE``: describe and draw the part in a drawing."""

from __future__ import annotations

import argparse
import io
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from vibgym import checks
from vibgym.config import from_text
from vibgym.files import write_atomically
from vibgym.scene import outlines
from vibgym.scene.part_settings import DrawingSettings
from vibgym.scene.parts import Part, drawn_part, part_from
from vibgym.scene.surface import Surface, surface_from
from vibgym.settings import read, with_unit

PIXELS = 6000.0
"""Pixels per metre of the picture."""

FAULTS, MARK = 1000.0, 0.015
"""Pixels of a side of a picture of faults, and half the side of a mark as a share of it."""

MIN_PIECE = 0.02
"""Share of the part's area of convex pieces whose borders the picture shows."""


def part(parser: argparse.ArgumentParser) -> Callable[[argparse.Namespace], int]:
    """Describe the part in a DXF, SVG or STL file, and the tasks and policies that accept it (extra 'cad')."""
    parser.add_argument("file", metavar="FILE", help="a .dxf, .svg or .stl file")
    parser.add_argument("--friction", type=float, default=0.5, help="coefficient of sliding friction (0.5)")
    parser.add_argument("--thickness-mm", type=float, help="of a drawing (10)")
    parser.add_argument("--density", type=float, help="kg/m^3 (7850, steel)")
    parser.add_argument("--tolerance-mm", type=float, default=0.05, help="of flattened curves (0.05)")
    parser.add_argument("--units", help="of a file that names none or wrong ones, such as mm or in")
    parser.add_argument("--scale", type=float, help="of a drawing, factor of all lengths (1)")
    parser.add_argument("--layer", action="append", help="to read, others are not; may be repeated")
    parser.add_argument(
        "--without-layer", dest="without_layers", action="append", default=[], help="not to read; may be repeated"
    )
    parser.add_argument("--part", type=int, metavar="N", help="among several in a drawing, 0 for the largest")
    parser.add_argument(
        "--gap-mm", type=float, help="largest gap between lines that is closed (a tenth of the tolerance)"
    )
    parser.add_argument("--stable-pose", type=int, help="of an STL file, 0 for the most probable one")
    parser.add_argument(
        "--surface", default="prototype", help="a YAML file such as machine.yaml, or a JSON mapping (the prototype)"
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="PNG",
        help="draw the part on the table, or the drawing's faults (extra 'render')",
    )
    parser.add_argument("--no-tasks", action="store_true", help="do not try tasks and policies")
    return run


def run(arguments: argparse.Namespace) -> int:
    """Print the description; returns the exit code."""
    if arguments.picture is not None and arguments.picture.suffix.lower() != ".png":
        raise checks.refuse("--picture", str(arguments.picture), "a .png file")
    surface = from_text("--surface", arguments.surface)
    surface = surface_from(surface.get("surface", surface) if isinstance(surface, Mapping) else surface)
    keys = {*DrawingSettings.model_fields, *with_unit(DrawingSettings)}
    values = {name: value for name, value in vars(arguments).items() if name in keys and value is not None}
    settings = read(DrawingSettings, values, "")
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        try:
            made, poses = drawn_part(settings, surface)
        except checks.Refused as error:
            for k, fault in enumerate(error.faults):
                print(f"fault {k}: {fault.text}")
            if error.lines and arguments.picture is not None:
                picture_of_faults(error, arguments.picture)
                print(f"picture: {arguments.picture}")
            raise
    for note in notes:
        print(f"warning: {note.message}")
    pose = centred(surface)
    for line in description(made, surface, pose):
        print(line)
    for k, rest in enumerate(poses):
        print(f"stable pose {k}: {100 * rest.probability:.1f} %, {rest.height:.4g} mm high, on {rest.area:.4g} mm^2")
    if arguments.picture is not None:
        picture(made, surface, pose, arguments.picture)
        print(f"picture: {arguments.picture}")
    if not arguments.no_tasks:
        from vibgym.policies.applicable import tasks_with, usual_parts

        larger = []
        for name, policies in tasks_with(made.to_dict(), asdict(surface)).items():
            print(f"{name}: {policies if isinstance(policies, str) else ', '.join(policies)}")
            trained_on = min((part_from(mapping).radius for mapping in usual_parts(f"vibgym/{name}-v0")), default=0.0)
            if "learned" in policies and made.radius < trained_on:
                larger.append(f"{name} ({1e3 * trained_on:.3g} mm)")
        if larger:
            tasks = ", ".join(larger)
            print(
                f"'learned' was trained on parts of larger radius than {1e3 * made.radius:.3g} mm: evaluate it first: {tasks}"
            )
    return 0


def centred(surface: Surface) -> np.ndarray:
    """Return the pose (3,) in the middle of the element nearest to the middle of a surface."""
    middle = np.array([surface.columns // 2, surface.rows // 2]) + 0.5
    return np.array([*(surface.element_size * middle), 0.0])


def description(part: Part, surface: Surface, pose: np.ndarray) -> list[str]:
    """Return lines about a part, and about the elements under it at a pose (3,)."""
    from vibgym.scene.hulls import convex_pieces

    size, holes = 1e3 * np.ptp(part.rim, axis=0), len(part.holes)
    shape = (
        f"disc of {2e3 * math.sqrt(part.area / math.pi):.4g} mm"
        if part.symmetry == 0
        else f"{size[0]:.4g} x {size[1]:.4g} mm"
    )
    around = f"{len(part.rim)} corners, {holes} holes, {len(convex_pieces(part))} convex pieces"
    turn = 360.0 / max(part.symmetry, 1)
    symmetry = {0: "any angle", 1: "none"}.get(part.symmetry, f"{turn:.4g} degrees")
    rows, columns, share = elements_under(part, surface, pose)
    low = 1e3 * (part.rim.min(axis=0))
    lines = [
        f"{part.name}: {shape}, {1e3 * part.height:.4g} mm high, {around}",
        f"area {1e6 * part.area:.6g} mm^2, mass {1e3 * part.mass:.4g} g, "
        f"radius of gyration {1e3 * math.sqrt(part.gyration):.4g} mm",
        f"centre of mass {-low[0]:.4g} and {-low[1]:.4g} mm from the left and lower edge, "
        f"{1e3 * part.centre_height:.4g} mm above the table",
        f"symmetry: {symmetry}; tips by friction from a ratio of 1 on: {part.tipping_ratio:.2f}",
        f"elements beneath, in the middle of one: {len(share)}, in rows {rows.min()} to {rows.max()} and columns "
        f"{columns.min()} to {columns.max()}; the most loaded one carries {100 * share.max():.0f} %",
    ]
    if size.max() < 1e3 * surface.element_size:
        lines.append(f"smaller than an element of {1e3 * surface.element_size:.4g} mm")
    return lines


def elements_under(part: Part, surface: Surface, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and shares of the contact area of the elements under a part at a pose (3,)."""
    from vibgym.allocation.cut import cut_parts, new_pieces, outlines_of

    pieces = new_pieces(surface, (part,))
    count = cut_parts(outlines_of(surface, (part,)), 0, pose[None], np.ones(1, dtype=bool), pieces)
    rows, columns = np.divmod(pieces.element[:count], surface.columns)
    return rows, columns, pieces.share[:count].copy()


def picture(part: Part, surface: Surface, pose: np.ndarray, path: Path) -> None:
    """Draw outline, borders of convex pieces, centre of mass, and the elements beneath with their shares of the load.

    Raises:
        ValueError: the file cannot be written.
        ImportError: the extra ``render`` is not installed.
    """
    from vibgym.rendering.view import require_pygame
    from vibgym.scene.hulls import convex_pieces

    require_pygame()
    from vibgym.rendering import colours
    from vibgym.rendering.canvas import Canvas

    rows, columns, share = elements_under(part, surface, pose)
    first = np.array([columns.min() - 1, rows.min() - 1])
    count = np.array([columns.max(), rows.max()]) + 2 - first
    size = surface.element_size
    canvas = Canvas(int(count[1]), int(count[0]), size, PIXELS)
    canvas.begin(np.zeros((count[1], count[0], 2)))
    low = size * (np.column_stack([columns, rows]) - first)
    for corner in low:
        canvas.zone(corner, corner + size, colours.PARTS[1], "")
    here = pose - [*(size * first), 0.0]
    canvas.part(here, part.outline, colours.PARTS[0], ahead=False)
    for piece in convex_pieces(part):
        if outlines.signed_area(piece) >= MIN_PIECE * part.area:  # a rounded inner corner consists of slivers
            canvas.path(here[:2] + piece[[*range(len(piece)), 0]], colours.PAPER)
    canvas.goal(here[:2], part.outline, None)
    for corner, loaded in zip(low, share, strict=True):
        canvas.tag(corner, corner + size, colours.PARTS[1], f"{100 * loaded:.0f} %")
    pixels = canvas.finish(f"{part.name}: {1e6 * part.area:.4g} mm², {1e3 * part.mass:.3g} g")
    _write(pixels, path)


def picture_of_faults(error: checks.Refused, path: Path) -> None:
    """Draw what could be read of a drawing, with a numbered square at each fault whose place is known.

    Raises: as :func:`picture`.
    """
    from vibgym.rendering.view import require_pygame

    require_pygame()
    from vibgym.rendering import colours
    from vibgym.rendering.canvas import Canvas

    places = {k: 1e-3 * fault.place for k, fault in enumerate(error.faults) if fault.place is not None}
    lines = [1e-3 * line for line in error.lines]
    points = np.concatenate([*lines, *(place[None] for place in places.values())])
    size = 1.1 * float(np.ptp(points, axis=0).max())
    low = points.min(axis=0) - 0.05 * size
    canvas = Canvas(1, 1, size, FAULTS / size)
    canvas.begin(np.zeros((1, 1, 2)))
    for line in lines:
        canvas.path(line - low, colours.INK)
    for k, place in places.items():
        canvas.zone(place - low - MARK * size, place - low + MARK * size, colours.PARTS[1], str(k))
    _write(canvas.finish(f"faults: {len(error.faults)}"), path)


def _write(pixels: np.ndarray, path: Path) -> None:
    """Write a picture (height, width, 3) as PNG."""
    import pygame

    stream = io.BytesIO()
    pygame.image.save(pygame.image.frombuffer(pixels.tobytes(), pixels.shape[1::-1], "RGB"), stream, "x.png")
    write_atomically(path, stream.getvalue())

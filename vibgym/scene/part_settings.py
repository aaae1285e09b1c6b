"""Settings of parts: properties, shapes, and how a drawing is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le
from pydantic import Field, model_validator

from vibgym import checks
from vibgym.scene.outlines import MAX_PLACE, MIN_SIZE
from vibgym.settings import BaseSettings, Length, Mass

MIN_MASS, MAX_MASS = 1e-9, 1e9
"""kg."""

MIN_DENSITY, MAX_DENSITY = 5.0, 50e3
"""kg/m^3, range of plausible densities, from foam to twice osmium; others give a warning."""

HEIGHT = 0.010
"""m, of parts that are given without a height."""

Size = Annotated[Length, Ge(MIN_SIZE), Le(MAX_PLACE)]

Corners = tuple[tuple[Length, Length], ...]


class PartSettings(BaseSettings):
    """Properties of a part, except its outline."""

    friction: float = Field(ge=0.0)
    """Coefficient of sliding friction between part and surface."""

    static_friction: float | None = None
    """Coefficient of static friction, at least that of sliding friction at rest, which is the default."""

    friction_law: Mapping[str, Any] | None = None
    """``kind`` and settings of a law (:mod:`vibgym.scene.friction_laws`), which varies friction with slip speed."""

    height: Length = Field(default=HEIGHT, gt=0.0, le=MAX_PLACE)
    """Height."""

    centre_height: Length | None = Field(default=None, ge=0.0)
    """Height of the centre of mass, at most the part's height; by default half of it."""

    mass: Mass | None = Field(default=None, ge=MIN_MASS, le=MAX_MASS)
    """Mass; by default of steel."""

    name: str | None = None
    """Name; by default that of the shape, or of the file of a drawing."""

    restitution: float = Field(default=0.2, ge=0.0, le=1.0)
    """Coefficient of restitution of contacts with other parts and walls."""

    contact_friction: float = Field(default=0.3, ge=0.0)
    """Coefficient of friction of contacts with other parts and walls."""

    coupling: float = Field(default=1.0, ge=0.0, le=1.0)
    """Share of the elements' vertical motion that reaches the part."""


class RectangleSettings(PartSettings):
    """Settings of a block."""

    shape: Literal["rectangle"] = "rectangle"
    """Name of the shape."""

    length: Size
    """Size along the part's own x."""

    width: Size
    """Size along the part's own y."""


class DiscSettings(PartSettings):
    """Settings of a disc."""

    shape: Literal["disc"] = "disc"
    """Name of the shape."""

    radius: Size
    """Radius."""


class PolygonSettings(PartSettings):
    """Settings of a part with a simple polygonal outline."""

    shape: Literal["polygon"] = "polygon"
    """Name of the shape."""

    vertices: Corners
    """Corners of the outline, about any origin and in either sense."""

    holes: tuple[Corners, ...] = ()
    """Corners of simple polygons inside the outline, with the same origin."""


SHAPES: dict[str, type[PartSettings]] = {
    "rectangle": RectangleSettings, "disc": DiscSettings, "polygon": PolygonSettings,
}  # fmt: skip
"""Settings by shape."""


class DrawingSettings(PartSettings):
    """Settings of a part in a DXF, SVG or STL file; a mesh has its own height and centre height."""

    file: str
    """Path of the ``.dxf``, ``.svg`` or ``.stl`` file."""

    friction: float = Field(default=0.5, ge=0.0)
    """Coefficient of sliding friction between part and surface."""

    thickness: Length | None = Field(default=None, gt=0.0)
    """Height of the part in a drawing, another name for ``height``."""

    density: float | None = Field(default=None, ge=MIN_DENSITY, le=MAX_DENSITY)
    """Density, kg/m^3, instead of the mass; by default that of steel."""

    tolerance: Length = Field(default=5e-5, ge=1e-7)
    """Largest distance of flattened curves from the drawn ones; flattening preserves area."""

    units: str | None = None
    """``"mm"``, ``"in"``, ... (docs/drawings.md), if the file names none, or wrong ones; STL files are in mm by default."""

    scale: float | None = Field(default=None, gt=0.0)
    """Factor of all lengths of a drawing."""

    layer: str | tuple[str, ...] | None = None
    """One layer or several whose content alone is read; in SVG files ids, group labels or stroke colours."""

    without_layers: str | tuple[str, ...] = ()
    """Layers whose content is not read."""

    part: int | None = Field(default=None, ge=0)
    """Number among several parts in a drawing, 0 for the largest; without it, several are an error that lists them."""

    gap: Length | None = Field(default=None, ge=0.0)
    """Largest gap between ends of lines that is closed, with a warning; by default a tenth of the tolerance."""

    stable_pose: int | None = Field(default=None, ge=0)
    """Pose of a mesh, 0 for the most probable one; None: as modelled."""

    @model_validator(mode="after")
    def _stated_once(self) -> DrawingSettings:
        if self.density is not None and self.mass is not None:
            raise checks.conflict("density and mass exclude one another")
        if self.thickness is not None and "height" in self.model_fields_set:
            raise checks.conflict("thickness and height exclude one another")
        return self

"""The thesis's figures beside ours, by name; each gives pictures, a table and what is to be said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from agents.replicate import camera_chain, quantisation_figure, velocity_figure
from vibgym.registry import Registry


@dataclass(frozen=True)
class Repeated:
    """A figure of the thesis, repeated.

    Attributes:
        title: with the number of the figure.
        text: what the thesis shows, what is shown here, and what is not known.
        pictures: PNG files with a caption each.
        columns, rows: of a table; may be empty.
    """

    title: str
    text: str
    pictures: list[tuple[bytes, str]]
    columns: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)


def _quantisation() -> Repeated:
    picture, columns, rows = quantisation_figure.draw()
    return Repeated(
        "Fig. 5.8: error of the centroid of a disc",
        "The thesis drew discs of 2 to 40 px at 10 000 random places each and found a mean of about zero and a standard "
        "deviation that falls with the diameter; the curve itself is lost. It does not say when a pixel belongs to a disc: "
        "both readings are shown, by the pixel's centre and by half of its area. Grey levels along the edge, which the "
        "prototype did not use, err by less than a tenth of that.",
        [(picture, "Standard deviation and mean of both coordinates, 10 000 places for each diameter.")],
        columns,
        rows,
    )


def _chain() -> Repeated:
    pictures = camera_chain.draw()
    return Repeated(
        "Figs. 5.5 to 5.9: from the image to poses",
        "Eleven parts, as in the thesis's fig. 5.5, through the chain of its section 5.1: a fixed threshold within the area of "
        "interest, runs, boundaries, centroids and principal axes, and the way to the surface by a template. The camera is the "
        "prototype's, with all lines, 1 % distortion, noise, blur and uneven light; where the thesis's parts lay is not known.",
        pictures,
    )


def _velocity() -> Repeated:
    picture, columns, rows = velocity_figure.draw()
    return Repeated(
        "Fig. 7.3: velocity in a uniform field against amplitude",
        "On the prototype a part went as fast as the model says where the amplitude was above 0.1 mm (up to 0.3 m/s near "
        "0.4 mm), and slower or not at all below, for such amplitudes were not realised. What they became instead is not "
        "known: shown are the three forms that the actuators here can have. The part is the aluminium block with its sliding "
        "friction of 0.58; the measured points themselves are lost.",
        [(picture, "Mean velocity once it is steady, from the planar model behind the actuators.")],
        columns,
        rows,
    )


FIGURES: Registry[Callable[[], Repeated]] = Registry(
    "figure", {"centroid_error": _quantisation, "camera_chain": _chain, "velocity": _velocity}
)
"""Figures by name, in the page's order."""

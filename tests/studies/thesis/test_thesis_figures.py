"""Figures of the thesis from sensor and drive, and the page."""

import numpy as np
import pytest
from markupsafe import escape

from studies.thesis import (
    centroid_error,
    cylinder,
    cylinder_figure,
    element_size,
    figures,
    speed_ratio,
    squeeze,
)
from studies.thesis.__main__ import main
from studies.thesis.centroid_error import centre_errors, chain_errors
from studies.thesis.element_size import PITCH
from studies.thesis.figures import FIGURES
from studies.thesis.velocity import steady_velocity
from vibgym import Part, Surface
from vibgym.registry import Registry

WITHOUT_LOOPS = (
    "transient", "steady_velocity", "speed_ratio", "centroid_error", "parameter_study", "element_size", "friction_radius",
    "squeeze", "cylinder",
)  # fmt: skip


@pytest.mark.parametrize("diameter, most", [(2, 0.17), (10, 0.08), (40, 0.035)])
def test_the_error_of_a_discs_centroid(diameter, most):
    """Fig. 5.8: no bias, and a bounded standard deviation for both definitions of a disc's pixels."""
    for errors in (centre_errors(diameter, 10_000), chain_errors(diameter, 10_000)):
        assert 0.7 * most < errors.std() < most
        assert abs(errors.mean(axis=0)).max() < 5.0 * errors.std() / 100.0
    assert chain_errors(diameter, 1000, grey=True).std() < 0.1 * most


def test_velocity_against_amplitude():
    """Fig. 7.3: 0.305 m/s at lift-off, zero within a hard dead zone, and beyond it as without dead zone."""
    part = Part.rectangle(0.05, 0.035, friction=0.6)
    amplitude = [0.0, 0.05e-3, 0.099e-3, 0.11e-3, 0.2e-3, Surface().lift_off_amplitude]
    bare, hard, soft = (
        steady_velocity(part, amplitude, dead_zone=width, form=form)
        for width, form in ((0.0, "hard"), (1e-4, "hard"), (1e-4, "soft"))
    )
    assert bare[-1] == pytest.approx(0.30438, rel=2e-3) and (np.diff(bare) > 0).all()
    assert hard[:3] == pytest.approx(0.0, abs=1e-5) and hard[3:] == pytest.approx(bare[3:], rel=1e-9)
    assert 0.0 < soft[1] < bare[1] and soft[1] == pytest.approx(steady_velocity(part, [0.025e-3])[0], rel=1e-6)


def test_the_page(tmp_path, capsys):
    assert main(["--output", str(tmp_path), "--figure", "camera_chain"]) == 0
    page = (tmp_path / "replicate.html").read_text()
    assert page.count("data:image/png;base64,") == 5 and "Figs. 5.5 to 5.9" in page and "Fig. 5.8" not in page
    assert "http" not in page  # no external resources
    assert "python -m studies.thesis --figure camera_chain" in page
    assert "11 of 11" in page and "Assumptions" in page
    assert str(tmp_path) in capsys.readouterr().out


def test_figures_agree_with_the_thesis_and_are_on_the_page(tmp_path, monkeypatch):
    """With few trials: each has its command, its pictures and no comparison that contradicts the thesis."""
    for module, name, fewer in (
        (centroid_error, "TRIALS", 300), (centroid_error, "GREY_TRIALS", 50), (element_size, "STARTS", 10),
        (element_size, "SIZES", (PITCH / 2, PITCH)), (squeeze, "STARTS", 24), (squeeze, "OTHERS", 8),
        (speed_ratio, "POINTS", 20), (cylinder_figure, "TALL", (0.020,)), (cylinder_figure, "FLAT", (0.025,)),
        (cylinder, "DIRECTIONS", 2),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, fewer)
    drawn = {name: FIGURES[name]() for name in WITHOUT_LOOPS}
    for figure in drawn.values():
        assert all(len(row) == len(table.columns) for table in figure.tables for row in table.rows)
        assert all(picture.png.startswith(b"\x89PNG") for picture in figure.pictures)
        for line in figure.comparisons:
            assert not line.difference.endswith((" above", " below", "differs", "does not fall", "does not grow"))
    monkeypatch.setattr(figures, "FIGURES", Registry("figure", {name: lambda it=it: it for name, it in drawn.items()}))
    text = figures.write(tmp_path).read_text()
    for name, figure in drawn.items():
        assert f"--figure {name}<" in text and f'href="#{name}"' in text
        assert text.count(str(escape(figure.differs))) == 2
    assert text.count("<img") == sum(len(figure.pictures) for figure in drawn.values())


def test_an_unknown_figure_is_refused(tmp_path, capsys):
    assert main(["--output", str(tmp_path), "--figure", "nine"]) == 2
    refusal = capsys.readouterr().err
    assert "figure" in refusal and all(name in refusal for name in FIGURES)
    assert not list(tmp_path.iterdir())

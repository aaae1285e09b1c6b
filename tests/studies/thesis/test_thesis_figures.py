"""Figures of the thesis: their text, their pages, and those without a controller."""

import io

import numpy as np
import pytest
from markupsafe import escape
from PIL import Image

from studies.thesis import centroid_error, cylinder, element_size, figures, speed_ratio, squeeze
from studies.thesis.__main__ import main
from studies.thesis.centroid_error import centre_errors, chain_errors
from studies.thesis.element_size import ALIGNED, PITCH, aligned
from studies.thesis.figure import Comparison, Figure, Picture, Table, of_number, of_range
from studies.thesis.figures import FIGURES
from studies.thesis.squeeze import largest_deviations, objects, squeezed
from studies.thesis.velocity import steady_velocity
from vibgym import Part, Surface
from vibgym.registry import Registry
from vibgym.scene.parts import shipped_part

WITHOUT_LOOPS = (
    "transient", "steady_velocity", "speed_ratio", "centroid_error", "camera_chain", "parameter_study", "element_size",
    "friction_radius", "velocity", "squeeze", "cylinder",
)  # fmt: skip


@pytest.mark.parametrize("line, thesis, difference", [
    (of_number("speed", 0.30, 0.33, "m/s", 2), "0.30 m/s", "+0.03 m/s (+10.0 %)"),
    (of_number("bias", 0.0, -0.5, "px", 1), "0.0 px", "-0.5 px"),
    (of_range("lambda", 0.70, 0.72, 0.71, digits=2), "0.70 to 0.72", "within"),
    (of_range("lambda", 0.70, 0.72, 0.69, digits=2), "0.70 to 0.72", "0.01 below"),
    (of_range("lambda", None, 5.0, 5.25, digits=2), "at most 5.00", "0.25 above"),
    (of_range("lambda", 0.7, None, 0.9, digits=2), "at least 0.70", "within"),
])  # fmt: skip
def test_differences_to_numbers_and_ranges(line, thesis, difference):
    assert (line.thesis, line.difference) == (thesis, difference)


def test_figures_agree_with_the_thesis_and_are_on_the_page(tmp_path, monkeypatch):
    """With few trials: each has its command, its pictures and no comparison that contradicts the thesis."""
    for module, name, fewer in (
        (centroid_error, "TRIALS", 300), (centroid_error, "GREY_TRIALS", 50), (element_size, "STARTS", 10),
        (element_size, "SIZES", (PITCH / 2, PITCH)), (squeeze, "STARTS", 24), (squeeze, "OTHERS", 8),
        (speed_ratio, "POINTS", 20), (cylinder, "TALL", (0.020,)), (cylinder, "FLAT", (0.025,)),
        (cylinder, "DIRECTIONS", 2),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, fewer)
    drawn = {name: FIGURES[name]() for name in WITHOUT_LOOPS}
    for figure in drawn.values():
        assert all(picture.png.startswith(b"\x89PNG") for picture in figure.pictures)
        for line in figure.comparisons:
            assert not line.difference.endswith((" above", " below", "differs", "does not fall", "does not grow"))
    assert any(line.ours == "11 of 11" for line in drawn["camera_chain"].comparisons)
    monkeypatch.setattr(figures, "FIGURES", Registry("figure", {name: lambda it=it: it for name, it in drawn.items()}))
    assert main(["--output", str(tmp_path)]) == 0
    text = (tmp_path / "replicate.html").read_text()
    for name, figure in drawn.items():
        assert f"--figure {name}<" in text and f'href="#{name}"' in text
        assert text.count(str(escape(figure.differs))) == 2
    assert text.count("<img") == sum(len(figure.pictures) for figure in drawn.values())
    assert "http" not in text  # no external resources


def test_an_unknown_figure_is_refused(tmp_path, capsys):
    assert main(["--output", str(tmp_path), "--figure", "nine"]) == 2
    refusal = capsys.readouterr().err
    assert "figure" in refusal and all(name in refusal for name in FIGURES)
    assert not list(tmp_path.iterdir())


def test_a_figure_becomes_a_section_of_the_documentation():
    file = io.BytesIO()
    Image.new("RGB", (1800, 600), "white").save(file, format="PNG")
    comparisons, pictures = (Comparison("speed", "1 m/s", "2 m/s", "+1 m/s"),), (Picture(file.getvalue(), "A line."),)
    tables = (Table("More.", ("x",), (("1",),)),)
    figure = Figure("Fig. 1: a | b", "It shows *this*.", comparisons, "Twice.", ("nothing",), pictures, tables)
    text = figures.section("mine", figure, ["mine-1.png"])
    assert "## Fig. 1: a | b" in text and r"\*this\*" in text and "(thesis/mine-1.png)" in text
    assert "| speed | 1 m/s | 2 m/s | +1 m/s |" in text
    with Image.open(io.BytesIO(figures.small(file.getvalue()))) as picture:
        assert picture.size == (900, 300)


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


def test_a_squeeze_field_aligns_a_block_but_not_a_triangle():
    """Figs. 7.4 and 7.5: the thesis's bounds, and ideal elements leave no scatter at all."""
    for hardware in ("ideal", "prototype"):
        run = squeezed(shipped_part("aluminium_block"), hardware, worlds=60)
        offset, turn = largest_deviations(run)
        assert offset < 5.0 and turn < 22.5 and run.stable > 0.9
        assert 20.0 < 1e3 * run.offset[0].std() < 35.0  # 96 mm, evenly: 27.7 mm
        assert np.degrees(run.heading[0].std()) == pytest.approx(180.0 / 12.0**0.5, abs=8.0)
        if hardware == "ideal":
            assert 1e3 * run.offset[-1].std() < 1e-2 and np.degrees(run.heading[-1].std()) < 0.01 and run.stable == 1.0
        else:
            assert turn > 2.0  # its elements differ
    run = squeezed(objects()["triangle, 50 mm"], "ideal", worlds=20)
    assert run.symmetry == 3 and run.resting == 0.0 and largest_deviations(run)[0] < 5.0


def test_headings_are_modulo_the_symmetry_and_stable_within_bounds():
    """Parts on the squeeze line, by pairs of initial heading (deg) and rate (deg/s)."""

    def run(*headings):
        time = np.linspace(0.0, 10.0, 251)
        pose = np.zeros((251, len(headings), 3))
        pose[..., 1] = squeeze.LINE
        pose[..., 2] = np.radians([[start + rate * t for start, rate in headings] for t in time])
        return squeeze.Squeezed(time, pose, 2)

    turned = run((10.0, 0.0), (190.0, 0.0), (-170.0, 0.0), (14.0, 0.0))
    assert np.degrees(turned.heading[-1]) == pytest.approx([-1.0, -1.0, -1.0, 3.0], abs=0.01)
    assert turned.resting == turned.stable == 1.0
    some = run(*[(0.0, 0.0)] * 6, (0.0, 8.0), (60.0, 0.0))  # 8 deg/s are 12 deg in 1.5 s
    assert (some.resting, some.stable) == (7 / 8, 6 / 8)


@pytest.mark.parametrize("name", ["aluminium_block", "steel_block"])
def test_four_elements_attract_a_block_and_fewer_do_not(name):
    """Fig. 6.2: elements of half the pitch align all blocks, larger ones none to speak of."""
    for elements, least, most in ((4, 1.0, 1.0), (2, 1.0, 1.0), (1.5, 0.0, 0.1), (1, 0.0, 0.1)):
        distance, _ = aligned(shipped_part(name), PITCH / elements, starts=20)
        assert least <= (distance < ALIGNED).mean() <= most

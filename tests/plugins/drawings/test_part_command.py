"""``python -m vibgym part``: description and picture of a drawing, tasks and policies."""

import gymnasium as gym
import numpy as np
import pytest

from tests.commands import said_in_one_line
from tests.plugins.drawings.helpers import saved
from vibgym.__main__ import main
from vibgym.policies.applicable import parts_with, tasks_with

BRACKET = "configs/datasheets/bracket.dxf"


def test_description_and_picture(capsys, tmp_path):
    pytest.importorskip("ezdxf")
    pygame = pytest.importorskip("pygame")
    path = tmp_path / "bracket.png"
    options = ["--friction", "0.45", "--thickness-mm", "4", "--picture", str(path), "--no-tasks"]
    assert main(["part", BRACKET, *options]) == 0
    text = capsys.readouterr().out
    assert "bracket: 70 x 56 mm, 4 mm high" in text and "3 holes" in text and "skipped 1 TEXT" in text
    picture = pygame.surfarray.array3d(pygame.image.load(path))
    orange = (np.abs(picture.astype(int) - [196, 90, 36]).max(axis=2) < 10).mean()
    assert orange > 0.0105  # the tags of ten elements, of which the part covers half
    assert picture.shape[0] > 600 and (np.abs(picture.astype(int) - [61, 66, 78]).max(axis=2) < 30).mean() > 0.03


@pytest.mark.parametrize(("options", "named"), [
    (["missing.dxf"], "missing.dxf"), ([BRACKET, "--units", "miles"], "units"), ([BRACKET, "--picture", "a.jpg"], "--picture"),
    ([BRACKET, "--friction", "-1"], "friction"),
])  # fmt: skip
def test_bad_input_is_one_line(capsys, options, named):
    pytest.importorskip("ezdxf")
    assert main(["part", *options]) == 2
    assert named in said_in_one_line(capsys)


def test_tasks_and_policies():
    """Only tasks with a part that is pushed have the policy ``push``; twenty large parts have no room."""
    tasks = tasks_with({"shape": "disc", "radius_mm": 60, "friction": 0.5, "name": "lid"})
    assert "pose" in tasks["Align"] and "push" in tasks["Push"] and "push" not in tasks["Align"]
    assert isinstance(tasks["PackFull"], str) and "20 parts" in tasks["PackFull"]
    assert not any(name.endswith("Shapes") for name in tasks)


def test_the_pushed_part_is_replaced_or_the_first_kind():
    part = {"shape": "disc", "radius_mm": 20, "friction": 0.5}
    push, sort = parts_with("vibgym/Push-v0", part), parts_with("vibgym/Sort-v0", part)
    assert push[2] == {**part, "coupling": 0.0} and push[:2] == gym.spec("vibgym/Push-v0").kwargs["parts"][:2]
    assert sort.count(part) == 3 and len(sort) == 6


def drawn(folder, *entities):
    """Save a drawing in mm of entities: kinds and arguments."""
    document = pytest.importorskip("ezdxf").new(units=4)
    for kind, *arguments in entities:
        getattr(document.modelspace(), f"add_{kind}")(*arguments)
    return saved(document, folder / "drawing.dxf")


def test_a_small_disc_on_another_surface(capsys, tmp_path):
    """A disc has no angle of symmetry; 'learned' was trained on larger parts; a surface is a mapping or a file."""
    # A square of 60 mm in the middle of an element of 26 mm: 26 / 60 of its width on that column, 17 / 60 on those beside.
    square = drawn(tmp_path, ("lwpolyline", [(0, 0), (60, 0), (60, 60), (0, 60), (0, 0)]))
    assert main(["part", str(square), "--no-tasks"]) == 0
    beneath = "elements beneath, in the middle of one: 9, in rows 3 to 5 and columns 15 to 17; the most loaded one carries 19 %"
    assert beneath in capsys.readouterr().out
    path = drawn(tmp_path, ("circle", (0, 0), 10.0))
    assert main(["part", str(path)]) == 0
    text = capsys.readouterr().out
    assert "disc of 20 mm" in text and "any angle" in text and "smaller than an element of 26 mm" in text
    assert "'learned' was trained on parts of larger radius" in text and "Align (30.5 mm)" in text
    (tmp_path / "machine.yaml").write_text("surface: {element_size_mm: 9, rows: 3, columns: 40}\n")
    for surface in (str(tmp_path / "machine.yaml"), '{"element_size_mm": 9, "rows": 3, "columns": 40}'):
        assert main(["part", str(path), "--no-tasks", "--surface", surface]) == 0
        assert "beneath, in the middle of one: 9" in capsys.readouterr().out
    assert main(["part", str(path), "--surface", '{"rowz": 1}']) == 2
    assert "rowz" in said_in_one_line(capsys)


def test_choice_and_faults(capsys, tmp_path):
    pygame = pytest.importorskip("pygame")
    path = drawn(tmp_path, ("circle", (0, 0), 10.0), ("circle", (50, 0), 20.0), ("text", "two discs"))
    assert main(["part", str(path)]) == 2
    assert "2 parts in one file" in said_in_one_line(capsys)
    assert main(["part", str(path), "--part", "1", "--scale", "2", "--no-tasks"]) == 0
    text = capsys.readouterr().out
    assert "disc of 40 mm" in text and "skipped 1 TEXT, 1 parts that are not selected" in text
    path = drawn(tmp_path, ("line", (0, 0), (30, 0)), ("line", (30, 1), (60, 20)))
    picture = tmp_path / "faults.png"
    assert main(["part", str(path), "--picture", str(picture)]) == 2
    printed = capsys.readouterr()
    begins = [line.partition(":")[0] for line in printed.out.splitlines()]
    assert begins == ["fault 0", "fault 1", "fault 2", "fault 3", "picture"]
    assert len(printed.err.splitlines()) == 1 and "and 3 other faults" in printed.err
    marks = np.abs(pygame.surfarray.array3d(pygame.image.load(picture)).astype(int) - [196, 90, 36]).max(axis=2) < 10
    assert marks[:300].any() and marks[400:600].any() and marks[800:].any() and not marks[300:400].any()

"""Notebooks run at small size; their stored outputs come from the same source at full size."""

import json
import re
import tomllib
from types import SimpleNamespace

import nbformat
import pytest
from IPython.core.inputtransformer2 import TransformerManager

from studies import notebooks
from studies.project import PYPROJECT

SMALL = {
    "first_steps": {"EPISODES": 4, "WORLDS": 8, "FRAMES": 2},
    "train_in_seconds": {"STEPS": 64, "PARTS": 2, "WORLDS": 2, "EPISODES": 2, "FRAMES": 2},
    "speed_against_error": {"WORLDS": 8, "REPEATS": 2},
}
"""Notebook -> parameters."""

PRINTED = {
    "first_steps": "learned      100.0 %, median",
    "train_in_seconds": "the law pose  success 100.0 %, median",
    "speed_against_error": "averaged  {'order': 2}",
}


def read(name):
    return nbformat.read(notebooks.FOLDER / f"{name}.ipynb", as_version=4)


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def shown(notebook):
    """Return the printed text and the types of pictures."""
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    printed = "".join(output.text for output in outputs if output.get("name") == "stdout")
    pictures = ("image/png", "image/gif")
    return printed, [kind for output in outputs for kind in output.get("data", {}) if kind in pictures]


@pytest.mark.parametrize("name", SMALL)
def test_notebooks_run_at_small_size_with_the_stored_kinds_of_output(name):
    stored = read(name)
    new = notebooks.tidied(notebooks.executed(stored, **SMALL[name]))
    printed, pictures = shown(new)
    assert PRINTED[name] in printed and PRINTED[name] in shown(stored)[0]
    assert pictures and pictures == shown(stored)[1]
    # The stored notebook was executed in one session, from this source, without an error.
    assert [cell.source for cell in new.cells] == [cell.source for cell in stored.cells]
    assert [cell.execution_count for cell in code_cells(stored)] == list(range(1, len(code_cells(stored)) + 1))
    assert not any(output.output_type == "error" for cell in code_cells(stored) for output in cell.outputs)


def test_stored_notebooks_are_small_valid_linked_and_free_of_local_paths():
    assert notebooks.names() == list(SMALL)
    for name in SMALL:
        text = (notebooks.FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
        assert len(text.encode()) < notebooks.LARGEST
        assert not any(path in text for path in (str(notebooks.ROOT), "/home/", "/root/", "/tmp/", "site-packages"))
        notebook = read(name)
        nbformat.validate(notebook)
        assert notebook == notebooks.tidied(notebook) == notebooks.linked(notebook, name)


def test_the_stored_training_learns():
    lines = [line for line in shown(read("train_in_seconds"))[0].splitlines() if line[:6] in ("before", "after ")]
    before, after = (float(line.split("success")[1].split("%")[0]) for line in lines)
    assert before < 20.0 and after >= 95.0


def test_a_missing_extra_is_reported_in_one_line(tmp_path):
    notebook = read("first_steps")
    last = next(k for k, cell in enumerate(notebook.cells) if "parameters" in cell.metadata.get("tags", ()))
    notebook.cells = notebook.cells[: last + 1]
    # Importing the package fails, as in an environment without the extra.
    (tmp_path / "sitecustomize.py").write_text("import sys\n\nsys.modules['matplotlib'] = None\n")
    executed = notebooks.executed(notebook, keep_errors=True, env={"PYTHONPATH": f"{notebooks.ROOT}:{tmp_path}"})
    errors = [output for cell in code_cells(executed) for output in cell.outputs if output.output_type == "error"]
    line = "matplotlib is not installed: pip install 'vibgym[notebooks]'"
    assert errors[0].traceback == [line] and errors[0].evalue == line


@pytest.mark.parametrize("name", SMALL)
def test_notebooks_install_the_package_where_it_is_missing(name, monkeypatch):
    code = TransformerManager().transform_cell(code_cells(read(name))[0].source.partition("\n\nfrom vibgym")[0])
    commands = []
    shell = SimpleNamespace(run_line_magic=lambda magic, line: commands.append((magic, line)))
    exec(code, {"get_ipython": lambda: shell})
    assert commands == []  # it is installed
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    exec(code, {"get_ipython": lambda: shell})
    ((magic, line),) = commands
    extras = re.fullmatch(r"install --quiet 'vibgym\[([\w,]+)\]'", line)[1].split(",")
    known = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert magic == "pip" and set(extras) <= set(known)


def test_unknown_names_and_notebooks_that_fail_or_print_local_paths_change_nothing(capsys, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="STEP"):
        notebooks.executed(read("first_steps"), STEP=1)
    for name, code in {"fails": "1 / 0", "local": "import os; print(os.__file__)"}.items():
        cell = {**nbformat.v4.new_code_cell("N = 1"), "metadata": {"tags": ["parameters"]}}
        book = nbformat.v4.new_notebook(cells=[cell, nbformat.v4.new_code_cell(code)])
        (tmp_path / f"{name}.ipynb").write_text(json.dumps(book))
    monkeypatch.setattr(notebooks, "FOLDER", tmp_path)
    monkeypatch.setattr(notebooks, "LOCAL_PATHS", (*notebooks.LOCAL_PATHS, "os.py"))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for name, code, words in (
        ("last_steps", 2, "last_steps"),
        ("fails", 1, "fails.ipynb: ZeroDivisionError"),
        ("local", 2, "free of local paths"),
    ):
        assert notebooks.main([name]) == code
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and words in error
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before

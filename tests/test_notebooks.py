"""Notebooks run at small size; their stored outputs come from the same source at full size."""

import base64
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


def shown(notebook):
    """Return the printed text and the types of pictures."""
    outputs = [each for cell in notebook.cells if cell.cell_type == "code" for each in cell.outputs]
    printed = "".join(each.text for each in outputs if each.get("name") == "stdout")
    pictures = [kind for each in outputs for kind in each.get("data", {}) if kind in ("image/png", "image/gif")]
    return printed, pictures


@pytest.mark.parametrize("name", SMALL)
def test_notebooks_run_at_small_size_with_the_stored_kinds_of_output(name):
    kept = read(name)
    found = notebooks.tidied(notebooks.executed(kept, **SMALL[name]))
    printed, pictures = shown(found)
    assert PRINTED[name] in printed and PRINTED[name] in shown(kept)[0]
    assert pictures and pictures == shown(kept)[1]
    # The stored notebook was executed in one session, from this source, without an error.
    assert [cell.source for cell in found.cells] == [cell.source for cell in kept.cells]
    counts = [cell.execution_count for cell in kept.cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert not any(each.output_type == "error" for cell in kept.cells for each in cell.get("outputs", ()))


def test_stored_notebooks_are_small_valid_and_free_of_local_paths():
    assert notebooks.names() == list(SMALL)
    for name in SMALL:
        text = (notebooks.FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
        assert len(text.encode()) < notebooks.LARGEST
        assert not any(path in text for path in (str(notebooks.ROOT), "/home/", "/root/", "/tmp/", "site-packages"))
        notebook = read(name)
        nbformat.validate(notebook)
        assert notebook == notebooks.tidied(notebook)
        for cell in notebook.cells:
            for each in cell.get("outputs", ()):
                if "image/gif" in each.get("data", {}):
                    assert base64.b64decode(each.data["image/gif"]).startswith(b"GIF89a")


def test_the_stored_training_learns():
    before, after = (
        line for line in shown(read("train_in_seconds"))[0].splitlines() if line[:6] in ("before", "after ")
    )
    success = [float(line.split("success")[1].split("%")[0]) for line in (before, after)]
    assert success[0] < 20.0 and success[1] >= 95.0


@pytest.mark.parametrize("name, package, extra", [
    ("first_steps", "matplotlib", "notebooks"),
    ("train_in_seconds", "stable_baselines3", "learn"),
    ("speed_against_error", "matplotlib", "notebooks"),
])  # fmt: skip
def test_notebooks_report_a_missing_extra_in_one_line(name, package, extra, tmp_path):
    kept = read(name)
    kept.cells = kept.cells[
        : next(k for k, cell in enumerate(kept.cells) if "parameters" in cell.metadata.get("tags", ())) + 1
    ]
    # Importing the package fails, as in an environment without the extra.
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n\n\nclass Blocked:\n    def find_spec(self, name, *more):\n"
        f"        if name.partition('.')[0] == {package!r}:\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n\n\n"
        "sys.meta_path.insert(0, Blocked())\n"
    )
    found = notebooks.executed(kept, keep_errors=True, env={"PYTHONPATH": f"{notebooks.ROOT}:{tmp_path}"})
    errors = [each for cell in found.cells for each in cell.get("outputs", ()) if each.output_type == "error"]
    line = f"{package} is not installed: pip install 'vibgym[{extra}]'"
    assert errors[0].traceback == [line] and errors[0].evalue == line


def test_links_to_colab_follow_the_address_of_the_repository(tmp_path):
    for name in SMALL:
        assert read(name) == notebooks.linked(read(name), name)
    pyproject = tmp_path / "pyproject.toml"
    for urls, link in {
        "[project.urls]\nRepository = 'https://github.com/a/b.git'": "https://colab.research.google.com/github/a/b/blob/main/",
        "[project.urls]\nRepository = 'https://example.org/a/b'": None,
        "": None,
    }.items():
        pyproject.write_text(f"[project]\nname = 'vibgym'\n{urls}\n")
        plain = notebooks.linked(read("first_steps"), "first_steps", tmp_path / "pyproject.toml")
        first = plain.cells[0].source.split("\n")[0]
        assert first == ("# First steps" if link is None else f"[Open in Colab]({link}notebooks/first_steps.ipynb)")
        assert notebooks.linked(plain, "first_steps", pyproject) == plain


@pytest.mark.parametrize("name", SMALL)
def test_notebooks_install_the_package_where_it_is_missing(name, monkeypatch):
    first = next(cell.source for cell in read(name).cells if cell.cell_type == "code")
    code = TransformerManager().transform_cell(first.partition("\n\nfrom vibgym")[0])
    ran = []
    shell = SimpleNamespace(run_line_magic=lambda magic, line: ran.append((magic, line)))
    exec(code, {"get_ipython": lambda: shell})
    assert ran == []  # it is installed
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    exec(code, {"get_ipython": lambda: shell})
    ((magic, line),) = ran
    extras = re.fullmatch(r"install --quiet 'vibgym\[([\w,]+)\]'", line)[1].split(",")
    offered = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert magic == "pip" and set(extras) <= set(offered)


def test_unknown_parameters_are_rejected():
    with pytest.raises(ValueError, match="STEP"):
        notebooks.executed(read("first_steps"), STEP=1)


def test_unknown_notebooks_are_rejected(capsys):
    assert notebooks.main(["last_steps"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "last_steps" in error and "first_steps" in error


def test_notebooks_that_fail_or_print_local_paths_are_not_stored(capsys, tmp_path, monkeypatch):
    source = {"fails": "1 / 0", "local": "import os; print(os.__file__)"}
    for name, code in source.items():
        cell = {**nbformat.v4.new_code_cell("N = 1"), "metadata": {"tags": ["parameters"]}}
        book = nbformat.v4.new_notebook(cells=[cell, nbformat.v4.new_code_cell(code)])
        (tmp_path / f"{name}.ipynb").write_text(json.dumps(book))
    monkeypatch.setattr(notebooks, "FOLDER", tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert notebooks.main(["fails"]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "fails.ipynb: ZeroDivisionError" in error
    monkeypatch.setattr(notebooks, "LOCAL_PATHS", (*notebooks.LOCAL_PATHS, "os.py"))
    assert notebooks.main(["local"]) == 2
    assert "free of local paths" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before

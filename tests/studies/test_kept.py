"""Stored tables of benchmarks: equal to the printed ones, complete, with provenance."""

import re

import pytest

from studies import kept
from studies.manual.build import tables
from studies.manual.figures_file import ROOT


def test_printed_tables_are_stored_and_included(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(kept, "DIRECTORY", tmp_path / "tables")
    kept.show("mine", ("a", "b"), [("1", "2 µm")])
    assert not (tmp_path / "tables").exists()
    kept.show("mine", ("a", "b"), [("1", "2 µm")], keep=True)
    printed = capsys.readouterr().out
    assert printed.count("| 1 | 2 µm |") == 2
    (table,) = kept.tables().values()
    assert printed.startswith(table.markdown().split("\n\n")[0])
    assert re.search(r"\n\n`python -m .+`, \d{4}-\d\d-\d\d.*, .+ cores\.$", table.markdown())
    page = tables(tmp_path)[tmp_path / "generated" / "tables" / "mine.md"]
    assert page == table.markdown() + "\n"


def test_rows_of_another_length_are_rejected_before_storing(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(kept, "DIRECTORY", tmp_path)
    kept.show("mine", ("a", "b"), [("1", "2")], keep=True)
    before = (tmp_path / "mine.json").read_text()
    capsys.readouterr()
    with pytest.raises(ValueError, match=r"mine"):
        kept.show("mine", ("a", "b"), [("1",)], keep=True)
    assert (tmp_path / "mine.json").read_text() == before and not capsys.readouterr().out


def test_every_stored_table_is_on_a_page_and_its_command_exists():
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    included = re.findall(r"\{include\} generated/tables/(\S+)\.md", pages)
    stored = kept.tables()
    assert sorted(included) == sorted(stored)
    for table in stored.values():
        module = re.match(r"python -m ([\w.]+)|make compare$", table.command)[1]
        path = ROOT / (module or "Makefile").replace(".", "/")
        assert path.exists() or path.with_suffix(".py").exists() or (path / "__main__.py").exists()
        assert "nan" not in table.markdown()

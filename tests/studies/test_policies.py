"""Tables of policies: the cases are those of the stored tables, and a small run."""

import numpy as np
import pytest
import yaml

from agents.evaluation.statistics import bootstrap, exact
from studies import kept
from studies.benchmarks import policies
from vibgym.config import load_yaml

TABLES = load_yaml(policies.FILE)
STORED = kept.tables()


@pytest.mark.parametrize("name", TABLES)
def test_rows_and_formats_are_those_of_the_stored_table(name):
    table = TABLES[name]
    labels = [names for names, _ in policies.rows(table)]
    formats = [table["cell"]] if "columns" in table else table["cells"].values()
    assert set(formats) <= set(policies.FORMATS) and len(set(map(tuple, labels))) == len(labels)
    column = next(iter(table.get("columns", {"": {}}).values()))
    assert all({"policy", "task"} <= policies.joined(settings, column).keys() for _, settings in policies.rows(table))
    if name in STORED:
        assert [row[: len(table["heads"])] for row in STORED[name].rows] == labels
        columns = [*table.get("columns", table.get("cells"))]
        assert len(STORED[name].heads) == len(table["heads"]) + len(columns) + ("last" in table)


def test_settings_of_levels_and_columns_are_joined(tmp_path, monkeypatch, capsys):
    table = {
        "heads": ["hardware", "limit"],
        "episodes": 3,
        "settings": {"task": "Align", "policy": "local_field", "parts": ["steel_block"]},
        "rows": [[{"hardware": ["ideal", "prototype"]}, {"short": {"max_episode_steps": 2}, "long": {}}]],
        "columns": {"pose": {"policy": {"law": "pose"}}, "lqr": {"policy": {"law": "lqr"}}},
        "cell": "interval",
    }
    bound = {**table, "cells": {"episodes": "episodes", "beaten by": "beaten"}, "first_seed": 7}
    del bound["columns"]
    (names, settings), *_ = list(policies.rows(table))[2:]
    assert names == ["prototype", "short"] and settings["sensor"]["estimator"] == "model"
    column = policies.joined(settings, table["columns"]["lqr"])
    assert column["policy"] == {"kind": "local_field", "law": "lqr"} and column["max_episode_steps"] == 2
    path = tmp_path / "tables.yaml"
    path.write_text(yaml.safe_dump({"mine": table, "bound-mine": bound}, sort_keys=False))
    monkeypatch.setattr(policies, "FILE", path)
    monkeypatch.setattr(policies, "WORLDS", 2)  # two batches
    assert policies.main(["mine", "bound-mine"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert lines[2].count("0.0 % (0.0 to 70.8), –") == 2 and lines[3].count("100.0 % (29.2 to 100.0), ") == 2
    assert lines[8] == "| ideal | short | 3 | 0 |" and len(lines) == 12


def test_intervals_for_other_shapes_count_shapes():
    success, shape = np.array([True] * 6 + [False] * 2), np.array([0, 0, 0, 1, 1, 1, 2, 2])
    assert policies.shape_interval(success, shape) == bootstrap(np.array([1.0, 1.0, 0.0]), 0.95, 9999)
    assert policies.shape_interval(success[:6], shape[:6]) == exact(6, 6, 0.95)

"""What the JSON files of all kinds of evaluations share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from agents.evaluation.machine import sentences
from agents.evaluation.records import Row
from agents.evaluation.run_settings import RunSettings
from agents.evaluation.tables import plain
from agents.evaluation.words import facts
from vibgym.policies.task_info import TaskInfo


def json_text(
    provenance: Mapping[str, Any],
    settings: RunSettings,
    tasks: Mapping[str, TaskInfo],
    hardware: Iterable[str],
    rows: Iterable[Row],
    more: Mapping[str, Any],
) -> str:
    """The text of a file: where results come from, what was run, rows of statistics, and more; what does not apply is null."""
    surface, arguments = next(iter(tasks.values())).surface, settings.environments()
    content = {
        **provenance,
        "settings": settings.as_written(),
        "seeds": settings.seed_list(),
        "tasks": {name: facts(info, len(settings.seed_list(name))) for name, info in tasks.items()},
        "hardware": {name: sentences(arguments[name], surface) for name in hardware},
        "results": [vars(row) for row in rows],
        **more,
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"

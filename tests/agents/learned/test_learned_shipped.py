"""The trained policies in the repository."""

from pathlib import Path

import pytest

from agents.registry import make_policy
from tests.agents.helpers import POSE_TASKS, episodes, info_of

SHIPPED = Path(__file__).parents[3] / "agents" / "learned" / "shipped"


def test_exactly_these_are_shipped():
    assert sorted(path.name for path in SHIPPED.glob("*.json")) == ["align.json", "rotate.json", "transport.json"]
    assert len(list(SHIPPED.glob("*.safetensors"))) == 3
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 2_000_000


@pytest.mark.parametrize("task", POSE_TASKS)
def test_shipped_policies_succeed(task):
    policy = make_policy(str(SHIPPED / f"{task.lower()}.json"), info_of(task))
    assert episodes(policy, task).success >= 99

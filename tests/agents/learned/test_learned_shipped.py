"""The trained policies in the repository."""

from pathlib import Path

import pytest

from agents.registry import make_policy
from tests.agents.helpers import DISC, POSE_TASKS, episodes, info_of

SHIPPED = Path(__file__).parents[3] / "agents" / "learned" / "shipped"


def test_exactly_these_are_shipped():
    assert sorted(path.name for path in SHIPPED.glob("*.json")) == [
        "align.json", "rotate.json", "transport-image.json", "transport.json",
    ]  # fmt: skip
    assert len(list(SHIPPED.glob("*.safetensors"))) == 4
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 2_000_000


@pytest.mark.parametrize("task", POSE_TASKS)
def test_shipped_policies_succeed(task):
    policy = make_policy(str(SHIPPED / f"{task.lower()}.json"), info_of(task))
    assert episodes(policy, task).success >= 99


@pytest.mark.parametrize("settings", [{}, {"parts": [DISC]}, {"surface": {"rows": 12, "columns": 12}}])
def test_the_policy_of_images_serves_other_shapes_and_surfaces_too(settings):
    policy = make_policy(str(SHIPPED / "transport-image.json"), info_of("Transport", **settings))
    assert policy.observation == "image"
    assert episodes(policy, "Transport", **settings).success >= 97

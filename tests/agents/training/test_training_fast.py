"""Training with fast contacts, from the file to the table."""

import csv

import pytest

from agents.tabulate import FIRST_SEED, tabulate
from agents.train import train
from vibgym.policies.rollout import rollout

TEXT = """
vibgym/SortCrowded-v0:
  fast:
    environment: {action: field, model: {kind: planar, contacts: fast}, max_episode_steps: 20}
    worlds: 8
    steps: 256
    output: OUTPUT
    judging: {episodes: 4, every: 128}
    ppo: {n_steps: 16, batch_size: 64, n_epochs: 1, net: [8], critic_net: [8]}
"""

pytestmark = pytest.mark.usefixtures("one_thread")


def test_the_table_has_both_contacts(tmp_path):
    path = tmp_path / "many.yaml"
    path.write_text(TEXT.replace("OUTPUT", str(tmp_path / "run")))
    policy = train(path, quiet=True, agent="SortCrowded/fast")
    page = tmp_path / "agents.md"
    row = tabulate(path, ["SortCrowded/fast"], [0], 3, tmp_path, page)[0]
    seeds = range(FIRST_SEED, FIRST_SEED + 3)
    kind = {"kind": "trained", "path": str(policy)}
    certified, fast = (
        rollout(kind, "SortCrowded", seeds=seeds, max_episode_steps=20, model={"kind": "planar", "contacts": contacts})
        for contacts in ("certified", "fast")
    )
    assert row["success"] == certified.success.mean() and row["success_fast_contacts"] == fast.success.mean()
    assert (certified.returns != fast.returns).any()
    assert f"{100 * row['success']:.1f} % ({100 * row['success_fast_contacts']:.1f} %)" in page.read_text()
    with (tmp_path / "agents.csv").open(newline="") as file:
        assert next(csv.DictReader(file))["success_fast_contacts"] == str(row["success_fast_contacts"])

"""Learning curves: rows of a run before and after an interruption, ranks, costs, contacts of evaluations, and files."""

import re

import gymnasium as gym
import numpy as np
import pytest

from agents import served
from agents.learning_curve import COLUMNS, RATE, LearningCurve, evaluation_environments, rank, read_curve, without_hold
from agents.ppo import PPO
from agents.tabulate import FIRST_SEED, tabulate
from agents.train import train
from agents.training_file import settings_from
from tests.commands import rows_of
from tests.envs.helpers import batch
from vibgym.policies.rollout import rollout, run

SETTINGS = {
    "task": "Transport",
    "environment": {"action": "wrench", "max_episode_steps": 20},
    "steps": 100,
    "selection": {"episodes": 5, "first_seed": 400_070, "every": 10},
}
FAST = {"kind": "planar", "contacts": "fast"}


class Straight:
    """Pushes the part to the right; without force it rests."""

    action, observation = "wrench", "parts"

    def __init__(self, force=0.0):
        self.force = force

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert deterministic
        worlds, parts = observation["mask"].shape
        return np.tile(np.float32([self.force, 0.0, 0.0]), (worlds, parts)), state


def curve_in(folder, begin=0, **changes):
    curve = LearningCurve(settings_from({**SETTINGS, **changes}), folder)
    curve.begin(begin)
    return curve


def test_rows_describe_episodes_on_the_same_seeds(tmp_path):
    curve = curve_in(tmp_path)
    assert not curve.due(9) and curve.due(10)
    row = curve.measure(Straight(), 10, 1.23, "imitation")
    assert tuple(row) == COLUMNS and not curve.due(19) and curve.due(20)
    curve.measure(Straight(), 20, 4.56, "ppo")
    first, second = rows_of(curve.path)
    assert (first["steps"], first["seconds"], first["phase"]) == ("10", "1.2", "imitation")
    assert (second["steps"], second["seconds"], second["phase"]) == ("20", "4.6", "ppo")
    env = batch("Transport", 5, action="wrench", max_episode_steps=20, observation="parts", autoreset_mode="Disabled")
    result = run(Straight(), env, range(400_070, 400_075), "Transport")
    assert np.isnan(result.reported(RATE)).all() and first["rate"] == ""
    assert not result.success.any() and (result.steps == 20).all() and len(set(result.returns.round(9))) > 1
    for row in (first, second):
        assert (row["success"], row["time_to_goal"]) == ("0.0", "")
        assert float(row["mean_time"]) == pytest.approx(20 * env.step_time)  # the limit, of episodes that fail
        assert float(row["return_"]) == pytest.approx(np.median(result.returns), abs=1e-4)


def test_a_run_that_continues_keeps_the_rows_up_to_its_checkpoint(tmp_path):
    curve = curve_in(tmp_path)
    for steps in (10, 20, 30):
        curve.measure(Straight(), steps, 1.0, "ppo")
    before = curve.path.read_text().splitlines()
    again = curve_in(tmp_path, 25)  # steps after it were lost
    assert again.path.read_text().splitlines() == before[:-1] and not again.due(29) and again.due(30)
    again.measure(Straight(), 35, 2.0, "ppo")
    assert [row["steps"] for row in rows_of(curve.path)] == ["10", "20", "35"]
    assert rows_of(curve_in(tmp_path).path) == []  # a run from its beginning has a curve of its own


def test_episodes_are_divided_among_scenes(tmp_path):
    curve = curve_in(tmp_path, scenes=[{"max_episode_steps": steps} for steps in (10, 15, 20)])
    curve.measure(Straight(), 10, 1.0, "ppo")
    assert [(env.num_envs, env.unwrapped.max_episode_steps, first) for env, first in curve._envs] == [
        (2, 10, 400_070), (2, 15, 400_072), (1, 20, 400_074),
    ]  # fmt: skip


def test_own_tasks_are_evaluated_where_episodes_end(tmp_path, monkeypatch):
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    spec = gym.envs.registration.EnvSpec("mine/Align-v0", kwargs={"task": "Align"}, **entry)
    monkeypatch.setitem(gym.registry, "mine/Align-v0", spec)
    with pytest.raises(ValueError, match="selection"):
        curve_in(tmp_path, task="mine/Align-v0")
    assert not list(tmp_path.iterdir())
    spec.max_episode_steps = 30
    curve = curve_in(tmp_path, task="mine/Align-v0")
    assert curve.measure(Straight(), 10, 1.0, "ppo")["success"] == 0.0


def test_where_parts_come_and_go_the_rate_ranks(tmp_path):
    disc = [{"name": "puck", "shape": "disc", "radius": 0.02, "friction": 0.6}]
    scene = {"action": "wrench", "parts": disc, "max_episode_steps": 150, "task_settings": {"warm_up": 0.0}}
    curve = curve_in(tmp_path, task="Feed", environment=scene, selection={"episodes": 2, "every": 10})
    row = curve.measure(Straight(1.0), 10, 1.0, "ppo")
    assert row["rate"] > 0.0 and row["success"] == 0.0 and row["time_to_goal"] == ""
    worse = {**row, "rate": row["rate"] - 1.0}
    assert rank(row) < rank(worse) and curve.is_best(row) and not curve.is_best(worse)


@pytest.mark.parametrize("best, cost_limit, rows", [
    ("success", None, [("1.0", "", "2.0", ""), ("1.0", "", "3.0", ""), ("0.9", "", "1.0", ""), ("0.0", "", "", "")]),
    ("speed", None, [(0.9, 0.5, 3.0, ""), (1.0, 0.4, 2.0, "")]),
    ("speed", 0.2, [(0.5, 0.2, 3.0, 0.2), (1.0, 0.4, 2.0, 0.21), (1.0, 0.5, 2.0, 0.9)]),
])  # fmt: skip
def test_rows_rank_by_excess_cost_then_success_or_speed_then_time(best, cost_limit, rows):
    named = [dict(zip(("success", "speed", "time_to_goal", "cost"), row, strict=True)) for row in rows]
    assert sorted([*named[1:], named[0]], key=lambda row: rank(row, best, cost_limit)) == named


# -- contacts ----------------------------------------------------------------------------------------------------------


def test_training_with_fast_contacts_is_evaluated_with_certified_ones():
    """In the environment and in scenes; other settings of the model stay."""
    environment = {"action": "wrench", "model": {**FAST, "steps": 6}}
    scenes = [{}, {"slots": 12, "model": FAST}]
    settings = settings_from({**SETTINGS, "task": "Pack", "environment": environment, "scenes": scenes})
    models = [arguments["model"] for arguments in evaluation_environments(settings)]
    assert models == [{"kind": "planar", "steps": 6}, {"kind": "planar"}]
    assert [arguments["model"]["contacts"] for arguments in without_hold(settings)] == ["fast", "fast"]


def test_the_table_has_both_contacts_and_ships_the_best_seed_or_a_chosen_one(tmp_path, monkeypatch):
    path, page = tmp_path / "many.yaml", tmp_path / "agents.md"
    path.write_text(f"""
vibgym/SortCrowded-v0:
  fast:
    environment: {{action: field, model: {{kind: planar, contacts: fast}}, max_episode_steps: 20}}
    worlds: 8
    steps: 256
    output: {tmp_path / "run"}
    selection: {{episodes: 4, every: 128}}
    ppo: {{n_steps: 16, batch_size: 64, n_epochs: 1, net: [8], critic_net: [8]}}
""")
    policy = train(path, quiet=True, agent="SortCrowded/fast")
    row = tabulate(path, ["SortCrowded/fast"], [0], 3, tmp_path, page)[0]
    kind, scene = {"kind": "trained", "path": str(policy)}, {"max_episode_steps": 20}
    seeds = range(FIRST_SEED, FIRST_SEED + 3)
    certified = rollout(kind, "SortCrowded", seeds=seeds, **scene)
    fast = rollout(kind, "SortCrowded", seeds=seeds, **scene, model=FAST)
    assert row["success"] == certified.success.mean() and row["success_fast_contacts"] == fast.success.mean()
    assert (certified.returns != fast.returns).any()
    assert f"{100 * row['success']:.1f} % ({100 * row['success_fast_contacts']:.1f} %)" in page.read_text()
    assert rows_of(tmp_path / "agents.csv")[0]["success_fast_contacts"] == str(row["success_fast_contacts"])
    assert rows_of(tmp_path / "curves" / "sortcrowded-fast-seed-0.csv") == rows_of(tmp_path / "run" / "curve.csv")
    monkeypatch.setattr(served, "store", lambda path: None)
    for choose, shipped in ((None, [True, False]), (1, [False, True])):  # both seeds have the same run here
        rows = tabulate(path, ["SortCrowded/fast"], [0, 1], 1, tmp_path, ship=tmp_path / "shipped", choose=choose)
        assert [row["shipped"] for row in rows] == shipped and (tmp_path / "shipped" / "sortcrowded-fast.json").exists()
    with pytest.raises(ValueError, match="--choose must be one of the seeds 0, got 1"):
        tabulate(path, ["SortCrowded/fast"], [0], 1, tmp_path, ship=tmp_path / "shipped", choose=1)
    with pytest.raises(ValueError, match="--choose requires --ship"):
        tabulate(path, ["SortCrowded/fast"], [0], 1, tmp_path, choose=0)


# -- costs -------------------------------------------------------------------------------------------------------------

PAIR = [{"shape": "disc", "radius_mm": 20, "friction": 0.6, "name": "disc"}] * 2
COSTLY = {
    "task": "Sort", "steps": 10_000, "worlds": 4,
    "environment": {"action": "velocity", "parts": PAIR, "costs": {"effort": 1.0}, "max_episode_steps": 8},
}  # fmt: skip


def learner(limit, **own):
    own = {"n_steps": 8, "batch_size": 64, "cost_limit": limit, "multiplier_rate": 0.5, **own}
    return PPO(settings_from({**COSTLY, "ppo": own}))


@pytest.mark.parametrize(
    "limit, own, multiplier",
    [
        (1e-4, {}, 1.5),
        (1e4, {}, 0.0),
        (1e-4, {"multiplier_rate": 0.0, "multiplier_gain": 2.0}, 2.0),
        (1e-4, {"multiplier_gain": 2.0}, 3.5),
        (1e4, {"multiplier_gain": 2.0}, 0.0),
    ],
)
def test_the_multiplier_follows_the_excess(limit, own, multiplier):
    costly = learner(limit, **own)
    costly.learn(96, lambda metrics: None)  # three updates; episodes end after eight steps
    assert costly.multiplier == pytest.approx(multiplier) and costly.env.part_cost.shape == (4, 2)
    costly.close()


def test_a_limit_requires_a_multiplier():
    with pytest.raises(ValueError, match="multiplier_gain"):
        learner(1.0, multiplier_rate=0.0)


def test_costs_are_subtracted_from_the_rewards_with_the_multiplier():
    plain, costly = learner(None), learner(1e-4)
    costly.multiplier = 3.0
    for ppo in (plain, costly):
        ppo.env.seed(5)
        ppo.worlds.observation = ppo.env.reset()
        ppo.collect()
        ppo.close()
    difference = plain.rollout.reward[0] - costly.rollout.reward[0]
    assert (difference > 0.0).all()  # elements move in the first step


# -- files -------------------------------------------------------------------------------------------------------------

HEAD = "steps,seconds,phase,success,time_to_goal,return_\n"


def test_a_curve_is_read(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("phase,steps,success,seconds,return_,time_to_goal\nppo,8,0.25,1.5,-2,3.25\n")
    curve = read_curve(path, "curve")
    assert (curve.steps.tolist(), curve.seconds.tolist(), curve.phase.tolist()) == ([8], [1.5], ["ppo"])
    assert (curve.success.tolist(), curve.time_to_goal.tolist(), curve.return_.tolist()) == ([0.25], [3.25], [-2.0])


@pytest.mark.parametrize("content, named", [
    ("", "line 1"), (HEAD, "line 1"), (HEAD.replace("return_", "reward") + "1,2,ppo,0.5,2,3\n", "return_"),
    (HEAD + "1,2,ppo,0.5,2\n", "line 2"), (HEAD + "1,2,ppo,much,2,3\n", "line 2.success"),
    (HEAD + "1,2,ppo,50,2,3\n", "line 2.success"), (HEAD + "1,inf,ppo,0.5,2,3\n", "line 2.seconds"),
    (HEAD + "1.5,2,ppo,0.5,2,3\n", "line 2.steps"), (HEAD + "5,2,ppo,0.5,2,3\n4,3,ppo,0.5,2,3\n", "line 3: steps"),
    (HEAD + "5,2,ppo,0.5,,3\n", "line 2: missing field 'time_to_goal'"),
])  # fmt: skip
def test_damaged_curves_are_refused(content, named, tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=re.escape(named)) as error:
        read_curve(path, "curve")
    assert str(path) in str(error.value) and "\n" not in str(error.value)

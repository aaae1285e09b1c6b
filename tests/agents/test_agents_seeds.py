"""Episodes of training, selection and evaluation are different ones, and commands refuse the seeds of others."""

import itertools
import json
from pathlib import Path

import gymnasium as gym
import pytest

from agents.__main__ import main
from agents.evaluation.settings import EvaluationSettings
from agents.ppo import PPO
from agents.sb3 import SB3
from agents.training_file import load_settings, settings_from
from tests.commands import refusal, saved
from vibgym.seeds import RANGES, STREAM, check_seeds, range_of, training_seed

ROOT = Path(__file__).parents[2]
STAGED = {
    "task": "Align", "environment": {"action": "wrench"}, "worlds": 8,
    "scenes": [{"parts": ["steel_block"]}, {"parts": ["aluminium_block"]}], "steps": 8 * 4 * 4,
    "imitation": {"expert": {"kind": "pose", "action": "wrench"}, "rounds": 1, "steps": 4, "epochs": 1},
    "curriculum": [{"environment": {"max_episode_steps": 100}, "until": {"steps": k * 32}} for k in (1, 2)],
    "ppo": {"n_steps": 4, "batch_size": 16, "n_epochs": 1, "net": [8], "critic_net": [8]},
}  # fmt: skip
FOREIGN = {
    "task": "Align", "environment": {"action": "wrench"}, "worlds": 8, "steps": 64, "algorithm": "sb3.PPO",
    "sb3": {"n_steps": 4, "batch_size": 16, "n_epochs": 1},
}  # fmt: skip


def trained(kind, settings, seed, folder, resets):
    """Return seeds and starts of a training, with those of its continuation."""
    resets.clear()
    learner = kind(settings_from({**settings, "seed": seed}))
    if learner.settings.imitation is not None:
        list(learner.imitate(learner.settings.imitation))
    learner.learn(settings["steps"], lambda metrics: None)
    learner.save(folder)
    assert learner.load(folder)
    learner.learn(learner.steps + 32, lambda metrics: None)
    learner.close()
    return [[value for record in resets for value in record[k]] for k in (1, 2)]


@pytest.mark.parametrize("kind, settings, count", [(PPO, STAGED, 4), (SB3, FOREIGN, 2)])
def test_trainings_share_no_start(kind, settings, count, tmp_path, resets):
    """Not between runs, and not between imitation, stages of a curriculum and continued runs."""
    seeds, starts = zip(*(trained(kind, settings, seed, tmp_path, resets) for seed in (0, 1)), strict=True)
    assert [len(values) for values in seeds] == [8 * count] * 2
    assert len({*seeds[0], *seeds[1]}) == len({*starts[0], *starts[1]}) == 2 * 8 * count
    assert all(seed in RANGES["training"] for run in seeds for seed in run)


@pytest.mark.parametrize("agent", ["Align/ideal", "Sort/ideal"])
def test_reports_by_default_have_no_episode_that_selected_a_checkpoint(agent):
    selection = load_settings(ROOT / "configs/agents/ppo.yaml", agent, 0).selection
    selected = range(selection.first_seed, selection.first_seed + selection.episodes)
    reported = EvaluationSettings.load(ROOT / "configs/evaluations/report.yaml").seed_list(agent.partition("/")[0])
    assert len(reported) >= 100 and not set(selected) & set(reported)
    assert not set(selected) & set(EvaluationSettings.checked({"tasks": ["Align"], "policies": ["zero"]}).seed_list())


PLAYED = {"tasks": ["Align"], "policies": ["zero"], "episodes": 10}
RECORDED = {"dataset": "vibgym/align/pose-v0", "task": "Align", "policy": "pose", "episodes": 10}
TUNED = {**STAGED, "tuning": {"space": {"ppo.n_epochs": [1, 2]}}}
OUTSIDE = {
    "train": (STAGED, {"selection": {"first_seed": 100_000}}, "selection.first_seed", "selection", "100000 (evaluation)"),
    "tune": (TUNED, {"selection": {"first_seed": 300_000}}, "selection.first_seed", "selection", "300000 (held_out)"),
    "evaluate": (PLAYED, {"first_seed": 300_000}, "evaluation.first_seed", "evaluation", "300000 (held_out)"),
    "compare": (PLAYED, {"first_seed": 299_995}, "comparison.first_seed", "evaluation", "to 300004 (held_out)"),
    "score": (PLAYED | {"training_steps": 1}, {"first_seed": 100_000}, "suite.first_seed", "held_out", "(evaluation)"),
    "datasheet": ({}, {"first_seed": 500_000}, "datasheet.first_seed", "evaluation", "500000 (selection)"),
    "record": (RECORDED, {"first_seed": 7}, "first_seed", "recordings", "7 (own)"),
}  # fmt: skip


@pytest.mark.parametrize("command", OUTSIDE)
def test_a_command_refuses_the_seeds_of_others(command, tmp_path, capsys):
    content, changes, name, allowed, got = OUTSIDE[command]
    path = saved(tmp_path, content, **changes)
    if command == "record":
        path.write_text(path.read_text().replace("output:", "directory:"))
    line = refusal(capsys, main, command, path)
    assert all(text in line for text in (str(path), f"{name}: seeds must be in", f"({allowed})", got))
    assert list(tmp_path.iterdir()) == [path]  # nothing was written


@pytest.mark.parametrize("seeds, held_out, got", [
    ([5, 100_000, 299_999], False, None), ([300_000], True, None), ([5, 400_000], False, "400000 (selection)"),
    ([300_000, 5], True, "5 (own)"),
])  # fmt: skip
def test_seeds_that_are_listed_are_checked_one_by_one(seeds, held_out, got):
    settings = {"tasks": ["Align"], "policies": ["zero"], "seeds": seeds, "held_out": held_out}
    if got is None:
        assert EvaluationSettings.checked(settings).seed_list() == seeds
        return
    with pytest.raises(ValueError, match="evaluation.seeds: seeds must be in") as caught:
        EvaluationSettings.checked(settings)
    assert got in str(caught.value)


NEW_EPISODES = [
    (["verify", "results/report", "--first-seed", "500000"], "100000 to 299999 (evaluation), got 500000 (selection)"),
    (["verify", "results/tilting", "--first-seed", "200000"], "300000 to 399999 (held_out), got 200000 (evaluation)"),
    (["tabulate", "configs/agents/ppo.yaml", "--agent", "Align/ideal", "--episodes", "100001"], "--episodes must be"),
]


@pytest.mark.parametrize("arguments, named", NEW_EPISODES)
def test_new_episodes_are_in_their_range(arguments, named, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert named in refusal(capsys, main, *arguments, "--output", tmp_path / "out")
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


def test_results_of_any_seeds_are_read():
    """They were published before there were ranges."""
    record = json.loads((ROOT / "results/tilting/report.json").read_text())
    assert "held_out" not in record["settings"]
    for first in (record["settings"]["first_seed"], 700_000, 7_000_000):
        assert EvaluationSettings.stored({**record["settings"], "first_seed": first}).seed_list()[0] == first


# -- ranges and streams ------------------------------------------------------------------------------------------------

PURPOSES = (
    "",
    "imitation",
    "costs",
    *(f"{steps} steps, stage {k}" for steps in (0, 1, 10, 302_400, 10**12) for k in range(4)),
)


def test_ranges_are_disjoint_and_complete():
    ordered = sorted(RANGES.values(), key=lambda seeds: seeds.start)
    assert ordered[0].start == 0 and ordered[-1].stop == 2**63
    assert all(first.stop == second.start for first, second in itertools.pairwise(ordered))
    for ends in zip(*((seeds.start, seeds.stop - 1) for seeds in ordered), strict=True):
        assert {range_of(seed) for seed in ends} == set(RANGES)


def test_streams_of_runs_and_purposes_share_no_seed():
    streams = [training_seed(run, purpose) for run in (*range(300), 900_000, 2**32 - 1) for purpose in PURPOSES]
    ordered = sorted(streams)
    assert all(second - first >= STREAM for first, second in itertools.pairwise(ordered))
    assert ordered[0] >= RANGES["training"].start and ordered[-1] + STREAM <= RANGES["training"].stop
    assert streams[:2] == [training_seed(0), training_seed(0, "imitation")]  # the same every time


def test_environments_accept_the_largest_seeds():
    last = RANGES["training"].stop - STREAM
    batch, alone = gym.make_vec("vibgym:vibgym/Align-v0", num_envs=2), gym.make("vibgym:vibgym/Align-v0")
    assert (batch.reset(seed=last)[0][1] == alone.reset(seed=last + 1)[0]).all()


@pytest.mark.parametrize("first, count", [(100_000, 1), (999_990, 20), (399_999, 2), (-1, 1), (2**64, 1)])
def test_seeds_of_other_ranges_are_refused_by_name(first, count):
    with pytest.raises(ValueError, match=f"first_seed.*400000 to 999999.*{first}"):
        check_seeds("first_seed", first, count, "selection")
    check_seeds("first_seed", 400_000, 600_000, "selection")


@pytest.mark.parametrize("bad", [-1, 0.5, None])
def test_a_run_seed_is_a_whole_number(bad):
    with pytest.raises(ValueError, match="run_seed must be a whole number >= 0"):
        training_seed(bad)

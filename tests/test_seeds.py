"""Seeds: ranges and training streams are disjoint, and every other seed is refused in one line."""

import itertools

import gymnasium as gym
import pytest

from vibgym.seeds import RANGES, STREAM, check_seeds, range_of, training_seed

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

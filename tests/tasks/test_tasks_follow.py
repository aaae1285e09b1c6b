"""Following paths: the scoring kernels against a plain reference, and starts of episodes."""

import math

import numpy as np
import pytest

from tests.tasks.helpers import Scorer, made
from vibgym import Part, Surface
from vibgym.tasks import Follow
from vibgym.tasks import paths as route
from vibgym.tasks.episode import MOTION, PREVIEW

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
STEEL = Part.rectangle(0.050, 0.040, friction=0.64)
SHORT = [{"shape": "polyline", "points_mm": [[x, 80], [x, 100]], "speed": 0.1} for x in (100, 300)]
NEAR, TURNED = 0.005, math.radians(5.0)


class FollowScorer(Scorer):
    """Scorer with the task's scoring."""

    def __init__(self, task, worlds, periods=1):
        super().__init__(task, worlds, periods)
        self.scoring = task.scoring(self.state, periods)
        self.episode, self.relations = self.scoring.episode, self.scoring.relations


class Reference:
    """One world, written from the environment's documentation."""

    def __init__(self, paths, present, pose, periods):
        self.paths, self.present, self.periods = paths, present, periods
        self.clock = self.held = self.looks = 0
        self.missed, self.squares, self.largest = False, [0.0] * len(paths), 0.0
        self.distance, self.heading_error = self.errors(pose)

    def goals(self, ahead=0):
        time = (self.clock + ahead) * SURFACE.period
        return [route.sample(path, np.array([time]))[0] for path in self.paths]

    def errors(self, pose):
        away, turned = [], []
        for k, goal in enumerate(self.goals()):
            if self.present[k]:
                away.append(math.hypot(goal[0] - pose[k, 0], goal[1] - pose[k, 1]))
                turned.append(min(abs(goal[2] - pose[k, 2] + n * math.pi) for n in range(-9, 10)))
        return np.array(away), np.array(turned)

    def step(self, pose, fallen, diverged):
        """Return terms of the parts that are present, success, and the errors along the path: root mean square and largest."""
        self.clock += self.periods
        self.looks += 1
        before, turned = self.distance, self.heading_error
        away, heading_error = self.errors(pose)
        self.distance, self.heading_error = away, heading_error
        within = (away <= NEAR) & (heading_error <= TURNED)
        inside = bool(within.all())
        ended = all(
            self.clock * SURFACE.period >= route.duration(path[0]) - 1e-12
            for path, there in zip(self.paths, self.present, strict=True)
            if there
        )
        down = fallen[self.present]
        self.held = self.held + self.periods if inside and ended and not (self.missed or down.any() or diverged) else 0
        self.missed |= not inside
        self.largest = max(self.largest, away.max())
        worst = 0.0
        for k, error in zip(np.flatnonzero(self.present), away, strict=True):
            self.squares[k] += error * error
            worst = max(worst, self.squares[k])
        success = self.held >= 10
        terms = {
            "distance": np.clip((before - away) / 0.1, -1.0, 1.0),
            "approach": np.tanh(before / 0.01) - np.tanh(away / 0.01),
            "turn": np.clip(turned - heading_error, -1.0, 1.0),
            "alignment": np.tanh(turned / 0.15) - np.tanh(heading_error / 0.15),
            "inside": 0.1 * self.periods * within,
            "time": np.full(len(away), -0.005 * self.periods),
            "success": np.full(len(away), 5.0 if success else 0.0),
            "fallen": np.where(down, -5.0, 0.0),
        }
        return terms, success, math.sqrt(worst / self.looks), self.largest


@pytest.mark.parametrize("periods", [1, 3])
def test_score_kernel(periods):
    worlds, generator = 30, np.random.default_rng(3)
    task = made(Follow, SURFACE, [BLOCK, STEEL], paths=SHORT)
    present = np.ones((worlds, 2), dtype=bool)
    present[:5, 0], present[5:10, 1] = False, False
    start = task.start(generator.random((worlds, task.draws)), present)
    scorer = FollowScorer(task, worlds, periods)
    scorer.begin(start)
    info = scorer.scoring.info()
    reference = [Reference(start.paths[w], present[w], start.pose[w], periods) for w in range(worlds)]
    seen = {"success": 0, "missed": 0, "fallen": 0}
    for step in range(40 // periods):
        now = np.array([[goal[:3] for goal in world.goals(periods)] for world in reference])
        clumsy = generator.random((worlds, 1, 1)) < 0.02
        pose = now + np.array([1e-3, 1e-3, 0.03]) * np.where(clumsy, 8.0, 0.4) * generator.standard_normal(now.shape)
        pose[..., 2] += math.pi * generator.integers(-3, 4, pose.shape[:2])
        fallen = ~present | (generator.random(present.shape) < 0.002)
        scorer.score(pose, 0.0, fallen)
        for w in range(worlds):
            terms, success, rms, largest = reference[w].step(pose[w], fallen[w], False)
            of_parts = np.zeros((2, len(terms)))
            of_parts[present[w]] = np.stack([terms[name] for name in task.TERMS], axis=1)
            of_world = [terms[name].min() if name == "fallen" else terms[name].mean() for name in task.TERMS]
            assert scorer.episode.terms[w] == pytest.approx(of_world, abs=1e-8), (step, w)
            assert scorer.episode.part_terms[w] == pytest.approx(of_parts, abs=1e-8), (step, w)
            assert scorer.episode.success[w] == success
            assert info["path_error"][w] == pytest.approx(rms, abs=1e-12)
            assert info["largest_path_error"][w] == pytest.approx(largest, abs=1e-12)
        seen["success"] += scorer.episode.success.sum()
        seen["fallen"] += scorer.episode.fallen.sum()
    seen["missed"] = sum(world.missed for world in reference)
    assert min(seen.values()) > 0


def test_goals_and_their_motion_are_those_of_the_paths():
    task = made(Follow, SURFACE, [BLOCK, STEEL], paths={"heading": "along", "speed": 0.08})
    start = task.start(np.random.default_rng(0).random((4, task.draws)))
    scorer = FollowScorer(task, 4)
    scorer.begin(start)
    for step in range(40):
        for w, k in np.ndindex(4, 2):
            times = SURFACE.period * (step + np.arange(PREVIEW + 1))
            motion = route.sample(start.paths[w, k], times)
            assert (scorer.episode.goal[w, k] == motion[0, :3]).all()
            stated = scorer.episode.motion[w, k]
            assert stated.shape == (MOTION,) and (stated[:3] == motion[0, 3:6]).all()
            assert stated[3:].reshape(PREVIEW, 3) == pytest.approx(motion[1:, :3] - motion[0, :3], abs=1e-14)
        scorer.score(scorer.episode.goal)


def test_success_requires_the_whole_path_and_ten_periods_at_its_end():
    task = made(Follow, SURFACE, [BLOCK], paths=SHORT[:1])
    start = task.start(np.full((2, 1), 0.5))
    scorer = FollowScorer(task, 2)
    scorer.begin(start)
    periods = math.ceil(task.lasts / SURFACE.period - 1e-9)
    end = route.sample(start.paths[0, 0], np.array([task.lasts]))[0, :3]
    for step in range(1, periods + 12):
        path = route.sample(start.paths[0, 0], np.array([step * SURFACE.period]))[0, :3]
        scorer.score(np.array([[path], [end]]))  # the second one jumps to the end and waits there
        assert scorer.episode.success.tolist() == [step >= periods + 9, False]


def test_parts_start_at_rest_where_their_paths_begin():
    task = Follow(SURFACE, [BLOCK, STEEL, BLOCK])
    start = task.start(np.random.default_rng(1).random((20, task.draws)))
    assert (start.pose == start.goal).all() and start.present.all()
    headings = start.pose[..., 2]
    assert np.abs(headings).max() <= math.pi and headings.std() > 1.0
    absent = task.start(np.random.default_rng(1).random((20, task.draws)), np.tile([True, False, True], (20, 1)))
    assert (absent.pose[:, 1, :2] < 0).all() and (absent.pose[:, ::2] == start.pose[:, ::2]).all()

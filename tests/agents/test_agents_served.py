"""The parts that trained agents serve."""

import json
import math
import shutil

import numpy as np
import pytest

pytest.importorskip("torch")

from agents import served
from agents.__main__ import main
from agents.served import Range, varied
from tests.policies.helpers import FRESH, HARDWARE, info_of
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.catalogue import SHIPPED, shipped_agents
from vibgym.policies.trained.trained import check_range
from vibgym.scene.parts import Part, part_from

L_SHAPE = {"shape": "polygon", "vertices": [[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]]}
HOLED = {
    "shape": "polygon", "vertices": [[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]],
    "holes": [[[0.01, 0.01], [0.03, 0.01], [0.03, 0.03], [0.01, 0.03]]],
}  # fmt: skip


@pytest.mark.parametrize("part", [
    "steel_block", {"shape": "disc", "radius": 0.02, "friction": 0.6}, {**L_SHAPE, "friction": 0.5},
    {**HOLED, "friction": 0.5, "static_friction": 0.7}, Part.rectangle(0.05, 0.03, friction=0.4, mass=0.1),
])  # fmt: skip
def test_properties_are_varied_independently(part):
    usual, other = part_from(part), part_from(varied(part, 1.5, 1.25, 0.5))
    assert other.friction == pytest.approx(1.5 * usual.friction)
    assert other.static_friction == pytest.approx(1.5 * usual.static_friction)
    assert other.radius == pytest.approx(1.25 * usual.radius) and other.area == pytest.approx(1.25**2 * usual.area)
    assert other.gyration == pytest.approx(1.25**2 * usual.gyration)
    assert other.mass == pytest.approx(0.5 * usual.mass) and other.symmetry == usual.symmetry


@pytest.mark.parametrize("part", ["steel_block", {**HOLED, "friction": 0.5, "mass": 0.1}])
def test_a_disc_in_place_of_a_part_has_its_area_and_other_properties(part):
    usual, disc = part_from(part), part_from(served.as_disc(part))
    assert disc.symmetry == 0 and disc.area == pytest.approx(usual.area) and disc.mass == usual.mass
    assert disc.friction == usual.friction and disc.height == usual.height


class Known(Range):
    """An agent that serves friction from 0.3 to 0.9 and parts of up to 60 mm, none of them four times as heavy as another."""

    def __init__(self, parts):
        self.parts, self.task, self.frequency, self.least, self.fixed = parts, "Sort", [24.0, 26.0], 0.985, {}
        self.episodes, self.count, self.worlds = served.EPISODES, served.SCENES, served.WORLDS
        self.own = self._ends([part_from(part) for part in parts])

    def measure(self, factors, episodes, first=0, **surface):
        parts = [part_from(varied(part, **factors[served.name_of(part)])) for part in self.parts]
        served_all = all(0.3 <= part.friction <= 0.9 and part.radius <= 0.06 for part in parts)
        lightest, heaviest = served.ends([part.mass for part in parts])
        return np.full(episodes, float(served_all and heaviest < 4.0 * lightest))


def test_an_agent_for_any_hardware_plays_on_both_in_turn(tmp_path, monkeypatch):
    played = []

    class Played:
        def __init__(self, seeds):
            self.success, self.steps = np.array(seeds) % 4 == 0, np.array(seeds)

        def reported(self, name):
            return np.full(len(self.steps), np.nan)

    def play(policy, task, seeds, **scene):
        played.append(("actuators" in scene, scene.get("max_episode_steps"), list(seeds)))
        return Played(seeds)

    monkeypatch.setattr(served, "rollout", play)
    agent = Range(SHIPPED / "swap.json", tmp_path)
    first = served.FIRST_SEED
    assert played == [(kind == 1, None, list(range(first + kind, first + served.EPISODES, 2))) for kind in (0, 1)]
    played.clear()
    success, steps = agent.play({}, 3, 5)
    assert [seeds for _, _, seeds in played] == [[first + 6], [first + 5, first + 7]]
    assert steps.tolist() == [first + 5, first + 6, first + 7]
    assert success.tolist() == [(first + k) % 4 == 0 for k in (5, 6, 7)]
    # Later than three times the usual is too late: a jam of several parts would last to the task's limit.
    assert {limit for _, limit, _ in played} == {math.ceil(3.0 * np.quantile(np.arange(first, first + 60, 4), 0.99))}


def test_ranges_end_where_episodes_fail():
    ranges = Known(["steel_block", "aluminium_block"]).together()
    assert 0.3 * 0.999 <= ranges["friction"][0] < 0.45 and 0.7 < ranges["friction"][1] <= 0.9 * 1.001
    assert 0.032 < ranges["radius"][1] <= 0.06 * 1.001 and ranges["radius"][0] < 0.02
    # Alone, both masses vary by the same factor; drawn together their ratio counts as well.
    low, high = ranges["mass"]
    assert low <= 0.0628 and 0.0945 <= high < 6.0 * low


def test_a_lucky_round_is_not_enough():
    """All episodes of the first seeds succeed; the ranges end where those with other seeds fail."""

    class Lucky(Known):
        def measure(self, factors, episodes, first=0, **surface):
            known = super().measure(factors, episodes, first, **surface)
            return known if first >= served.EPISODES + served.SCENES * served.WORLDS else np.ones(episodes)

    lucky = Lucky(["steel_block"])
    assert lucky.alone()["friction"][1] > 2.0
    ranges = lucky.together()
    assert ranges["friction"][1] <= 0.9 * 1.05 and ranges["radius"][1] <= 0.06 * 1.05


def test_an_agent_that_serves_its_own_parts_alone():
    class Own(Known):
        def measure(self, factors, episodes, first=0, **surface):
            same = all(value == 1.0 for of in factors.values() for value in of.values())
            return np.full(episodes, float(same))

    policy = Own(["steel_block", "aluminium_block"])
    assert policy.together() == {name: list(span) for name, span in policy.own.items()}


@pytest.mark.full
def test_the_command_stores_the_ranges_and_nothing_else(tmp_path, monkeypatch, capsys):
    tensors = json.loads((SHIPPED / "align.json").read_text())["tensors"]
    for file in (SHIPPED / "align.json", SHIPPED / tensors):
        shutil.copy(file, tmp_path)
    monkeypatch.setattr(served, "EPISODES", 8)
    monkeypatch.setattr(served, "SCENES", 6)
    path = tmp_path / "align.json"
    before = json.loads(path.read_text())
    assert main(["range", str(path)]) == 0
    after = json.loads(path.read_text())
    found = after.pop("range")
    assert (
        found.keys() == {"parts", "discs"} and found["parts"].keys() == {"friction", "radius"} and before.pop("range")
    )
    assert after == before and "discs: friction" in capsys.readouterr().out
    assert main(["range", str(tmp_path / "none.json")]) == 2
    before = path.read_bytes()
    assert main(["range", str(path), "--check", "4"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sorted(line.split(": ")[1] for line in lines) == ["discs", "parts"] and all(
        "of the episodes succeed" in line and "; 4 scenes, 0 refused" in line for line in lines
    )
    assert path.read_bytes() == before
    assert main(["range", str(path), "--check", "0"]) == main(["range", str(path), "--check", "75001"]) == 2
    record = json.loads(path.read_text())
    path.write_text(json.dumps({name: value for name, value in record.items() if name != "range"}))
    assert main(["range", str(path), "--check", "4"]) == 2


@pytest.mark.full
def test_pushers_which_are_discs_have_the_ranges_of_all_parts(monkeypatch):
    """Replacing all parts by discs would measure another task, which fails, and the agent would refuse its own pushers."""
    monkeypatch.setattr(
        Range, "play", lambda self, factors, episodes, *rest, **scene: (np.ones(episodes), np.ones(episodes))
    )
    monkeypatch.setattr(Range, "together", lambda self: {name: list(span) for name, span in self.own.items()})
    ranges = served.measured(SHIPPED / "push-joint.json")
    assert ranges.keys() == {"parts"}
    for task in ("Push", "PushAny", "PushShapes"):
        check_range("it", ranges, served.kinds_in(task))


OUTSIDE = {"shape": "disc", "radius": 0.09, "friction": 0.05}


@pytest.mark.parametrize(
    "task, hardware", [("Align", {}), ("Align", HARDWARE), ("Transport", {}), ("Rotate", HARDWARE)]
)
def test_agents_refuse_parts_that_they_cannot_move_and_say_which(task, hardware):
    for part, name in ((OUTSIDE, "friction"), ({**OUTSIDE, "friction": 0.6, "radius": 0.1}, "radius")):
        info = info_of(task, parts=[part], **hardware)
        with pytest.raises(ValueError, match=rf"^{name} of part 'disc' must be [\d.]+ to [\d.]+, .*, got [\d.]+$"):
            make_policy("learned", info)
        assert make_policy("pose", info).predict


def test_discs_have_ranges_of_their_own():
    """Discs of 10 mm succeed in Align, blocks of that size cannot be turned; the agent of Rotate does not serve such discs."""
    small = {"shape": "disc", "radius": 0.01, "friction": 0.6}
    assert rollout("learned", "Align", seeds=range(FRESH, FRESH + 40), parts=[small]).success.mean() >= 0.95
    for task, part in (
        ("Align", {"shape": "rectangle", "length": 0.016, "width": 0.011, "friction": 0.6}),
        ("Rotate", small),
    ):
        with pytest.raises(ValueError, match="^radius of part|^part 'disc' must be no disc"):
            make_policy("learned", info_of(task, parts=[part]))


def test_agents_of_one_part_state_ranges_and_all_ranges_contain_the_parts_of_their_tasks():
    stated = [agent for agent in shipped_agents() if agent.range is not None]
    assert {agent.path for agent in shipped_agents() if agent.parts == 1} <= {agent.path for agent in stated}
    for agent in stated:
        for task in agent.tasks:
            check_range(str(agent.path), {"parts": agent.range["parts"]}, served.kinds_in(task))


@pytest.mark.full
@pytest.mark.parametrize("name", ["align", "align-element", "transport-prototype", "rotate", "swap"])
def test_agents_succeed_in_random_scenes_inside_their_ranges(name, tmp_path):
    """At least 97 % are meant to succeed: fewer than 92 % of 200 are improbable."""
    stated = json.loads((SHIPPED / f"{name}.json").read_text())["range"]
    whole = Range(SHIPPED / f"{name}.json", tmp_path)
    for agent, ranges in ((whole, stated["parts"]), (whole.with_discs(), stated["discs"])):
        if ranges is not None:
            scenes = agent.scenes(ranges, np.random.default_rng(FRESH), 200, 1, served.CHECKING + 2000)
            rate = served.outcomes(list(scenes))
            assert len(rate) > 100 and rate.mean() >= 0.92 * min(1.0, agent.least / served.SUCCESS)


def test_the_range_of_a_file_is_checked(tmp_path):
    record = json.loads((SHIPPED / "align.json").read_text())
    shutil.copy(SHIPPED / record["tensors"], tmp_path)
    info = info_of("Align")
    assert isinstance(info, TaskInfo)
    for wrong, message in (
        ([0.1, 2.0], "range"), ({"friction": [0.1, 2.0]}, "range"), ({"parts": None}, "range.parts"),
        ({"parts": {"speed": [0.0, 1.0]}}, "range.parts"), ({"parts": {"friction": 0.5}}, "range.parts.friction"),
        ({"parts": {"friction": [0.5]}}, "friction"), ({"parts": {"friction": ["a", "b"]}}, "friction"),
        ({"parts": {"friction": [math.nan, 1.0]}}, "range.parts.friction"),
        ({"parts": {}, "discs": {"friction": [2.0, 1.0]}}, "range.discs.friction"),
        ({"parts": {"friction": [0.1, 0.5]}}, "^friction of part"),
    ):  # fmt: skip
        (tmp_path / "align.json").write_text(json.dumps({**record, "range": wrong}))
        with pytest.raises(ValueError, match=message):
            make_policy(str(tmp_path / "align.json"), info)


def test_discs_are_refused_where_none_are_served():
    disc, block = part_from(OUTSIDE), part_from("steel_block")
    check_range("it", {"parts": {"friction": [0.1, 1.0]}, "discs": None}, [block])
    with pytest.raises(ValueError, match="^part 'disc' must be no disc, with which it fails, got 'a disc'$"):
        check_range("it", {"parts": {"friction": [0.01, 1.0]}, "discs": None}, [block, disc])
    check_range("it", {"parts": {"friction": [0.01, 1.0]}}, [block, disc])

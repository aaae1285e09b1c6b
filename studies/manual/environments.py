"""A page for each registered environment, from its code: task, actions, observations, rewards, baselines."""

from __future__ import annotations

import inspect
import re
from typing import Any

import gymnasium as gym
import numpy as np

from agents.evaluation.table import markdown
from studies.manual import open_tasks
from studies.manual.figures_file import ROOT, table
from studies.manual.published import BOUND, ERRORS, ONE, SEVERAL, TIME, TOGETHER, report
from studies.manual.trained import HEADS, lines_of
from vibgym import checks
from vibgym.envs import ACTIONS, OBSERVATIONS, VibgymEnv
from vibgym.registration import ENVIRONMENTS
from vibgym.tasks.episode import QUANTITIES

ACTION_MEANINGS = {
    "element": "amplitude and phase of every element",
    "phasor": "amplitude x (cos, sin) phase of every element",
    "patch": "the same of the elements around each part",
    "field": "strengths of six basic fields around each part",
    "wrench": "wanted acceleration of each part, x, y and angular, in units of what the elements can give",
}

TERM_MEANINGS = {
    "distance": "by how much the mean distance has shrunk, per 100 mm",
    "approach": "by how much tanh(mean distance / 10 mm) has shrunk",
    "turn": "by how much the mean heading error has shrunk, per rad",
    "alignment": "by how much tanh(heading error / 0.15 rad) has shrunk",
    "inside": "change of the share of parts whose centre is at its goal",
    "within": "1 while all parts are where and as they should be",
    "clearance": "change of the mean of min(distance to the nearest part / what is asked, 1)",
    "time": "-1 every period",
    "success": "1 on success",
    "fallen": "-1 if a part has fallen",
    "good": "1 for a part that has left as it should",
    "faulty": "-1 for a part that has left otherwise",
}
"""Of each of :data:`vibgym.tasks.episode.QUANTITIES`."""

if TERM_MEANINGS.keys() != set(QUANTITIES):
    raise RuntimeError(f"words are missing for {sorted(TERM_MEANINGS.keys() ^ set(QUANTITIES))}")


def as_markdown(text: str) -> str:
    """A paragraph of a docstring in Markdown: roles and literals as code."""
    text = re.sub(r":\w+:`~?\.?(?:[\w.]*\.)?(\w+)`", r"`\1`", text)
    return re.sub(r"``(.+?)``", r"`\1`", text).replace("|", "\\|")


PATHS = ("path_error_median_m", "heading_error_median_rad")


def baselines(name: str) -> str:
    """Tables of all that is known of ``vibgym/<name>-v0``, with their dates, or where to get figures."""
    pieces = [*_reported(name), *_scored(name), *_trained(name)]
    if not pieces:
        return (
            f'None are published. `vibgym.policies.rollout("planner", "vibgym/{name}-v0", seeds=range(100))` '
            "plays the planner's, and takes any other policy."
        )
    return "\n\n".join(pieces)


def _reported(name: str) -> list[str]:
    """Of ``results/report``: a table for each machine."""
    found = []
    for hardware in dict.fromkeys(place.hardware for place in report().places if place[:2] == ("report", name)):
        names = (TIME, BOUND, *ERRORS) if name in ONE else TOGETHER if name in SEVERAL else PATHS
        found.append(
            f"On *{hardware}* hardware (`make report`, {report().day}):\n\n{table(report(), [name], hardware, names)}"
        )
    return found


def _scored(name: str) -> list[str]:
    """Of ``results/open``: one table for both machines."""
    table = open_tasks.of(name)
    head = f"One of the [open tasks](../open-tasks.md) (`python -m agents score`, {open_tasks.found()}):"
    return [f"{head}\n\n{table}"] if table else []


def _trained(name: str) -> list[str]:
    """Of ``results/agents.csv``."""
    lines = lines_of(name)
    head = "Agents that were [trained](../trained.md) for it, each training on fresh episodes:"
    return [f"{head}\n\n{markdown(HEADS, lines)}"] if lines else []


DOCS = ROOT / "docs"
INFO_MEANING = {
    "is_success": "whether the episode has succeeded",
    "position_error": "largest distance of a part to its goal or zone, or what the smallest distance between parts lacks, m",
    "heading_error": "largest heading error, rad",
    "clearance": "smallest distance between parts, m; negative: overlap",
    "touching": "pairs of parts closer than 0.1 mm",
    "parts_done": "parts within tolerance",
    "fallen": "whether a part has fallen off the surface",
    "diverged": "whether the simulation has diverged",
}
BEGIN = """```python
import gymnasium as gym
import vibgym

env = gym.make("vibgym/{name}-v0")
observation, info = env.reset(seed=0)
```"""
REWARD = """The sum of these terms, which `info["reward_terms"]` has one by one.
`task_settings={"weights": ...}` changes their weights."""


def pages() -> dict[str, str]:
    """Markdown of every registered environment, by the name of its page."""
    return {name: page(name) for name in ENVIRONMENTS}


def page(name: str) -> str:
    """Markdown of the environment ``vibgym/<name>-v0``."""
    env: Any = gym.make(f"vibgym/{name}-v0").unwrapped
    assert isinstance(env, VibgymEnv)
    asked, further = _asked(env)
    pieces = [
        f"# {name}",
        f"`vibgym/{name}-v0`" + (f": the task `{env.task.name}`" if env.task.name != name else ""),
        film(name),
        asked,
        *further,
        *_more(env),
        BEGIN.format(name=name),
        "## The scene",
        _scene(name, env),
        "## Actions",
        f"Flat boxes in [-1, 1], float32; the default is `{_default('action')}`.",
        _actions(env),
        "## Observations",
        _observations(env),
        "### The state",
        _state(env),
        "### By parts",
        _rows(env),
        "## Reward",
        REWARD,
        _rewards(env),
        "## Information",
        _information(env),
        "## Baselines",
        baselines(name),
    ]
    return "\n\n".join(pieces) + "\n"


def film(name: str) -> str:
    """The picture at the top of a page."""
    path = DOCS / "films" / f"{name}.webp"
    if not path.exists():
        raise checks.refuse("films", str(path), "a film of every environment: python -m studies.manual films")
    return f"![An episode of {name} under a shipped policy](../films/{name}.webp)"


def _asked(env: VibgymEnv) -> tuple[str, list[str]]:
    """What the task asks: its docstring up to its arguments."""
    text = inspect.getdoc(type(env.task)) or ""
    first, *others = re.split(
        r"\n\n", re.split(r"^(?:Args|Attributes|Raises):$", text, maxsplit=1, flags=re.M)[0].strip()
    )
    return as_markdown(first), [as_markdown(each) for each in others]


def _more(env: VibgymEnv) -> list[str]:
    task = env.task.name
    own = DOCS / f"{task.lower()}.md"
    return [f"More of the task, its laws and figures: [{task}](../{task.lower()}.md)."] if own.exists() else []


def _scene(name: str, env: VibgymEnv) -> str:
    limit, settings = ENVIRONMENTS[name]
    task, parts = env.task, env.parts
    kinds = [part.name for part in parts]
    lines = [
        ["parts", ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))],
        ["walls", ", ".join(settings.get("walls", ())) or "none"],
        ["limit", f"{limit} periods ({limit * env.surface.period:g} s)"],
        ["success", "none: parts come and go" if task.flows else f"all parts done for {task.hold} periods in a row"],
    ]
    tolerance = task.tolerances()[task.asked]
    if task.has_goal and len(tolerance):
        heading = np.degrees(tolerance[0, 1])
        within = f"{1e3 * tolerance[0, 0]:g} mm" + (f" and {heading:g} deg" if np.isfinite(heading) else "")
        lines.append(["done", f"within {within} of the goal"])
    if np.isfinite(task.speed_limit):
        lines.append(["slow enough", f"below {1e3 * task.speed_limit:g} mm/s"])
    if np.isfinite(task.apart):
        lines.append(["apart", f"at least {1e3 * task.apart:.1f} mm"])
    return markdown(("what", "here"), lines)


def _default(argument: str) -> str:
    return {"action": "element", "observation": "state"}[argument]


def _actions(env: VibgymEnv) -> str:
    lines = []
    for name, action in ACTIONS.items():
        made = action(env.surface, env.parts)
        lines.append([f"`{name}`", str(tuple(made.shape)), str(made.size), ACTION_MEANINGS[name]])
    return markdown(("`action=`", "shape", "numbers", "meaning"), lines)


def _observations(env: VibgymEnv) -> str:
    lines = []
    for name, observation in OBSERVATIONS.items():
        if name == "camera":
            continue  # set by the sensor, for all tasks
        try:
            lines.append([f"`{name}`", *_space(observation(env.task).space)])
        except checks.Refused:
            lines.append([f"`{name}`", "–", "not of this task"])
    seen = 'what the camera sees, with `sensor="camera"`: [hardware](../hardware.md)'
    lines.append(["`camera`", "the camera's lines and columns", seen])
    return markdown(("`observation=`", "shape", "of"), lines)


def _space(space: gym.Space) -> tuple[str, str]:
    if isinstance(space, gym.spaces.Dict):
        return "dictionary", ", ".join(f"`{key}` {each.shape}" for key, each in space.items())
    return str(space.shape), f"{space.dtype}"


def _state(env: VibgymEnv) -> str:
    block = [each for each in env.observation_layout if each.part == 0]
    size = sum(each.width for each in block)
    lines = [
        [", ".join(str(each.start + k) for k in range(each.width)), each.name, each.meaning, each.unit]
        for each in block
    ]
    table = markdown(("index", "feature", "meaning", "unit of 1"), lines)
    slots = env.task.slots
    blocks = (
        "" if slots == 1 else f" The observation has {slots} such blocks, part p in block p, from number {size} x p on."
    )
    return f"`env.unwrapped.observation_layout` says the same with scales and ranges.{blocks}\n\n{table}"


def _rows(env: VibgymEnv) -> str:
    """Rows of ``observation="parts"``: own features, then those of the nearest neighbour; the others have the same."""
    lines = [
        [", ".join(str(each.start + k) for k in range(each.width)), each.name, each.meaning, each.unit]
        for each in env.parts_layout
        if not each.name.startswith("neighbour_") or each.name.startswith("neighbour_1_")
    ]
    several = any(each.name.startswith("neighbour_2_") for each in env.parts_layout)
    more = " The features of `neighbour_1` are repeated for the other nearest parts." if several else ""
    return (
        "Each part has a row, relative to itself, in units that do not depend on the surface's size; rows of absent parts "
        f"are 0. `env.unwrapped.parts_layout` lists the same with scales and ranges.{more}\n\n"
        + markdown(("index", "feature", "meaning", "unit of 1"), lines)
    )


def _information(env: VibgymEnv) -> str:
    lines = [[f"`{name}`", INFO_MEANING[name]] for name in env.task.FACTS]
    return "Besides `reward_terms` and `parts`:\n\n" + markdown(("`info`", "meaning"), lines)


def _rewards(env: VibgymEnv) -> str:
    task = env.task
    lines = [[term, TERM_MEANINGS[task.made_of[term]], f"{weight:g}"] for term, weight in task.weights.items()]
    return markdown(("term", "what it counts, at most 1 in magnitude", "weight"), lines)

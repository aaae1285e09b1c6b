"""A page for each registered environment, generated from its code: task, actions, observations, rewards, baselines."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np

from agents.evaluation.table import markdown
from studies.manual import open_tasks
from studies.manual.figures_file import DOCS, table
from studies.manual.published import (
    AGENT_HEADS,
    BOUND,
    ERRORS,
    ONE,
    PATH_ERRORS,
    SEVERAL,
    SEVERAL_PARTS,
    TIME,
    agent_lines,
    report,
)
from vibgym import checks
from vibgym.envs import ACTIONS, OBSERVATIONS, VibgymEnv
from vibgym.registration import ENVIRONMENTS
from vibgym.tasks.episode import QUANTITIES

ACTION_MEANINGS = {
    "element": "amplitude and phase of every element",
    "phasor": "amplitude x (cos, sin) phase of every element",
    "patch": "amplitude x (cos, sin) phase of the elements around each part",
    "field": "strengths of six basic fields around each part",
    "wrench": "linear (x, y) and angular acceleration of each part, over the largest that the elements can produce",
    "velocity": "signed square root of the velocity and spin of each part at the end of a step, over 5/6 of the table speed",
    "target": "signed square root of the displacement (x, y) and turn to go, over 0.12 m and 90 degrees",
}


def as_markdown(text: str) -> str:
    """Convert a paragraph of a docstring to Markdown: roles and literals become code."""
    text = re.sub(r":\w+:`~?\.?(?:[\w.]*\.)?(\w+)`", r"`\1`", text)
    return re.sub(r"``(.+?)``", r"`\1`", text).replace("|", "\\|")


def baselines(name: str) -> str:
    """Return the tables of published results of ``vibgym/<name>-v0``, or the command that evaluates a policy."""
    names = (TIME, BOUND, *ERRORS) if name in ONE else SEVERAL_PARTS if name in SEVERAL else PATH_ERRORS
    pieces = [
        f"On *{hardware}* hardware (`make report`, {report().day}):\n\n{table(report(), [name], hardware, names)}"
        for hardware in dict.fromkeys(place.hardware for place in report().places if place[:2] == ("report", name))
    ]
    if scores := open_tasks.of(name):
        head = f"Scores as one of the [open tasks](../open-tasks.md) (`python -m agents score`, {open_tasks.date()}):"
        pieces.append(f"{head}\n\n{scores}")
    if lines := agent_lines(name):
        head = "[Trained agents](../trained.md), each training run evaluated on new episodes:"
        pieces.append(f"{head}\n\n{markdown(AGENT_HEADS, lines)}")
    return "\n\n".join(pieces) or (
        f'No results are published. `vibgym.policies.rollout("planner", "vibgym/{name}-v0", seeds=range(100))` '
        "evaluates the planner or any other policy."
    )


INFO_MEANING = {
    "is_success": "whether the episode has succeeded",
    "position_error": "largest distance of a part to its goal or zone, or shortfall of the smallest gap if larger, m",
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
REWARD = """The reward is the weighted sum of these terms. `info["reward_terms"]` has each weighted term.
`task_settings={"weights": ...}` changes the weights."""


def page(name: str) -> str:
    """Return the Markdown page of ``vibgym/<name>-v0``."""
    env: Any = gym.make(f"vibgym/{name}-v0").unwrapped
    assert isinstance(env, VibgymEnv)
    summary, details = _description(env)
    pieces = [
        f"# {name}",
        f"`vibgym/{name}-v0`" + (f": the task `{env.task.name}`" if env.task.name != name else ""),
        film(name),
        summary,
        *details,
        *_link(env),
        BEGIN.format(name=name),
        "## Scene",
        _scene(name, env),
        "## Actions",
        "Action spaces are flat float32 boxes in [-1, 1]. The default is `element`.",
        _actions(env),
        "## Observations",
        "The default is `state`.",
        _observations(env),
        "### Features of `state`",
        _state(env),
        "### Features of `parts`",
        _rows(env),
        "## Reward",
        REWARD,
        _rewards(env),
        "## Info",
        _information(env),
        "## Baselines",
        baselines(name),
    ]
    return "\n\n".join(pieces) + "\n"


def film(name: str) -> str:
    """Return the image at the top of a page."""
    path = DOCS / "films" / f"{name}.webp"
    if not path.exists():
        raise checks.refuse("films", str(path), "an existing file (python -m studies.manual films writes it)")
    return f"![An episode of {name} with a shipped policy](../films/{name}.webp)"


def _description(env: VibgymEnv) -> tuple[str, list[str]]:
    """Return the first paragraph of the task's docstring, and the others before its arguments."""
    text = inspect.getdoc(type(env.task)) or ""
    first, *others = re.split(
        r"\n\n", re.split(r"^(?:Args|Attributes|Raises):$", text, maxsplit=1, flags=re.M)[0].strip()
    )
    return as_markdown(first), [as_markdown(other) for other in others]


def _link(env: VibgymEnv) -> list[str]:
    task = env.task.name
    path = DOCS / f"{task.lower()}.md"
    if env.core.shapes is not None:
        return ["Parts have shapes that are drawn for each episode: [shapes](../shapes.md)."]
    return [f"Details, controllers and results: [{task}](../{task.lower()}.md)."] if path.exists() else []


def _scene(name: str, env: VibgymEnv) -> str:
    limit, settings = ENVIRONMENTS[name]
    task, parts = env.task, env.parts
    names = [part.name for part in parts]
    library = set() if env.core.shapes is None else {part.name for part in env.core.shapes.library}
    drawn = [name for name in dict.fromkeys(names) if name in library]
    kinds = [f"of drawn shape {drawn.index(name) + 1}" if name in drawn else name for name in names]
    success = f"all parts done for {task.hold} consecutive periods"
    if task.continuous_feed:
        success = "none: parts arrive and leave continuously"
    lines = [
        ["parts", ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))],
        *([["split of the shapes", f"{settings['split']} (`split=`)"]] if "split" in settings else []),
        ["walls", ", ".join(settings.get("walls", ())) or "none"],
        ["time limit", f"{limit} periods ({limit * env.surface.period:g} s)"],
        ["success", success],
    ]
    tolerance = task.tolerances()[task.scored]
    if task.has_goal and len(tolerance):
        heading = np.degrees(tolerance[0, 1])
        within = f"{1e3 * tolerance[0, 0]:g} mm" + (f" and {heading:g} deg" if np.isfinite(heading) else "")
        lines.append(["tolerance", f"{within} of the goal"])
    if np.isfinite(task.speed_limit):
        lines.append(["speed limit of a part that is done", f"{1e3 * task.speed_limit:g} mm/s"])
    if np.isfinite(task.apart):
        lines.append(["distance between parts", f"at least {1e3 * task.apart:.1f} mm"])
    return markdown(("property", "value"), lines)


def _actions(env: VibgymEnv) -> str:
    lines = []
    for name, action in ACTIONS.items():
        if name == "patch" and env.core.shapes is not None:
            lines.append([f"`{name}`", "–", "–", "not available: the size depends on the shape"])
            continue
        made = action(env.surface, env.parts)
        lines.append([f"`{name}`", str(tuple(made.shape)), str(made.size), ACTION_MEANINGS[name]])
    return markdown(("`action=`", "shape", "size", "meaning"), lines)


def _observations(env: VibgymEnv) -> str:
    lines = []
    for name, observation in OBSERVATIONS.items():
        if name == "camera":
            continue  # its shape depends on the sensor
        try:
            lines.append([f"`{name}`", *_space(observation(env.task).space)])
        except checks.Refused:
            lines.append([f"`{name}`", "–", "not available for this task"])
    image = 'image, requires `sensor="camera"`: [hardware](../hardware.md)'
    lines.append(["`camera`", "(camera rows, camera columns)", image])
    return markdown(("`observation=`", "shape", "type or content"), lines)


def _space(space: gym.Space) -> tuple[str, str]:
    if isinstance(space, gym.spaces.Dict):
        return "dictionary", ", ".join(f"`{key}` {box.shape}" for key, box in space.items())
    return str(space.shape), f"{space.dtype}"


def _features(entries: Iterable[Any]) -> str:
    """Return the table of a layout's features."""
    lines = [
        [", ".join(str(entry.start + k) for k in range(entry.width)), entry.name, entry.meaning, entry.unit]
        for entry in entries
    ]
    return markdown(("index", "feature", "meaning", "unit of 1"), lines)


def _state(env: VibgymEnv) -> str:
    block = [row for row in env.observation_layout if row.part == 0]
    size, slots = sum(row.width for row in block), env.task.slots
    blocks = (
        f" The observation has {slots} blocks of {size} values. Block p, from index {size} x p on, describes part p."
    )
    head = "`env.unwrapped.observation_layout` lists these features with scales and ranges."
    return f"{head}{'' if slots == 1 else blocks}\n\n{_features(block)}"


def _rows(env: VibgymEnv) -> str:
    """Return the table of features of ``observation="parts"``: of the part, then of its nearest neighbour."""
    first = [row for row in env.parts_layout if not re.match("neighbour_(?!1_)", row.name)]
    several = any(row.name.startswith("neighbour_2_") for row in env.parts_layout)
    more = (
        " The features of `neighbour_1` are repeated for the other neighbours, in order of distance." if several else ""
    )
    return (
        "Each part has one row, in units that do not depend on the surface's size. Its neighbours are relative to it. Rows of "
        f"absent parts are 0. `env.unwrapped.parts_layout` lists these features with scales and ranges.{more}\n\n"
        + _features(first)
    )


def _information(env: VibgymEnv) -> str:
    lines = [[f"`{name}`", INFO_MEANING[name]] for name in env.task.info_fields]
    return "In addition to `reward_terms` and `parts`:\n\n" + markdown(("`info`", "meaning"), lines)


def _rewards(env: VibgymEnv) -> str:
    task = env.task
    lines = [[term, QUANTITIES[task.made_of[term]], f"{weight:g}"] for term, weight in task.weights.items()]
    definition = "of each part; a world's term is the mean over its parts ([definition](../extending.md#a-reward))"
    return f"Terms {definition}:\n\n" + markdown(("term", "meaning (magnitude at most 1)", "weight"), lines)

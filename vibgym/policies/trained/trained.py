"""A trained policy: a small network in NumPy, loaded from safetensors and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import Surface, checks
from vibgym.envs.actions import actions_by_part
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import CODES, Coding
from vibgym.policies.trained.networks.acting import ACTING, ACTIVATIONS
from vibgym.policies.trained.pictures import PictureCoding
from vibgym.policies.trained.state_policy import NETWORK as STATE
from vibgym.policies.trained.state_policy import StatePolicy, state_policy
from vibgym.policies.trained.storage import as_float32, load_set

KIND = "vibgym-policy"
VERSION = 2
"""Of the files; those of version 1 held networks that read the flat state."""

CODINGS: Mapping[str, type[Coding] | type[PictureCoding]] = {
    "parts": Coding,
    "elements": Coding,
    "pixels": PictureCoding,
}
"""What a network reads, by its name."""

ANY = "any"
"""Of a surface, or a number of parts, that a policy file may leave open."""
RESIDUAL = "residual"
"""Under which the file of a correction names what it corrects: its base policy and the scale."""
ELEMENTS = "elements"


class TrainedPolicy:
    """A network trained on observations by parts, or on images; acts by its mean, unless it is asked to explore.

    Args:
        tensors: of the network, float32, under the names that :mod:`vibgym.policies.trained.networks.acting` wants.
        network: among :data:`vibgym.policies.trained.networks.acting.ACTING`.
        activation: of the hidden layers, ``"tanh"`` or ``"relu"``.
        coding: of the environment.
        seed: of the exploration.
    """

    def __init__(
        self,
        tensors: Mapping[str, np.ndarray],
        network: str,
        activation: str,
        coding: Coding | PictureCoding,
        seed: int = 0,
    ) -> None:
        self.tensors, self.network, self.activation, self.coding = tensors, ACTING[network], activation, coding
        self.action, self.observation = coding.action, coding.observation
        self.generator = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions in [-1, 1] for one observation or a batch; the state is what was seen last."""
        seen = self.coding.see(observation, state, episode_start)
        of_parts, log_std = self.network(self.tensors, self.coding.shape, self.activation, seen.rows)
        if not deterministic:
            noise = self.generator.standard_normal(of_parts.shape, dtype=np.float32)
            of_parts = of_parts + np.exp(log_std) * noise
        actions = self.coding.actions(seen, np.clip(of_parts, -1.0, 1.0).astype(np.float32))
        return (actions[0] if self.coding.single(observation) else actions), seen


def described(surface: Surface) -> dict[str, Any]:
    """A surface as policy files have it."""
    return {name: getattr(surface, name) for name in ("rows", "columns", "element_size", "frequency")}


def load_trained(path: Path, info: TaskInfo) -> TrainedPolicy | StatePolicy:
    """Load a policy file and check that it fits.

    Raises:
        ValueError: not a policy file, corrupted, not finite in float32, made for another task, surface, number of parts,
            observation or size of action, or a correction, which is no policy without its base.
    """
    tensors, record = load_set(path, KIND, VERSION)
    if record.get(RESIDUAL) is not None:
        raise checks.conflict(f"{path} corrects a base policy: load it as {{'kind': 'residual', 'path': ...}}")
    return network_of(str(path), tensors, record, info)


def network_of(
    name: str, tensors: dict[str, np.ndarray], record: dict[str, Any], info: TaskInfo
) -> TrainedPolicy | StatePolicy:
    """The network of a policy file.

    Args:
        name: of the file.
        tensors, record: what it holds.
        info: task and scene, with the rows that the network reads.

    Raises:
        ValueError: see :func:`load_trained`.
    """
    tasks = record.get("tasks")
    if not isinstance(tasks, list) or info.name not in tasks:
        raise checks.refuse(f"{name}: tasks", tasks, f"a list with {info.name!r}")
    for what, mine in (("surface", described(info.surface)), ("parts", len(info.parts))):
        theirs = record.get(what)
        if theirs not in (ANY, mine) or isinstance(theirs, bool):  # True would be 1 part
            raise checks.refuse(f"{name}: {what}", theirs, f"{mine!r}, as this scene has it")
    if record.get("network") == STATE:
        return state_policy(name, tensors, record, info)
    tensors = as_float32(name, tensors)
    action = checks.choice(f"{name}: action", record.get("action"), (*actions_by_part(), *CODES))
    network = checks.choice(f"{name}: network", record.get("network"), tuple(ACTING))
    activation = checks.choice(f"{name}: activation", record.get("activation"), tuple(ACTIVATIONS))
    columns = record.get("columns")
    if not isinstance(columns, list) or not all(isinstance(each, list) and len(each) == 2 for each in columns):
        raise checks.refuse(f"{name}: columns", columns, "a list of names and widths")
    with checks.within(name):
        flags = (checks.flag(each, record.get(each)) for each in ("turned", "remembers"))
        coding = CODINGS[network](info.surface, info.parts, info.parts_layout, action, columns, *flags)
    if network == ELEMENTS and not coding.shape.has_elements:
        raise checks.refuse(f"{name}: network", network, "'parts', or an action of elements and the column 'element'")
    policy = TrainedPolicy(tensors, network, activation, coding)
    _try(name, policy)
    return policy


def _try(name: str, policy: TrainedPolicy) -> None:
    """Let it act once: tensors that are missing or of other shapes show.

    Raises:
        ValueError: they do.
    """
    shape, parts = policy.coding.shape, len(policy.coding.parts)
    rows = np.zeros((1, parts, shape.columns), dtype=policy.coding.dtype)
    try:
        with np.errstate(all="ignore"):
            mean, log_std = policy.network(policy.tensors, shape, policy.activation, rows)
        if mean.shape != (1, parts, shape.action) or log_std.shape != mean.shape:
            raise ValueError(f"actions of shape {mean.shape[2:]}")
    except (KeyError, ValueError, IndexError, TypeError) as error:
        allowed = f"those of a network for rows of {shape.columns} numbers and actions of {shape.action} ({error})"
        raise checks.refuse(f"{name}: tensors", sorted(policy.tensors), allowed) from None

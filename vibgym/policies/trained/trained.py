"""Trained policies: small networks in NumPy, loaded from safetensors and JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import Part, Surface, checks
from vibgym.envs.actions import actions_by_part
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import CODES, Coding, ImageCoding
from vibgym.policies.trained.flow import FlowPolicy
from vibgym.policies.trained.joint import JointCoding
from vibgym.policies.trained.networks import ACTING, ACTIVATIONS, Acting, Tensors
from vibgym.policies.trained.storage import as_float32, load_set
from vibgym.policies.trained.symmetry import Symmetry
from vibgym.settings import BaseSettings

KIND = "vibgym-policy"
VERSION = 2
"""Of policy files; in version 1 networks read the flat state."""

ANY = "any"
"""Value of ``surface``, of its rows and columns, or of ``parts`` in a policy file that serves all of them."""

FREQUENCY = 0.04
"""Relative difference of a machine's frequency from that of training within which a policy still serves it: no machine has
exactly the nominal one. Tests of shipped agents at 24 and 26 Hz are in tests/policies/trained."""

RESIDUAL = "residual"
"""Key of a policy file that names the base policy and the scale of a correction."""

RANGE = "range"
"""Key of a policy file with the parts that it serves, see :func:`check_range`."""

RANGES, PARTS, DISCS = ("friction", "radius", "mass"), "parts", "discs"
"""Properties in these ranges, and keys of the ranges of parts and of discs."""

ROUNDING = 0.006
"""Relative rounding of stored ranges."""

FLOW = "flow"
"""Key of a policy file with the settings of a :class:`.flow.FlowPolicy`."""

CODINGS: dict[str, type[Coding]] = {
    "parts": Coding,
    "joint": JointCoding,
    "elements": Coding,
    "pixels": ImageCoding,
}
"""Conversion by the name of a network."""


def mean_of_scenes(
    network: Acting, symmetry: Symmetry, tensors: Tensors, shape: Any, activation: str, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and log std of a network, averaged over equivalent scenes."""
    mean, log_std = network(tensors, shape, activation, symmetry.rows(rows))
    return symmetry.mean(mean), symmetry.spread(log_std)


class TrainedPolicy:
    """A network that reads observations by parts, or images; the deterministic action is its mean.

    Args:
        tensors: of the network, float32, under torch's names.
        network: among :data:`vibgym.policies.trained.networks.ACTING`.
        activation: of the hidden layers, ``"tanh"`` or ``"relu"``.
        coding: of the environment.
        symmetric: whether the network is averaged over equivalent scenes, see :attr:`.coding.Coding.symmetry`.
    """

    def __init__(
        self, tensors: Mapping[str, np.ndarray], network: str, activation: str, coding: Coding, symmetric: bool = False
    ) -> None:
        self.tensors, self.network, self.activation, self.coding = tensors, network, activation, coding
        act, symmetry = ACTING[network], coding.symmetry if symmetric else None
        self._act = act if symmetry is None else partial(mean_of_scenes, act, symmetry)
        self.action, self.observation = coding.action, coding.observation
        self.generator = np.random.default_rng(0)  # of the exploration

    def outputs(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and log std (worlds, parts, values) for rows (worlds, parts, columns)."""
        return self._act(self.tensors, self.coding.shape, self.activation, rows)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions in [-1, 1] for one observation or a batch; the state is the network's inputs."""
        inputs = self.coding.encode(observation, state, episode_start)
        of_parts, log_std = self.outputs(inputs.rows)
        if not deterministic:
            noise = self.generator.standard_normal(of_parts.shape, dtype=np.float32)
            of_parts = of_parts + np.exp(log_std) * noise
        actions = self.coding.decode(inputs, np.clip(of_parts, -1.0, 1.0).astype(np.float32))
        return (actions[0] if self.coding.single(observation) else actions), inputs


def described(surface: Surface) -> dict[str, Any]:
    """Return a surface as policy files have it."""
    return {name: getattr(surface, name) for name in ("rows", "columns", "element_size", "frequency")}


def serves_surface(record: Any, surface: Surface) -> bool:
    """Return whether the ``surface`` of a policy file includes this one, its frequency within :data:`FREQUENCY`.

    Args:
        record: :data:`ANY`, or a mapping as of :func:`described`, of numbers, ranges ``[low, high]``, or :data:`ANY`.
        surface: of the scene.
    """
    mine = described(surface)
    if not isinstance(record, dict) or record.keys() != mine.keys():
        return bool(record == ANY)
    stated = record["frequency"]
    if isinstance(stated, int | float) and abs(surface.frequency - stated) <= FREQUENCY * stated:
        mine["frequency"] = stated
    return all(
        spec[0] <= mine[name] <= spec[1] if isinstance(spec, list) and len(spec) == 2 else spec in (ANY, mine[name])
        for name, spec in record.items()
    )


class Trained:
    """Maker of policies from files."""

    class Settings(BaseSettings):
        """Settings of a trained policy."""

        path: str | Path
        """JSON file; ``{task}`` in it stands for the task's name in lower case."""

    def __new__(cls, info: TaskInfo, settings: Settings) -> Any:
        """Load the policy; see :func:`load_trained`."""
        return load_trained(file_of(settings.path, info), info)


def file_of(path: str | Path, info: TaskInfo) -> Path:
    """Return the file at a path in which ``{task}`` stands for the task's name in lower case.

    Raises:
        ValueError: a model of Stable-Baselines3.
    """
    if str(path).endswith(".zip"):
        reason = "a model of Stable-Baselines3 is loaded by its own load(), and given as {'policy': model}"
        raise checks.conflict(f"policy.path {str(path)!r}: {reason}")
    return Path(str(path).replace("{task}", info.name.lower()))


def check_range(name: str, ranges: Any, parts: Sequence[Part]) -> None:
    """Check that a policy serves parts.

    Args:
        name: of the policy or its file, for errors.
        ranges: ``{"parts": {"friction": [lowest, highest], "radius": ..., "mass": ...}, "discs": {...}}``, in m and kg;
            properties that are not stated do not matter. Discs have ranges of their own, since they need not turn; those of all
            parts, if they have none, and None if the policy does not serve discs. None: nothing is stated.
        parts: of the scene.

    Raises:
        ValueError: a part that is not served, or ranges of another form.
    """
    if ranges is None:
        return
    if not isinstance(ranges, dict) or PARTS not in ranges or not ranges.keys() <= {PARTS, DISCS}:
        raise checks.refuse(f"{name}: {RANGE}", ranges, f"a mapping with {PARTS!r} and {DISCS!r}")
    for kind, spans in ranges.items():
        if kind == DISCS and spans is None:
            continue
        if not isinstance(spans, dict):
            raise checks.refuse(f"{name}: {RANGE}.{kind}", spans, f"a mapping of {', '.join(RANGES)}")
        for of, ends in spans.items():
            checks.choice(f"{name}: {RANGE}.{kind}", of, RANGES)
            numbers = isinstance(ends, list) and len(ends) == 2 and all(isinstance(end, float | int) for end in ends)
            if not (numbers and ends[0] <= ends[1]):
                raise checks.refuse(f"{name}: {RANGE}.{kind}.{of}", ends, "[lowest, highest]")
    for part in parts:
        spans = ranges.get(DISCS, ranges[PARTS]) if part.symmetry == 0 else ranges[PARTS]
        if spans is None:
            raise checks.refuse(f"part {part.name!r}", "a disc", f"no disc, with which {name} fails")
        for of, (low, high) in spans.items():
            value = getattr(part, of)
            if not low * (1.0 - ROUNDING) <= value <= high * (1.0 + ROUNDING):
                served = f"{low:g} to {high:g}, for which {name} succeeds"
                raise checks.refuse(f"{of} of part {part.name!r}", float(value), served)


def load_trained(path: Path, info: TaskInfo) -> TrainedPolicy | FlowPolicy:
    """Load a policy file and check that it fits.

    Raises:
        ValueError: not a policy file, damaged, not finite in float32, of another task, surface, number of parts, observation
            or size of action, or a correction, which requires its base policy.
    """
    tensors, record = load_set(path, KIND, VERSION)
    if record.get(RESIDUAL) is not None:
        raise checks.conflict(f"{path} corrects a base policy: load it as {{'kind': 'residual', 'path': ...}}")
    return network_of(str(path), tensors, record, info)


def network_of(
    name: str, tensors: dict[str, np.ndarray], record: dict[str, Any], info: TaskInfo
) -> TrainedPolicy | FlowPolicy:
    """Return the network of a policy file.

    Args:
        name: of the file.
        tensors, record: contents of the file.
        info: task and scene, with the rows that the network reads.

    Raises:
        ValueError: see :func:`load_trained`.
    """
    tasks = record.get("tasks")
    if not isinstance(tasks, list) or info.name not in tasks:
        raise checks.refuse(f"{name}: tasks", tasks, f"a list with {info.name!r}")
    surface, parts = record.get("surface"), record.get("parts")
    if not serves_surface(surface, info.surface):
        raise checks.refuse(f"{name}: surface", surface, f"{described(info.surface)!r}, as this scene has it")
    if parts not in (ANY, len(info.parts)) or isinstance(parts, bool):  # True would be 1 part
        raise checks.refuse(f"{name}: parts", parts, f"{len(info.parts)!r}, as this scene has it")
    check_range(name, record.get(RANGE), info.parts)
    network = checks.choice(f"{name}: network", record.get("network"), tuple(ACTING))
    action = checks.choice(f"{name}: action", record.get("action"), (*actions_by_part(), *CODES))
    columns = record.get("columns")
    tensors = as_float32(name, tensors)
    activation = checks.choice(f"{name}: activation", record.get("activation"), tuple(ACTIVATIONS))
    if not isinstance(columns, list) or not all(isinstance(column, list) and len(column) == 2 for column in columns):
        raise checks.refuse(f"{name}: columns", columns, "a list of names and widths")
    with checks.within(name):
        memory: Any = {"history": record.get("history"), "history_columns": record.get("history_columns", ())}
        memory["turned"] = checks.flag("turned", record.get("turned"))
        coding = CODINGS[network](info.surface, info.parts, info.parts_layout, action, columns, **memory)
    symmetric = checks.flag(f"{name}: symmetric", record.get("symmetric", False))
    if symmetric and coding.symmetry is None:
        raise checks.refuse(f"{name}: symmetric", True, f"False with network {network!r}")
    if network == "elements" and not coding.shape.has_elements:
        raise checks.refuse(f"{name}: network", network, "'parts', or an action of elements and the column 'element'")
    flow = record.get(FLOW)
    if flow is None:
        policy: TrainedPolicy | FlowPolicy = TrainedPolicy(tensors, network, activation, coding, symmetric)
    else:
        with checks.within(name):
            policy = FlowPolicy(tensors, network, coding, flow)
    _try(name, policy)
    return policy


def _try(name: str, policy: TrainedPolicy | FlowPolicy) -> None:
    """Evaluate the network once.

    Raises:
        ValueError: tensors are missing or have other shapes.
    """
    shape, parts = policy.coding.shape, len(policy.coding.parts)
    rows = np.zeros((1, parts, shape.columns), dtype=policy.coding.dtype)
    try:
        with np.errstate(all="ignore"):
            outputs = policy.outputs(rows)
        if any(output.shape != (1, parts, shape.action) for output in outputs):
            raise ValueError(f"actions of shape {outputs[0].shape[2:]}")
    except (KeyError, ValueError, IndexError, TypeError) as error:
        allowed = f"those of a network for rows of {shape.columns} numbers and actions of {shape.action} ({error})"
        raise checks.refuse(f"{name}: tensors", sorted(policy.tensors), allowed) from None

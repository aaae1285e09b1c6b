"""What the tests of learned policies share: policies of random numbers, on disk and in memory, without a training."""

from pathlib import Path
from typing import Any

import numpy as np

from tests.policies.helpers import info_of
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.networks import Shape
from vibgym.policies.trained.storage import save_set
from vibgym.policies.trained.trained import KIND, VERSION, described

HIDDEN, ATTENTION = 5, 4


def coding_for(info: TaskInfo, action: str = "field", **settings: Any) -> Coding:
    """How a network reads and acts in a scene."""
    return Coding(info.surface, info.parts, info.parts_layout, action, **settings)


def actor_tensors(shape: Shape, seed: int = 0) -> dict[str, np.ndarray]:
    """Of a small actor for parts, under torch's names."""
    generator = np.random.default_rng(seed)
    layers = {}
    if shape.neighbours:
        layers["eyes.attention.encode"] = (ATTENTION, shape.width)
        layers["eyes.attention.key"] = (ATTENTION, ATTENTION)
        layers["eyes.attention.query"] = (ATTENTION, shape.own)
    seen = shape.own + (ATTENTION if shape.neighbours else 0)
    layers |= {"hidden.0": (HIDDEN, seen), "mean": (shape.action, HIDDEN), "log_std": (shape.action, HIDDEN)}
    tensors = {}
    for name, size in layers.items():
        tensors[f"{name}.weight"] = generator.normal(0.0, 0.4, size).astype(np.float32)
        tensors[f"{name}.bias"] = generator.normal(0.0, 0.4, size[0]).astype(np.float32)
    tensors["log_std.weight"][:], tensors["log_std.bias"][:] = 0.0, -1.0
    return tensors


def policy_file(
    folder: Path, info: TaskInfo | None = None, tensors: dict[str, np.ndarray] | None = None, **changes: Any
) -> Path:
    """A policy file with random weights for a scene, by default Align's; ``changes`` replace entries of its record."""
    info = info_of("Align") if info is None else info
    coding = coding_for(info)
    record = {
        "tasks": [info.name],
        "surface": described(info.surface),
        "parts": len(info.parts),
        "columns": coding.columns,
        "turned": False,
        "history": False,
        "action": "field",
        "network": "parts",
        "activation": "tanh",
    }
    path = folder / "policy.json"
    save_set(path, KIND, actor_tensors(coding.shape) if tensors is None else tensors, record | changes, VERSION)
    return path


def observations(coding: Coding, worlds: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Rows of random numbers in the form of observations by parts, all parts there."""
    generator, parts = np.random.default_rng(seed), len(coding.parts)
    width = sum(size for _, size in coding.columns)
    rows = generator.uniform(-1, 1, (worlds, parts, width)).astype(np.float32)
    return {"parts": rows, "mask": np.ones((worlds, parts), dtype=np.int8)}

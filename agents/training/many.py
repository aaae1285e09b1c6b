"""The same training with many seeds, side by side."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from agents.training.train import train
from agents.training.training_file import load_settings
from agents.workers import side_by_side
from vibgym import checks


def train_seeds(
    config: Path,
    seeds: Sequence[int],
    output: Path | None = None,
    quiet: bool = False,
    agent: str | None = None,
    processes: int = 1,
    ray: str | None = None,
) -> list[Path]:
    """Train as :func:`agents.training.train.train` does, once with each seed; what comes of one depends on no other.

    Args:
        config, agent, quiet: see there; the progress shown is that of whole trainings.
        seeds: of the trainings.
        output: directory in which every seed has one of its own, ``seed-0`` and so on; None: as the file says.
        processes: side by side on this machine.
        ray: address of a cluster, see :func:`agents.workers.cluster.on_ray`; None: on this machine.

    Returns:
        Paths of the policies' files, in the order of the seeds.

    Raises:
        ValueError: bad settings, or a seed that is there twice; see :func:`agents.training.train.train` for the rest.
    """
    for seed in seeds:
        if list(seeds).count(seed) > 1:
            raise checks.refuse("--seeds", seed, "each seed once")
    folders = [_folder(config, agent, seed, output) for seed in seeds]
    with side_by_side(processes, ray) as submit, contextlib.closing(tqdm(total=len(seeds), disable=quiet)) as bar:
        bar.set_description("training seeds")
        asked = []
        for seed, folder in zip(seeds, folders, strict=True):
            future = submit(train, config, folder, True, None, agent, seed)
            future.add_done_callback(lambda _: bar.update())
            asked.append(future)
        return [each.result() for each in asked]


def _folder(config: Path, agent: str | None, seed: int, output: Path | None) -> Path:
    """Of one seed's run."""
    settings = load_settings(config, agent, seed)
    if output is not None:
        return output / f"seed-{seed}"
    if agent is not None and settings.output is not None:
        return Path(settings.output)  # which says the seed
    return Path(settings.output or Path("runs") / config.stem) / f"seed-{seed}"

"""How fast episodes are recorded: ``python -m studies.benchmarks.recording``.

1000 episodes of the law "pose" on Align, as ``configs/recordings/align.yaml`` says: played alone, written alone, and both as
the command does it, where everything counts from the making of the environments to the data set's name. Then Minari reads it
all back. Kernels are compiled beforehand.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import minari

from agents.recording.play import Recorder
from agents.recording.record import kept_in, record
from agents.recording.record_settings import load_settings
from agents.recording.storage import FILE, write
from studies.benchmarks import common

CONFIG = Path("configs/recordings/align.yaml")


def main() -> None:
    """Record several times, and print medians."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    settings = load_settings(asked.config)
    steps, played, written, recorded, read = 0, [], [], [], []
    for _ in Recorder(settings.model_copy(update={"episodes": 10})).episodes():
        pass  # kernels
    for _ in range(asked.rounds):
        began = time.perf_counter()
        episodes = list(Recorder(settings).episodes())
        played.append(time.perf_counter() - began)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / FILE).touch()
            began = time.perf_counter()
            write(Path(folder), episodes)
            written.append(time.perf_counter() - began)
        with tempfile.TemporaryDirectory() as folder:
            _, steps, seconds = record(settings.model_copy(update={"directory": folder}), quiet=True)
            recorded.append(seconds)
            with kept_in(folder):
                began = time.perf_counter()
                data = minari.load_dataset(settings.dataset)
                assert sum(len(each.rewards) for each in data.iterate_episodes()) == steps
                read.append(time.perf_counter() - began)
    print(f"{settings.episodes} episodes, {steps} steps, {os.cpu_count()} cores; medians of {asked.rounds}")
    for name, seconds in (
        ("played", played),
        ("written", written),
        ("played and recorded", recorded),
        ("read back", read),
    ):
        print(f"{name}: {statistics.median(seconds):.2f} s, {steps / statistics.median(seconds):.0f} steps/s")


if __name__ == "__main__":
    main()

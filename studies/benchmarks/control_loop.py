"""Jitter of the control loop at 25 Hz: ``python -m studies.benchmarks.control_loop [--minutes 20]``.

A simulated machine runs in real time in a second process, the control loop in this one, with a loopback TCP socket between
them. Align has another goal after each success, Sort goes on. Columns: time from one measurement to the next; time from a
measurement to its command, and the processor time of that; cycles without a new command; stops of the watchdog; growth of this
process's memory after the first tenth of the cycles. Runs are recorded. Targets: below 10 ms from a measurement to its command
in 99.9 % of the cycles, no growth of memory in an hour.

On a busy host, give both processes priority: ``chrt -f 10 python -m ...``.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from studies import common
from studies.kept import show
from vibgym.hardware import ControlLoop, SocketDriver

RATE = 25  # Hz
MACHINE = {"actuators": "prototype", "sensor": {"kind": "pose", "delay": 1, "estimator": "model"}}
CASES: dict[str, tuple[str, Any, dict[str, Any]]] = {
    "Align, `pose`": ("Align", "pose", {"action": "velocity"}),
    "Align, learned": ("Align", "learned", {}),
    "Sort, `pose`": ("Sort", "pose", {"action": "velocity"}),
}
"""Task, policy, and arguments of its environment."""

TARGET = 10.0  # ms
CHUNK = 1500
"""Cycles of the longest run, a minute."""


class Machine:
    """A machine in another process."""

    def __init__(self, task: str) -> None:
        options = ["--port", "0", "--seed", "0", "--settings", json.dumps(MACHINE)]
        command = [sys.executable, "-m", "vibgym", "machine", task, *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline().rpartition(":")[2])

    def connect(self) -> SocketDriver:
        """Return a new connection."""
        return SocketDriver("127.0.0.1", self.port, timeout=5.0)


class Clock:
    """Wall clock of a control loop that also notes the processor time of its calls: received, sent, received, ..."""

    def __init__(self) -> None:
        self.processor, self.calls = np.zeros(2 * CHUNK + 8), 0

    def __call__(self) -> float:
        self.processor[self.calls] = time.thread_time()
        self.calls += 1
        return time.perf_counter()

    def computing(self, cycles: int) -> np.ndarray:
        """Return processor times (cycles,) of the last run, s, and begin again."""
        self.calls = 0
        return self.processor[1 : 2 * cycles : 2] - self.processor[0 : 2 * cycles : 2]


def memory() -> float:
    """Return the resident memory of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * resource.getpagesize() / 2**20


def measure(task: str, policy: Any, settings: dict[str, Any], cycles: int) -> list[str]:
    """Run a policy for this number of cycles, and return the cells of its row."""
    machine, clock = Machine(task), Clock()
    try:
        driver = machine.connect()
        loop = ControlLoop(driver, task, policy, clock=clock, **MACHINE, **settings)
        clock.calls = 0
        period, computing, processor = np.zeros((3, cycles))
        done, missed, runs, stops, before = 0, 0, 0, [], None
        with TemporaryDirectory() as folder:
            while done < cycles:
                most = min(CHUNK, cycles - done)
                path = Path(folder) / "run.npz"
                outcome = loop.run(most, seed=runs, beyond=task == "Sort", record=path)
                n = outcome.cycles
                outcome.period[:1] = np.nan  # a run begins within a cycle
                here = slice(done, done + n)
                period[here], computing[here], processor[here] = outcome.period, outcome.computing, clock.computing(n)
                done, missed, runs = done + n, missed + outcome.missed, runs + 1
                if outcome.reason not in ("success", "cycle limit"):
                    stops.append(outcome.reason)
                    last = f"computing {1e3 * outcome.computing[-3:]} ms, periods {1e3 * outcome.period[-3:]} ms"
                    print(f"{task}, cycle {done}: {outcome.reason}; {last}", flush=True)
                    driver.close()
                    driver = loop.env.core.driver = machine.connect()
                if before is None and done >= cycles // 10:
                    before, since = memory(), done
        driver.close()
    finally:
        machine.process.kill()
        machine.process.communicate()
    assert before is not None
    growth, hours = memory() - before, (done - since) / RATE / 3600.0
    low, middle, high = 1e3 * np.nanquantile(period, [0.001, 0.5, 0.999])
    shares = 1e3 * np.quantile(computing, [0.5, 0.99, 0.999])
    below = 100.0 * np.mean(1e3 * computing < TARGET)
    return [
        f"{done}", f"{middle:.2f} ({low:.1f} to {high:.1f})", ", ".join(f"{share:.2f}" for share in shares), f"{below:.2f} %",
        ", ".join(f"{1e3 * took:.2f}" for took in np.quantile(processor, [0.5, 0.999])), f"{missed}", f"{len(stops)} of {runs}",
        f"{growth:+.1f} ({growth / max(hours, 1e-9):+.0f} per hour)",
    ]  # fmt: skip


def main() -> None:
    """Measure every case."""
    parser = common.parser(__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="of real time, in equal parts for all cases")
    parser.add_argument("--only", nargs="+", default=list(CASES), choices=list(CASES))
    asked = parser.parse_args()
    cycles = max(int(asked.minutes * 60.0 * RATE / len(asked.only)), 50)
    lines = [[name, *measure(*CASES[name], cycles)] for name in asked.only]
    heads = (
        "", "cycles", "period, ms (99.8 %)", "computing, ms (50, 99, 99.9 %)", f"below {TARGET:g} ms",
        "processor, ms (50, 99.9 %)", "missed cycles", "stops of runs", "memory, MiB",
    )  # fmt: skip
    print(f"load of this host: {os.getloadavg()[0]:.1f} processes on {os.cpu_count()} threads")
    show("control-loop", heads, lines, asked.keep)


if __name__ == "__main__":
    main()

"""Parallel execution with joblib: processes of this machine (loky) or a Ray cluster (``ray.util.joblib``).

Results do not depend on where or in how many processes the work is done.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import joblib
import numba
from filelock import FileLock
from joblib.externals.loky.process_executor import BrokenProcessPool

import vibgym
from vibgym import checks
from vibgym.files import reason, write_atomically
from vibgym.imports import take_part, taking_part
from vibgym.kernels.jit import cache_folder
from vibgym.simulation.threads import MOST, available_threads
from vibgym.warm import warm

Result = TypeVar("Result")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", MOST)
"""Environment variables that limit the threads of numerical libraries and of vibgym."""

ATTEMPTS = 5
"""How often work starts whose process was killed: a killed process breaks the whole pool."""

ONE_BY_ONE: dict[str, Any] = {"batch_size": 1}
"""Calls take seconds to hours: no batches."""

TOKEN = (
    "set RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN to the output of 'ray get-auth-token' where the cluster was started, or "
    "RAY_AUTH_TOKEN_PATH to a file with it"
)


def usable(workers: int) -> int:
    """Return ``workers``, at most the number of processors that this process may use."""
    return min(workers, available_threads())


def run(
    function: Callable[..., Result],
    items: Sequence[tuple[Any, ...]],
    *,
    workers: int = 1,
    ray: str | None = None,
    done: Callable[[int], object] = lambda count: None,
) -> list[Result]:
    """Return ``[function(*item) for item in items]``, computed in parallel.

    With one worker and without Ray everything runs in this process. Work whose process was killed starts again.

    Args:
        function: picklable; an exception that it raises is raised here.
        items: arguments of each call.
        workers: processes of this machine, at most one per processor; processors are shared among them.
        ray: address of a Ray cluster: ``"local"`` (started for this call), ``"auto"`` (running on this machine) or
            ``host:port``. Nodes must see the same files under the same paths; each call has one thread.
        done: called with the number of calls that have finished since its last call.

    Raises:
        ValueError: no cluster answers at ``ray``, or it rejects the token.
        ModuleNotFoundError: Ray is not installed.
    """
    workers = usable(workers)
    if ray is not None:
        with _cluster(ray, workers):
            return _on_ray(function, items, done)
    if workers > 1:
        return _in_processes(function, items, done, workers)
    results = []
    for item in items:
        results.append(function(*item))
        done(1)
    return results


def _in_processes(function: Any, items: Sequence[tuple[Any, ...]], done: Any, workers: int) -> list[Any]:
    results: list[Any] = []
    threads, context = str(max(available_threads() // workers, 1)), (os.getcwd(), taking_part())
    for attempt in range(ATTEMPTS):
        todo = [joblib.delayed(_call)(context, function, item) for item in items[len(results) :]]
        try:
            with joblib.parallel_config(backend="loky", initializer=_limit_threads, initargs=(threads,)):
                for result in joblib.Parallel(n_jobs=workers, return_as="generator", **ONE_BY_ONE)(todo):
                    results.append(result)
                    done(1)
            return results
        except BrokenProcessPool:
            if attempt == ATTEMPTS - 1:
                raise
    return results


def _limit_threads(threads: str) -> None:
    """Initialise a worker process: limit its threads, exit quietly on Ctrl-C, and exit when its parent has been killed."""
    os.environ.update(dict.fromkeys(THREADS, threads))
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_exit_with, args=(os.getppid(),), daemon=True).start()


def _exit_with(parent: int) -> None:
    """Exit when the parent process has ended: a restarted command needs the directories that this process has locked."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _on_ray(function: Any, items: Sequence[tuple[Any, ...]], done: Any) -> list[Any]:
    class Reporting(joblib.Parallel):
        def print_progress(self) -> None:
            done(self.n_completed_tasks - reported[0])
            reported[0] = self.n_completed_tasks

    reported, context = [0], (os.getcwd(), taking_part())
    calls = [joblib.delayed(_call)(context, function, item, True) for item in items]
    with joblib.parallel_config(backend="ray"):
        return list(Reporting(n_jobs=-1, pre_dispatch="all", **ONE_BY_ONE)(calls))


def _call(
    context: tuple[str, tuple[str, ...]], function: Any, arguments: tuple[Any, ...], compile_first: bool = False
) -> Any:
    """Call a function in the directory of the command, with the modules of its ``--import``."""
    directory, modules = context
    os.chdir(directory)
    take_part(modules)
    if compile_first:
        compile_once()
    return function(*arguments)


@contextlib.contextmanager
def _cluster(address: str, workers: int) -> Iterator[None]:
    """Connect to a Ray cluster, or start one for ``"local"``."""
    import ray
    from ray.exceptions import AuthenticationError
    from ray.util.joblib import register_ray

    _check_answers(address)
    path = os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    cache = {name: os.environ[name] for name in ("NUMBA_CACHE_DIR",) if name in os.environ}
    variables = {"PYTHONPATH": path, **cache, **dict.fromkeys((*THREADS, "NUMBA_NUM_THREADS"), "1")}
    settings: dict[str, Any] = {
        "log_to_driver": False,
        "logging_level": "ERROR",
        "runtime_env": {"env_vars": variables},
    }
    if address == "local":
        settings |= {"num_cpus": workers, "include_dashboard": False}
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # or Ray warns about its later versions
    try:
        ray.init(address=address, configure_logging=True, **settings)
    except AuthenticationError as error:
        raise checks.conflict(
            f"--ray: the cluster rejects the token ({str(error).partition('. ')[0]}); {TOKEN}"
        ) from None
    except (ConnectionError, ValueError, OSError, RuntimeError) as error:
        first = str(error).strip().partition("\n")[0]
        raise checks.refuse("--ray", address, f"the address of a running cluster ({first})") from None
    try:
        register_ray()
        yield
    finally:
        ray.shutdown()


def _check_answers(address: str) -> None:
    """Reject a ``host:port`` on which nothing listens; Ray itself retries for minutes."""
    if address in ("local", "auto"):
        return
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    allowed = "'local', 'auto' or host:port"
    if not colon or not host or not port.isdigit() or int(port) > 65535:
        raise checks.refuse("--ray", address, allowed)
    try:
        socket.create_connection((host, int(port)), 5.0).close()
    except OSError as error:
        raise checks.refuse("--ray", address, f"{allowed} of a cluster ({reason(error)})") from None


def compile_once() -> None:
    """Compile all kernels into the cache of this node, unless another process has done so; others wait meanwhile."""
    folder = cache_folder()
    if folder is None:
        return
    stamp = f"vibgym {vibgym.__version__}, numba {numba.__version__}"
    mark = Path(folder) / "warm"
    mark.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(mark.with_suffix(".lock")):
        if not mark.exists() or mark.read_text(encoding="utf-8") != stamp:
            warm(lambda text: None)
            write_atomically(mark, stamp)

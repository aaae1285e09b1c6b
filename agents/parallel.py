"""Parallel execution with joblib: processes of this machine (loky) or a Ray cluster (``ray.util.joblib``).

Results do not depend on where or in how many processes the work is done.
"""

from __future__ import annotations

import contextlib
import functools
import logging
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
from vibgym.imports import import_user_modules, user_modules
from vibgym.kernels.jit import cache_folder
from vibgym.simulation.threads import VARIABLE, available_threads
from vibgym.warm import warm

Result = TypeVar("Result")

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
        ConnectionError: worker processes were killed again and again.
        ModuleNotFoundError: Ray is not installed.
    """
    workers = usable(workers)
    call = functools.partial(_call, os.getcwd(), user_modules(), ray is not None, function)
    calls = [joblib.delayed(call)(*item) for item in items]
    if ray is not None:
        with _cluster(ray, workers):
            return _on_ray(calls, done)
    results: list[Result] = []
    threads = max(available_threads() // workers, 1)
    limits = {"inner_max_num_threads": threads, "initializer": _start_worker, "initargs": (threads,)}
    for _ in range(ATTEMPTS):
        try:
            with joblib.parallel_config(backend="loky", **limits):
                parallel: Any = joblib.Parallel(n_jobs=workers, return_as="generator", **ONE_BY_ONE)
                for result in parallel(calls[len(results) :]):
                    results.append(result)
                    done(1)
            return results
        except BrokenProcessPool:
            pass
    raise ConnectionError(f"worker processes were killed {ATTEMPTS} times; they may need more memory than there is")


def _start_worker(threads: int) -> None:
    """Limit the threads of a worker process, exit quietly on Ctrl-C, and exit when its parent has been killed."""
    os.environ[VARIABLE] = str(threads)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)  # a restarted command needs the directories that this process has locked

    threading.Thread(target=watch, daemon=True).start()


def _call(directory: str, modules: tuple[str, ...], compile_first: bool, function: Any, *arguments: Any) -> Any:
    """Call a function in the directory of the command, with the modules of its ``--import``."""
    os.chdir(directory)
    import_user_modules(modules)
    if compile_first:
        compile_once()
    return function(*arguments)


def _on_ray(calls: Sequence[Any], done: Callable[[int], object]) -> list[Any]:
    class Reporting(joblib.Parallel):  # Ray's backend has no generators
        reported = 0

        def print_progress(self) -> None:
            done(self.n_completed_tasks - self.reported)
            self.reported = self.n_completed_tasks

    with joblib.parallel_config(backend="ray"):
        return list(Reporting(n_jobs=-1, pre_dispatch="all", **ONE_BY_ONE)(calls))


@contextlib.contextmanager
def _cluster(address: str, workers: int) -> Iterator[None]:
    """Connect to a Ray cluster, or start one for ``"local"``."""
    import ray
    from ray.exceptions import AuthenticationError
    from ray.util.joblib import register_ray

    path = os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    variables = {"PYTHONPATH": path, VARIABLE: "1"}
    variables |= dict.fromkeys(joblib.parallel.ParallelBackendBase.MAX_NUM_THREADS_VARS, "1")
    variables |= {name: os.environ[name] for name in ("NUMBA_CACHE_DIR",) if name in os.environ}
    own = {"num_cpus": workers, "include_dashboard": False} if address == "local" else {}
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # or Ray warns about its later versions
    try:
        if address not in ("local", "auto"):  # where nothing listens, Ray itself retries for minutes
            host, _, port = address.removeprefix("ray://").rpartition(":")
            socket.create_connection((host, int(port)), 5.0).close()
        ray.init(
            address=address,
            log_to_driver=False,
            logging_level=logging.ERROR,
            runtime_env={"env_vars": variables},
            **own,
        )
    except AuthenticationError as error:
        first = str(error).partition(". ")[0]
        raise checks.conflict(f"--ray: the cluster rejects the token ({first}); {TOKEN}") from None
    except (ConnectionError, ValueError, OSError, OverflowError, RuntimeError) as error:
        first = reason(error).strip().partition("\n")[0]
        allowed = f"'local', 'auto' or host:port of a running cluster ({first})"
        raise checks.refuse("--ray", address, allowed) from None
    try:
        register_ray()
        yield
    finally:
        ray.shutdown()


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

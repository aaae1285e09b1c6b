"""Work on a Ray cluster."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from agents.workers.kernels import compiled
from agents.workers.local import LIBRARIES, Submit, usable
from vibgym import checks
from vibgym.files import reason
from vibgym.imports import take_part, taking_part
from vibgym.simulation.threads import MOST

TRIES = 5
"""How often a piece of work is begun whose process or node was lost."""

LOST_AFTER = 60.0
"""Seconds after which a cluster without processors is given up."""

ANSWERS_WITHIN = 5.0
"""Seconds within which something has to listen at an address."""

EVERY = 1.0
"""Seconds between two looks at the cluster."""


TOKEN = (
    "set RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN to what 'ray get-auth-token' says where the cluster was started, or "
    "RAY_AUTH_TOKEN_PATH to a file with it"
)
"""How the token of a cluster is handed on."""


class NodesLost(ConnectionError):
    """No node of the cluster that could work is left."""


class NoCluster(checks.Refused):
    """No cluster at the address that was given."""


@contextmanager
def on_ray(address: str, processes: int, lost_after: float = LOST_AFTER) -> Iterator[Submit]:
    """Gives ``submit(function, *arguments)``, which returns a future of work on a cluster.

    A piece of work takes one processor, and runs with one thread, in this directory: nodes have to see the same files under the
    same paths. Where a worker or a node is lost, its work begins again elsewhere.

    Args:
        address: ``"local"`` for one that is started here and ends with the block, ``"auto"`` for the one that runs on this
            machine, or ``host:port``.
        processes: of a cluster that is started here.
        lost_after: seconds without a processor after which :class:`NodesLost` is raised by what is still waited for.

    Raises:
        NoCluster: none answers there, or it refuses the token.
        ModuleNotFoundError: Ray is not installed.
    """
    import ray
    from ray.exceptions import AuthenticationError

    _check_answers(address)
    here = {"PYTHONPATH": os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)}
    cache = {name: os.environ[name] for name in ("NUMBA_CACHE_DIR",) if name in os.environ}
    environment = {"env_vars": {**here, **cache, **dict.fromkeys((*LIBRARIES, "NUMBA_NUM_THREADS", MOST), "1")}}
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR", "configure_logging": True}
    # Ray says at length what it will do about accelerators in some later version.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        if address == "local":
            ray.init(
                address="local",
                num_cpus=usable(processes),
                include_dashboard=False,
                runtime_env=environment,
                **quiet,
            )
        else:
            ray.init(address=address, runtime_env=environment, **quiet)
    except AuthenticationError as error:
        said = str(error).strip().partition(". ")[0]
        raise _none(address, f"a cluster that takes our token: {said}; {TOKEN}") from None
    except (ConnectionError, ValueError, OSError, RuntimeError) as error:
        said = str(error).strip().partition("\n")[0]
        allowed = f"'local', 'auto' where a cluster runs here, or the host:port of one ({said})"
        raise _none(address, allowed) from None
    watch = Watch(lost_after)
    try:
        work = ray.remote(num_cpus=1, max_retries=TRIES - 1)(_in_directory)
        directory, modules = str(Path.cwd()), taking_part()

        def submit(function: Callable[..., Any], *arguments: Any) -> Future[Any]:
            return watch.over(work.remote(directory, modules, function, arguments).future())

        yield submit
    finally:
        watch.end()
        ray.shutdown()


def _check_answers(address: str) -> None:
    """Refuse a ``host:port`` at which nothing listens: Ray itself would try for minutes.

    Raises:
        NoCluster: it is none, or nothing answers.
    """
    if address in ("local", "auto"):
        return
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    allowed = "'local', 'auto' where a cluster runs here, or the host:port of one"
    if not colon or not host or not port.isdigit() or int(port) > 65535:
        raise _none(address, allowed)
    try:
        socket.create_connection((host, int(port)), ANSWERS_WITHIN).close()
    except OSError as error:
        raise _none(address, f"{allowed} ({reason(error)})") from None


def _none(address: str, allowed: str) -> NoCluster:
    return NoCluster(str(checks.refuse("--ray", address, allowed)))


def _in_directory(
    directory: str, modules: tuple[str, ...], function: Callable[..., Any], arguments: tuple[Any, ...]
) -> Any:
    """Paths in settings are relative to the directory of the command, and a user's own modules take part as they do there."""
    os.chdir(directory)
    take_part(modules)
    compiled()
    return function(*arguments)


class Watch:
    """Futures of a cluster's, which end with an error when the cluster has had no processor for some time.

    Args:
        lost_after: s.
    """

    def __init__(self, lost_after: float) -> None:
        self.lost_after = lost_after
        self._open: set[Future[Any]] = set()
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def over(self, theirs: Future[Any]) -> Future[Any]:
        """A future that ends as ``theirs`` does, or when the cluster is lost."""
        mine: Future[Any] = Future()
        with self._lock:
            self._open.add(mine)

        def done(found: Future[Any]) -> None:
            with self._lock:
                if mine not in self._open:
                    return
                self._open.discard(mine)
            error = found.exception()
            if error is None:
                mine.set_result(found.result())
            else:  # what was raised there, as it was
                mine.set_exception(getattr(error, "cause", None) or error)

        theirs.add_done_callback(done)
        return mine

    def end(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        import ray

        seen = time.monotonic()
        while not self._over.wait(EVERY):
            try:
                if ray.cluster_resources().get("CPU", 0.0) > 0.0:
                    seen = time.monotonic()
            except Exception:
                pass
            if time.monotonic() - seen > self.lost_after:
                with self._lock:
                    lost, self._open = self._open, set()
                for each in lost:
                    each.set_exception(NodesLost(f"the cluster has had no processor for {self.lost_after:g} s"))

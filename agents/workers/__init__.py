"""Where work is done: here, in processes of this machine, or on a Ray cluster. What comes of it is the same."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from agents.workers import local
from agents.workers.cluster import NoCluster, on_ray
from agents.workers.local import Submit, on_one_thread, usable

__all__ = ["NoCluster", "Submit", "on_one_thread", "side_by_side", "usable"]


@contextmanager
def side_by_side(processes: int, ray: str | None = None) -> Iterator[Submit]:
    """Gives ``submit(function, *arguments)``, which returns a future.

    Args:
        processes: of this machine; with one all is done at once, and here.
        ray: None, or where a Ray cluster is, see :func:`agents.workers.cluster.on_ray`: work is then done there.

    Raises:
        NoCluster: none answers there, see :mod:`agents.workers.cluster`.
        ModuleNotFoundError: Ray is not installed.
    """
    if ray is None:
        with local.side_by_side(processes) as submit:
            yield submit
        return
    with on_ray(ray, processes) as submit:
        yield submit

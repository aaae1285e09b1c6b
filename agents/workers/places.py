"""One way in: ``submit(function, *arguments)`` gives a future, wherever the work is done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from agents.workers import local
from agents.workers.cluster import on_ray
from agents.workers.local import Submit


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

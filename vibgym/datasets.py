"""Data sets of Minari (extra ``data``): their directory, and new ones."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import vibgym

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable with the directory of Minari's data sets."""


@contextmanager
def kept_in(directory: str | None) -> Iterator[None]:
    """Set the directory of Minari's data sets within a block; None: unchanged."""
    before = os.environ.get(ROOT)
    if directory is not None:
        os.environ[ROOT] = os.path.abspath(directory)
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(ROOT, None)
        else:
            os.environ[ROOT] = before


def create(name: str, buffers: Sequence[Any], **settings: Any) -> Any:
    """Return a new data set of this version of vibgym, see ``minari.create_dataset_from_buffers``.

    Args:
        name: Minari's.
        buffers: of its episodes.
        settings: environment, spaces and description.
    """
    import minari

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about the missing author and permanent link
        return minari.create_dataset_from_buffers(
            name,
            list(buffers),
            code_permalink=None,
            requirements=[f"vibgym=={vibgym.__version__}"],
            jpeg_encoding=False,
            **settings,
        )

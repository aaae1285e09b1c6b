"""Sets of tensors and settings on disk, as safetensors and JSON: loading runs no code, and a kill leaves files that load.

The JSON file names its tensor file and its SHA-256, and the tensor file's name contains the hash. A new tensor file is written
beside the old one, then the JSON is replaced in one step, then the old tensors are removed.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.files import reason, write_atomically


def save_set(path: Path, kind: str, tensors: dict[str, np.ndarray], settings: dict[str, Any], version: int = 1) -> None:
    """Write ``tensors`` and ``settings`` as a set of ``kind`` under the JSON file ``path``, one process at a time.

    Raises:
        ValueError: the name does not end in ``.json``.
    """
    from safetensors.numpy import save  # of the extra "policies"

    if path.suffix != ".json":
        raise checks.refuse("path", str(path), "a name that ends in .json")
    path.parent.mkdir(parents=True, exist_ok=True)
    data = save({name: np.asarray(value, order="C") for name, value in tensors.items()})
    digest = hashlib.sha256(data).hexdigest()
    tensor_path = path.with_name(f"{path.stem}-{digest[:12]}.safetensors")
    write_atomically(tensor_path, data)
    record = {"format": kind, "version": version, "tensors": tensor_path.name, "sha256": digest, **settings}
    write_atomically(path, json.dumps(record, indent=2, sort_keys=True) + "\n")
    mine = re.compile(re.escape(path.stem) + r"-[0-9a-f]{12}\.safetensors")
    for old in list(path.parent.iterdir()):
        if mine.fullmatch(old.name) and old.name != tensor_path.name:
            old.unlink(missing_ok=True)


def as_float32(where: str, tensors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the tensors in float32.

    Raises:
        ValueError: a type that is not floating point, or values that are not finite in float32.
    """
    result = {}
    for name, value in tensors.items():
        if value.dtype.kind != "f":
            raise checks.refuse(f"{where}: tensors", f"{value.dtype} in {name}", "floating-point numbers")
        with np.errstate(over="ignore"):
            result[name] = value.astype(np.float32)
        if not np.isfinite(result[name]).all():
            raise checks.refuse(f"{where}: tensors", f"NaN or infinity in {name}", "numbers that are finite in float32")
    return result


def load_set(path: Path, kind: str, version: int = 1) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read a set.

    Raises:
        ValueError: the file is missing, not JSON, of another kind or version, or its tensors are missing or altered.
    """
    from safetensors import SafetensorError  # of the extra "policies"
    from safetensors.numpy import load

    name = str(path)
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise checks.refuse("path", name, f"a readable {kind} file ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise checks.refuse(name, f"not JSON ({error})", f"a {kind} file") from None
    if not isinstance(record, dict) or record.get("format") != kind or record.get("version") != version:
        got = {key: record.get(key) for key in ("format", "version")} if isinstance(record, dict) else type(record)
        raise checks.refuse(name, got, f"format {kind!r}, version {version}")
    file = record.get("tensors")
    if not isinstance(file, str) or Path(file).name != file or not file.endswith(".safetensors") or "\0" in file:
        raise checks.refuse(f"{name}: tensors", file, "the name of a safetensors file beside it")
    try:
        data = path.with_name(file).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: characters that file names cannot contain
        raise checks.refuse(f"{name}: tensors", file, f"a readable file beside it ({reason(error)})") from None
    if hashlib.sha256(data).hexdigest() != record.get("sha256"):
        raise checks.refuse(f"{name}: tensors", file, "the file that was saved with it (SHA-256 differs)")
    try:
        return load(data), record
    except (SafetensorError, KeyError) as error:  # KeyError: a type that NumPy does not have
        raise checks.refuse(f"{name}: tensors", f"{file} ({error})", "a whole safetensors file") from None

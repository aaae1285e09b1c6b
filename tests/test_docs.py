"""The documentation's code runs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / path).read_text(encoding="utf-8"), re.M | re.S)


@pytest.mark.parametrize(
    "path", ["docs/bound.md", "docs/control.md", "docs/extending.md", "docs/pack.md", "docs/tilting.md"]
)
def test_blocks_run_one_after_the_other(path):
    """In a process of their own, since they register names."""
    code = "\n".join(blocks(path))
    assert code
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-2000:]

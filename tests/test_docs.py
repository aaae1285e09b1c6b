"""Code blocks of the documentation run; links and commands of the README exist."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from studies.manual.build import updated_readme

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
LEARNERS = DOCS / "learners"  # run in separate environments, see tests/learners
GENERATED = (DOCS / "environments", DOCS / "generated")
README_LINES = 100

PAGES = {
    str(path.relative_to(ROOT))
    for path in [ROOT / "README.md", *DOCS.rglob("*.md")]
    if path.parent not in (LEARNERS, *GENERATED) and "```python" in path.read_text(encoding="utf-8")
}
REGISTER = {"docs/control.md", "docs/extending.md", "docs/tutorials/custom-sensor-effect.md"}
"""Pages that register names run in separate processes; the others share one."""

RUN = """
import pathlib, re, sys
for path in sys.argv[1:]:
    text = pathlib.Path(path).read_text(encoding="utf-8")
    code = "\\n".join(re.findall(r"^```python\\n(.*?)^```", text, re.M | re.S))
    print("--", path, flush=True)
    exec(compile(code, path, "exec"), {"__name__": "__main__"})
"""


@pytest.mark.parametrize(
    "pages", [*([page] for page in sorted(REGISTER)), sorted(PAGES - REGISTER)], ids=lambda it: it[0]
)
def test_code_blocks_run_in_order(pages):
    done = subprocess.run([sys.executable, "-c", RUN, *pages], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout[-300:]}\n{done.stderr[-2000:]}"
    assert re.findall(r"^-- (.+)", done.stdout, re.M) == pages


def test_the_readme_is_short_and_its_table_is_current():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= README_LINES
    assert updated_readme(text) == text


def test_links_of_the_readme_exist():
    targets = re.findall(r"\]\(([^)#]+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert targets
    missing = [target for target in targets if "://" not in target and not (ROOT / target).exists()]
    assert not missing


def test_commands_of_the_readme_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all((ROOT / path).exists() for path in re.findall(r"examples/\w+\.py", text))
    targets = set(re.findall(r"(?:^|`)make ([\w-]+)", text, re.M))
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert targets >= {"demo", "test"} and all(re.search(rf"^{target}:", makefile, re.M) for target in targets)


PAGES_WITH_FILES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
FOLDERS = "vibgym|agents|studies|tests|configs|results|examples|notebooks|docs"


@pytest.mark.parametrize("page", PAGES_WITH_FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_quoted_files_and_modules_exist(page):
    text = page.read_text(encoding="utf-8")
    files = re.findall(rf"`((?:{FOLDERS})/[\w./-]+\.(?:py|yaml|md|json|csv|ipynb))`", text)
    missing = [file for file in files if not (ROOT / file).exists()]
    modules = set(re.findall(r"python -m ((?:vibgym|agents|studies)(?:\.[a-z_]+)*)", text))
    missing += [module for module in modules if importlib.util.find_spec(module) is None]
    assert not missing

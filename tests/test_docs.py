"""Code blocks of the documentation run; links and commands of the README exist."""

import ast
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


def test_links_and_commands_of_the_readme_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [target for target in re.findall(r"\]\(([^)#]+)", text) if "://" not in target]
    files = [*links, *re.findall(r"examples/\w+\.py", text)]
    assert files and not [file for file in files if not (ROOT / file).exists()]
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


# -- terms -------------------------------------------------------------------------------------------------------------

OLD_WORDS = (
    "besides", "hand_over", r"judg\w*", "knows?", "lessons?", "lest", "noughts?", "nobody", "obeys?", "of one's own", "pupils?",
    "safe_step", "said", "sitting", "speaks?", "strayed", "take_along", "those who", "told", "what there is to", "whatever",
    "whoever", "wild", "wish(?:es|ed)?",
)  # fmt: skip
"""Words for which the documentation has plainer ones, as regular expressions."""


def docstrings(path):
    """Yield the docstrings of a module, its classes, functions and attributes."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value.value


@pytest.fixture(scope="module")
def texts():
    """Return the text of pages and modules by path, without code."""
    pages = [path for path in PAGES_WITH_FILES if path.parent not in GENERATED]
    texts = {path: re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.M | re.S) for path in pages}
    for package in ("vibgym", "agents"):
        texts |= {path: "\n".join(docstrings(path)) for path in (ROOT / package).rglob("*.py")}
    return {path: re.sub(r"`+[^`]*`+", "", text) for path, text in texts.items()}


def test_the_glossary_has_the_terms_of_pages_and_docstrings(texts):
    glossary = DOCS / "glossary.md"
    rows = re.findall(r"^\| ([^|]+) \| [^|]+ \|$", glossary.read_text(encoding="utf-8"), re.M)
    terms = [term for row in rows if row != "term" for term in row.split(", ")]
    assert len(terms) > 60 and len(set(terms)) == len(terms)
    text = "\n".join(text for path, text in texts.items() if path != glossary).lower()
    plurals = {term: r"\b" + re.sub(r"(\w)\b", r"\1s?", term) for term in terms}
    assert not [term for term, pattern in plurals.items() if not re.search(rf"{pattern}\b", text)]


def test_pages_and_docstrings_are_free_of_old_words(texts):
    old = re.compile(rf"\b(?:{'|'.join(OLD_WORDS)})\b", re.I)
    assert not [f"{path.relative_to(ROOT)}: {word}" for path, text in texts.items() for word in old.findall(text)]

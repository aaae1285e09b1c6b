"""Settings of the site: ``sphinx-build -W -b html docs runs/docs``, or ``make docs``. The build needs no network."""

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))

import vibgym  # noqa: E402

project = "vibgym"
author = "vibgym contributors"
copyright = f"{author}, MIT licence"
version = release = vibgym.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["generated", "thesis/figures.md", "**/*.txt"]
myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True
suppress_warnings = ["ref.python"]  # ``Settings`` in a signature: that of the class, which has this name in every class

html_theme = "furo"
html_title = f"vibgym {release}"
html_favicon = "_static/icon.svg"
html_static_path = ["_static"]
html_css_files = ["tables.css", "cards.css"]
html_js_files = [("films.js", {"defer": "defer"})]
templates_path = ["_templates"]
html_sidebars = {
    "**": [
        "sidebar/brand.html", "sidebar/search.html", "sidebar/scroll-start.html", "sidebar/navigation.html",
        "sidebar/scroll-end.html", "sidebar/versions.html",
    ]
}  # fmt: skip
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"top_of_page_buttons": []}
pygments_style, pygments_dark_style = "a11y-high-contrast-light", "a11y-high-contrast-dark"


def generate(app):
    """Write tables of results and pages of environments before Sphinx reads the pages."""
    from studies.manual.build import write

    write(DOCS)


ACCESSIBILITY = {
    ' role="heading"><': ' role="heading" aria-level="2"><',
    '<div class="highlight"><pre>': '<div class="highlight"><pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" role="region" aria-label="Table" class="table-wrapper',
}
"""Additions to the theme's HTML for keyboards and screen readers: levels of headings, and tables that scroll by keys."""


def complete(app, error):
    """Apply :data:`ACCESSIBILITY` to the written pages."""
    for path in Path(app.outdir).rglob("*.html") if error is None and app.builder.name == "html" else ():
        before = after = path.read_text(encoding="utf-8")
        for old, new in ACCESSIBILITY.items():
            after = after.replace(old, new)
        if after != before:
            path.write_text(after, encoding="utf-8")


def setup(app):
    """Connect the handlers."""
    from studies.manual import rest

    app.connect("builder-inited", generate)
    app.connect("build-finished", complete)
    app.connect("autodoc-process-docstring", rest.process, priority=400)  # before Napoleon

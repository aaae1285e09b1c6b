"""Pages from templates: HTML files that need nothing else."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

HOME = Path(__file__).parent


def render(template: Path, **values: Any) -> str:
    """A page from a template, which may include what lies beside it, and ``page.css`` and ``pieces.html.j2`` of this folder.

    ``inline(name)`` is the text of a script of this folder, as it is.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, HOME]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["inline"] = lambda name: Markup((HOME / name).read_text(encoding="utf-8"))
    return environment.get_template(template.name).render(**values)


def data_address(content: bytes, kind: str = "png") -> str:
    """Of a picture that is part of the page itself."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"

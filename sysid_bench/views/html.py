"""values -> one self-contained HTML page: templates filled, images inlined, no other host."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TEMPLATES = Path(__file__).parent / "templates"
MIME = {".png": "image/png", ".svg": "image/svg+xml"}


def render(template: str, **values: Any) -> str:
    """The filled template, its style inlined; every value is escaped."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    return environment.get_template(template).render(css=_css(), **values)


def _css() -> Any:
    import markupsafe

    return markupsafe.Markup((TEMPLATES / "style.css").read_text())


def data_uri(path: Path) -> str:
    """An image file as a data: address."""
    return f"data:{MIME[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def flat(tree: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested mapping -> [(dotted key, value as text)]."""
    pairs: list[tuple[str, str]] = []
    for key, value in tree.items():
        name = f"{prefix}{key}"
        pairs += flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, str(value))]
    return pairs


def write_page(path: Path, text: str) -> Path:
    """Write the page whole or not at all."""
    draft = path.with_name(path.name + ".part")
    draft.write_text(text, encoding="utf-8")
    return draft.replace(path)

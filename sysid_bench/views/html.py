"""values -> one self-contained HTML page: templates filled, images inlined, no other host."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TEMPLATES = Path(__file__).parent / "templates"
PX_PER_PT = 1.55  # 9 pt text of a figure is about as large as the page's


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


def image(path: Path, alt: str, caption: str = "") -> Mapping[str, str]:
    """What the template's figure wants of an SVG file: the data, its natural width in px, words."""
    text = path.read_text()
    points = re.search(r'width="([\d.]+)pt"', text[:2000])
    width = round(float(points[1]) * PX_PER_PT) if points else 800
    data = base64.b64encode(text.encode()).decode()
    return {"data": f"data:image/svg+xml;base64,{data}", "width": f"{width}", "alt": alt, "caption": caption}


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

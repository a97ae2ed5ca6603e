"""the papers' claims as Markdown -> papers.html beside the studies: each claim linked to the report it is judged on."""

from __future__ import annotations

import re
from pathlib import Path

from sysid_bench.views.html import render, write_page


def write_papers_page(results_dir: Path, markdown: str) -> Path:
    """Write papers.html into a results folder, from the text of `papers.page.page`."""
    import markupsafe
    from markdown_it import MarkdownIt

    body = MarkdownIt("js-default").render(markdown)  # HTML in the text is escaped
    linked = re.sub(r"<code>[^<]* experiment=([\w/]+)</code>", r'<a href="\1/report.html">\g<0></a>', body)
    page = render("papers.html", body=markupsafe.Markup(linked))
    return write_page(results_dir / "papers.html", page)

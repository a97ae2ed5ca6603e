"""results -> docs/papers.md and papers.html: the papers' claims and misprints, judged on the tables of the sweep."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from sysid_bench.asked import require
from sysid_bench.nouns import InputError


def main(cfg: dict[str, Any]) -> int:
    """Write the page, and the same as HTML beside the reports. Raises InputError, with the commands to run, where a study's table is missing."""
    from sysid_bench.papers.evidence import Tables, command
    from sysid_bench.papers.page import page, studies
    from sysid_bench.views.index import write_index_page
    from sysid_bench.views.papers_page import write_papers_page

    require(cfg, "papers", "results_dir", "out")
    results = Path(cfg["results_dir"])
    tables = Tables(results)
    missing = tables.missing(studies())
    if missing:
        commands = "\n".join(f"  {command(study)} results_dir={cfg['results_dir']}" for study in missing)
        raise InputError(
            f"{len(missing)} studies have no table under {cfg['results_dir']}; `make sweep` makes them all, or:\n{commands}"
        )
    text = page(tables)
    out = Path(cfg["out"])
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(out.name + ".part")
    part.write_text(text)
    part.replace(out)
    claims, index = write_papers_page(results, text), write_index_page(results)
    words = Counter(line.split("**")[1].rstrip(".").lower() for line in text.splitlines() if ". **" in line)
    print(f"{out}: " + ", ".join(f"{count} claims {word}" for word, count in sorted(words.items())))
    print(f"In a browser: {claims} (every claim with its numbers), {index} (every figure and report)")
    return 0

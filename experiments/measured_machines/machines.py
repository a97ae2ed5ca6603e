"""measured machines -> what the gap workflow says of them: results, figures and numbers of docs/measured_machines.md.

    SYSID_BENCH_DATA=... python experiments/measured_machines/machines.py run       # every machine, through `sysid-bench gap`
    SYSID_BENCH_DATA=... python experiments/measured_machines/machines.py figures   # docs/figures/measured_*.png
    python experiments/measured_machines/machines.py page                           # the tables of docs/measured_machines.md

Names after the verb choose machines; a machine whose data are absent is skipped by name.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE))

from convert import MACHINES, convert, data_root  # noqa: E402

RESULTS = Path(os.environ.get("RESULTS", "results")) / "measured_machines"
PAGE = ROOT / "docs" / "measured_machines.md"


def run(name: str) -> bool:
    """Convert one machine's data and hand them to the door; False where they are absent."""
    machine, root = MACHINES[name], data_root()
    if root is None or not (root / machine.folder).is_dir():
        print(
            f"{name}: skipped, its data are absent: set SYSID_BENCH_DATA to the folder that holds {machine.folder}/"
        )
        return False
    out = RESULTS / name
    given = convert(machine, root, out / "data")
    command = [
        sys.executable,
        "-m",
        "sysid_bench",
        "gap",
        f"out={out}",
        f"rules.most_on_force={machine.most}",
    ]
    begun = time.perf_counter()
    subprocess.run([*command, *(f"{k}={v}" for k, v in given.items())], check=True)
    (out / "seconds.json").write_text(json.dumps(time.perf_counter() - begun))
    return True


def answer_of(name: str) -> dict[str, Any] | None:
    """gap.json of one machine, None where it was not run."""
    path = RESULTS / name / "gap.json"
    return json.loads(path.read_text()) if path.is_file() else None


def table(name: str) -> str:
    """Markdown: what was found, one line per step, its size, and what is left."""
    values, machine = answer_of(name), MACHINES[name]
    if values is None:
        return f"(not run: {name})"
    lines = [
        f"{machine.title}. {machine.source}. Trained on {_count(machine.train)}, proven on {_count(machine.test)}.",
        "",
        "| model | force error, training | over the noise floor (rms) | size |",
        "|---|---|---|---|",
    ]
    lines += [f"| {' | '.join(row)} |" for row in _steps(values)]
    given, refitted, better, floor = (100 * x for x in values["force_gap"].values())
    lines += [
        "",
        f"Held-out force error: {given:.3g} % as given, {refitted:.3g} % refitted, **{better:.3g} %** with what was found;"
        f" noise floor {floor:.2g} % ({values['noise_floor_is']}), so what is left is {better / floor:.2g} times above it.",
    ]
    faults = [f for f in values["data"]["faults"] if f["name"] == "saturation"]
    if faults:
        share = max(f["evidence"]["share"] for f in faults)
        lines += ["", f"Fault of the data: `{faults[0]['name']}` at ±{faults[0]['parameters']['limit']:g} {machine.units[0]},"
                      f" in {len(faults)} of {len(machine.train)} records, up to {100 * share:.2g} % of the samples."]  # fmt: skip
    rivals = values["rounds"][0]["fitted"] if values["rounds"] else []
    if rivals:
        words = ", ".join(f"`{c['name']}` {c['residual_over_floor'] ** 0.5:.3g}" for c in rivals)
        lines += ["", f"Fitted side by side in the first round, times the floor left: {words}."]
    rest = [c["name"] for c in (values["rounds"][-1]["fitted"] if values["rounds"] else []) if c]
    if rest and values["rounds"][-1]["chosen"] is None:
        left = values["rounds"][-1]
        best = left["fitted"][0]
        lines += ["", f"What is left is most like: {best['name']} (would leave {best['residual_over_floor'] ** 0.5:.2g} times the floor)."]  # fmt: skip
    return "\n".join(lines)


def _count(names: tuple[str, ...]) -> str:
    return f"{len(names)} record" + ("s" if len(names) > 1 else "")


def _steps(values: dict[str, Any]) -> list[list[str]]:
    over, share = values["residual_over_floor"], values["force_share"]
    unit = share["refit"] / over["refit"] ** 0.5  # force error of one noise floor
    rows = [["M, D refitted", f"{100 * share['refit']:.3g} %", f"{over['refit'] ** 0.5:.3g}", ""]]
    sizes = {e["name"]: e for e in values["effects"]}
    for r in values["rounds"]:
        if r["chosen"]:
            name = r["chosen"]["name"]
            rho = next(c["residual_over_floor"] for c in r["fitted"] if c["name"] == name)
            rows.append(
                [f"+ `{name}`", f"{100 * unit * rho**0.5:.3g} %", f"{rho**0.5:.3g}", _size(sizes.get(name))]
            )
    return rows


def _size(effect: dict[str, Any] | None) -> str:
    if effect is None:
        return ""
    parts = []
    for key, p in effect["parameters"].items():
        if key != "speed" and key != "phase":
            spread = f" ± {2 * p['std']:.1g}" if "std" in p else ""
            unit = "" if p["unit"] == "1" else f" {p['unit']}"
            parts.append(f"{key.replace('_', ' ')} {p['value']:.4g}{spread}{unit}")
    return ", ".join(parts)


def page(names: list[str]) -> None:
    """Put the tables between the markers of docs/measured_machines.md."""
    text = PAGE.read_text()
    for name in names:
        if answer_of(name) is None:
            print(f"{name}: no results; its table stays")
            continue
        mark = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text = mark.sub(lambda m, name=name: f"{m[1]}{table(name)}\n{m[2]}", text)
    PAGE.write_text(text)


def main() -> int:
    verb, *names = sys.argv[1:] or ["run"]
    names = names or list(MACHINES)
    if verb == "run":
        done = [name for name in names if run(name)]
        print("\n\n".join(table(name) for name in done))
    elif verb == "figures":
        from figures import draw

        for name in names:
            draw(name, RESULTS / name, ROOT / "docs" / "figures")
    elif verb == "page":
        page(names)
    else:
        print(f"verbs: run, figures, page; got {verb!r}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

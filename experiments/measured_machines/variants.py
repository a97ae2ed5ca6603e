"""the measured machines as others might hand them over -> are the same effects named?

    SYSID_BENCH_DATA=... python experiments/measured_machines/variants.py

Other halves and single records, records swapped, fewer samples, a nominal model without a damper or far from the truth.
A machine whose data are absent is skipped by name.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from convert import MACHINES, data_root, records  # noqa: E402

from sysid_bench.gap.workflow import find_gap  # noqa: E402
from sysid_bench.nouns import Model, Record  # noqa: E402

Records = dict[str, Record]


@dataclass(frozen=True)
class Variant:
    """What is different; machine; records -> (training, test); nominal mass, damping; hold."""

    title: str
    machine: str
    pick: Callable[[Records], tuple[list[Record], list[Record]]]
    nominal: tuple[float, float]
    hold: str = "foh"


def part(record: Record, first: float, last: float, step: int = 1) -> Record:
    """A stretch of a record, in shares of its length; every step-th sample."""
    kept = slice(int(first * record.N), int(last * record.N), step)
    t = record.t[kept]
    return Record(t - t[0], record.u[kept], record.y[kept], hold=record.hold)


def halves(found: Records) -> tuple[list[Record], list[Record]]:
    whole = found["emps_train"]
    return [part(whole, 0, 0.5)], [part(whole, 0.5, 1)]


def thinned(found: Records) -> tuple[list[Record], list[Record]]:
    return [part(found["emps_train"], 0, 1, 2)], [part(found["emps_test_pulses"], 0, 1, 2)]


def one_each(train: str, test: str) -> Callable[[Records], tuple[list[Record], list[Record]]]:
    return lambda found: ([found[train]], [found[test]])


VARIANTS = (
    Variant("first half, proven on the second", "positioning_system", halves, (95.0, 200.0)),
    Variant("no damper in the model", "positioning_system", one_each("emps_train", "emps_test_pulses"), (100.0, 0.0)),
    Variant("trained on the pulses", "positioning_system", one_each("emps_test_pulses", "emps_train"), (95.0, 200.0)),
    Variant("every second sample", "positioning_system", thinned, (95.0, 200.0)),
    Variant("one sweep, proven on another", "flexible_link", one_each("swept1-0-10hz", "swept2-0-10hz"), (0.02, 0.3)),
    Variant("trained on trajectory A alone", "robot_axis", one_each("A", "B"), (6.0, 2.0)),
    Variant("trained on trajectory C alone", "robot_axis", one_each("C", "A"), (6.0, 2.0)),
    Variant("another nominal model, one test record", "friction_damper",
            one_each("0.25Hz30lbtension1amplitude", "0.5Hz30lbtension1amplitude"), (50.0, 1000.0)),
)  # fmt: skip


def answer(variant: Variant, root: Path) -> str:
    """One row: what was named, and the held-out force error, refitted and with it."""
    train, test = variant.pick(records(MACHINES[variant.machine], root))
    mass, damping = variant.nominal
    model = Model([[mass]], [[damping]], [[0.0]], hold=variant.hold)
    found = find_gap(train, test, model, power=False)
    faults = {f.name for f in found.check.faults}
    names = ", ".join(f"`{e.name}`" for e in found.added if e.name not in faults)
    gaps = found.force_gaps or {}
    errors = f"{100 * gaps['refitted']:.3g} % | {100 * gaps['better']:.3g} %"
    return f"| {variant.machine}: {variant.title} | {names or found.verdict.word} | {errors} |"


def main() -> None:
    root = data_root()
    print("| machine and variant | named | refitted | with it |\n|---|---|---|---|", flush=True)
    for variant in VARIANTS:
        folder = MACHINES[variant.machine].folder
        if root is None or not (root / folder).is_dir():
            print(f"{variant.machine}: skipped, set SYSID_BENCH_DATA to the folder that holds {folder}/")
            continue
        print(answer(variant, root), flush=True)


if __name__ == "__main__":
    main()

"""measured data of others -> record files and a nominal model, as `sysid-bench gap` takes them.

Data: the folder that SYSID_BENCH_DATA names. Nothing of the suite depends on it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid_bench.files import write_model
from sysid_bench.nouns import Array, Model, Record
from sysid_bench.records import write_record

INCH, KIP = 0.0254, 4448.2216  # m, N
Run = tuple[float, Array, Array]  # h s, u (N,), y (N,)


@dataclass(frozen=True)
class Machine:
    """One machine: what it is, who measured it, its records, and the model that an engineer would begin with.

    read(folder, name) -> h, u, y; nominal: mass, damping; hold: how u ran between its samples, as far as is known
    units: of force and displacement; most: effects looked for
    """

    title: str
    source: str
    folder: str
    read: Callable[[Path, str], Run]
    train: tuple[str, ...]
    test: tuple[str, ...]
    nominal: tuple[float, float]
    hold: str
    units: tuple[str, str] = ("N", "m")
    most: int = 4


def arrays(path: Path) -> dict[str, np.ndarray]:
    """What an npz file holds. Raises FileNotFoundError."""
    with np.load(path, allow_pickle=False) as file:
        return {key: file[key].squeeze() for key in file.files if key != "meta"}


def positioning(folder: Path, name: str) -> Run:
    """Command of the drive in N, motor encoder in m."""
    d = arrays(folder / f"{name}.npz")
    return 1e-3, float(d["gtau"]) * d["vir"], d["qm"]


def damper(folder: Path, name: str) -> Run:
    """Measured force in N, imposed displacement in m; means of eight samples: what rings above 64 Hz is the rig's."""
    d = arrays(folder / f"dataset-2_char_{name}.npz")
    N = len(d["disp_in"]) // 8 * 8
    u, y = (x[:N].reshape(-1, 8).mean(axis=1) for x in (KIP * d["force_kip"], INCH * d["disp_in"]))
    return 8 / 1024, u, y


def link(folder: Path, name: str) -> Run:
    """Drive command and encoder, both in counts."""
    d = arrays(folder / f"{name}.npz")
    return 2e-3, d["v"].astype(float), d["theta"].astype(float)


def axis(folder: Path, name: str) -> Run:
    """Motor torque of the first axis in N m, its angle in rad."""
    d = arrays(folder / f"traj_{name}.npz")
    return 4e-3, d["tau_Nm"][0], np.deg2rad(d["q_mot_deg"][0])


MACHINES = {
    "positioning_system": Machine(
        "Electro-mechanical positioning system (closed loop)",
        "Janot, Gautier, Brunot 2019 (EMPS)",
        "emps", positioning, ("emps_train",), ("emps_test_pulses",), (95.0, 200.0), "foh", most=5,
    ),
    "positioning_system_held": Machine(
        "The same, its input declared as held between samples",
        "Janot, Gautier, Brunot 2019 (EMPS)",
        "emps", positioning, ("emps_train",), ("emps_test_pulses",), (95.0, 200.0), "zoh", most=5,
    ),
    "friction_damper": Machine(
        "Banded rotary friction damper (displacement imposed)",
        "ARTS-Laboratory, Dataset-Friction-Damper-with-Backlash, CC BY-SA 4.0",
        "brfd_friction_backlash", damper, ("0.25Hz30lbtension1amplitude",),
        ("0.25Hz30lbtension0.5amplitude", "0.5Hz30lbtension1amplitude"), (10.0, 100.0), "foh", most=1,
    ),
    "flexible_link": Machine(
        "Single flexible link, ten repeats of one sweep",
        "ryanGT/systemid, 2009-04-21",
        "slfr_flexible_robot", link, tuple(f"swept{i}-0-10hz" for i in range(1, 7)),
        tuple(f"swept{i}-0-10hz" for i in range(7, 11)), (0.01, 0.1), "zoh", units=("count", "count"),
    ),
    "robot_axis": Machine(
        "First axis of a six-axis robot",
        "Weigand, Robot_Identification, MIT",
        "kuka_weigand", axis, ("A", "B"), ("C",), (10.0, 10.0), "foh", units=("N m", "rad"),
    ),
}  # fmt: skip


def data_root() -> Path | None:
    """The folder of the data, None where SYSID_BENCH_DATA names none."""
    root = os.environ.get("SYSID_BENCH_DATA", "")
    return Path(root) if root and Path(root).is_dir() else None


def records(machine: Machine, root: Path) -> dict[str, Record]:
    """Records by name, on an even grid of time."""
    found = {}
    for name in (*machine.train, *machine.test):
        h, u, y = machine.read(root / machine.folder, name)
        found[name] = Record(h * np.arange(len(u)), u[:, None], y[:, None], hold=machine.hold)
    return found


def nominal(machine: Machine) -> Model:
    """A free mass with a damper."""
    mass, damping = machine.nominal
    return Model([[mass]], [[damping]], [[0.0]], hold=machine.hold)


def convert(machine: Machine, root: Path, out: Path) -> dict[str, str]:
    """Write the records and model.yaml into `out`; the arguments of the door: train, test, model."""
    out.mkdir(parents=True, exist_ok=True)
    for name, record in records(machine, root).items():
        write_record(record, out / f"{name}.csv")
    write_model(nominal(machine), out / "model.yaml")

    def files(names: tuple[str, ...]) -> str:
        return ",".join(str(out / f"{name}.csv") for name in names)

    return {"train": files(machine.train), "test": files(machine.test), "model": str(out / "model.yaml")}

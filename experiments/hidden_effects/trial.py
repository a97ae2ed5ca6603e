"""a hidden trial -> its files: records, the nominal model and, apart, the sealed truth; what makes a trial harder."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Conditions:
    """What makes a trial harder.

    colour: correlation of neighbouring noise samples; sensors: share of the DOFs that is measured; lost: share of the
    samples that never arrived; in_loop: a controller feeds the position back; wrong_parameters: 10-30 % beside the
    effect; levels: amplitudes of further training records, of other lengths
    """

    colour: float = 0.0
    sensors: float = 1.0
    lost: float = 0.0
    in_loop: bool = False
    wrong_parameters: bool = False
    levels: tuple[float, ...] = ()


STRATA = {
    "main": Conditions(),
    "coloured noise": Conditions(colour=0.8),
    "unmeasured DOFs": Conditions(sensors=0.5),
    "2 % samples lost": Conditions(lost=0.02),
    "closed loop": Conditions(in_loop=True),
    "parameters and an effect": Conditions(wrong_parameters=True),
    "two amplitudes": Conditions(levels=(0.4,)),
}


@dataclass
class Trial:
    """Nominal M, D, K, L, C; records (u, y) with their flags (None: all good); `more` training records; the truth."""

    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    L: np.ndarray
    h: float
    hold: str
    initial_state: str
    train: tuple
    test: tuple
    truth: dict
    C: np.ndarray
    more: list = field(default_factory=list)
    quality: list = field(default_factory=list)


def write(trial: Trial, folder: Path) -> None:
    """train.csv, test.csv (train2.csv ... where there are more), model.yaml and, apart, the sealed truth."""
    import yaml

    folder.mkdir(parents=True, exist_ok=True)
    names = ["train", "test", *(f"train{k + 2}" for k in range(len(trial.more)))]
    for k, (name, (u, y)) in enumerate(zip(names, (trial.train, trial.test, *trial.more))):
        _write_record(folder / f"{name}.csv", u, y, trial.h, trial.quality[k])
    model = {
        "mass": trial.M.tolist(), "damping": trial.D.tolist(), "stiffness": trial.K.tolist(), "input_map": trial.L.tolist(),
        "output_map": trial.C.tolist(), "output": "displacement", "initial_state": trial.initial_state,
        "input_intersample": {"cubic": "smooth"}.get(trial.hold, trial.hold), "sample_time": trial.h,
    }  # fmt: skip
    (folder / "model.yaml").write_text(yaml.safe_dump(model))
    (folder / "sealed.json").write_text(json.dumps(trial.truth))


def _write_record(path: Path, u, y, h: float, quality) -> None:
    words = ["t", *(f"u{i + 1}" for i in range(u.shape[1])), *(f"y{i + 1}" for i in range(y.shape[1]))]
    columns = [np.arange(len(u)) * h, u, y]
    if quality is not None:
        words, columns = [*words, "quality"], [*columns, quality]
    table = np.column_stack(columns)
    np.savetxt(path, table, delimiter=",", header=",".join(words), comments="", fmt="%.12g")

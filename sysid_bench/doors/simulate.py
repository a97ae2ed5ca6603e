"""plant or model file, excitation, noise -> a record file."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.asked import require
from sysid_bench.build import build
from sysid_bench.effects import own_effects
from sysid_bench.files import plant_of, read_model
from sysid_bench.files.effects import effects_from
from sysid_bench.files.provenance import config_of, provenance
from sysid_bench.files.yaml_text import yaml_text
from sysid_bench.nouns import InputError, Model, Record
from sysid_bench.records import record_path, write_record
from sysid_bench.records.columns import Place, check_size

PARTS = ("excitation", "noise", "sampling", "source")


def main(cfg: dict[str, Any]) -> int:
    """Write the record `out` and print its one line."""
    require(cfg, "simulate", *PARTS, "out", *([] if cfg.get("model") else ["plant"]))
    out = record_path(cfg["out"])
    record, model = simulated(cfg)
    write_record(record, out, {"config.yaml": yaml_text(config_of(cfg))})
    for remark in remarks(record, model, out):
        print(f"note: {remark}", file=sys.stderr)
    print(f"{out}: {record!r}")
    return 0


def simulated(cfg: dict[str, Any]) -> tuple[Record, Model | None]:
    """(record, model of the file or None) of a simulate config. Raises InputError."""
    packages = cfg["plugins"].packages
    own = own_effects(cfg["effects_path"])
    model = read_model(cfg["model"], own) if cfg["model"] else None
    plant = plant_of(model, cfg["model"]) if model is not None else build(cfg["plant"], packages)
    plant = replace(plant, effects=(*plant.effects, *effects_from(cfg["effects"] or [], own)))
    excitation, noise, sampling, source = (build(cfg[name], packages) for name in PARTS)
    if model is not None and model.sample_time_s not in (None, sampling.h_s):
        raise InputError(
            f"model {cfg['model']} says sample_time: {model.sample_time_s:g} s; sampling.h_s is {sampling.h_s:g}. "
            f"Give sampling.h_s={model.sample_time_s:g}."
        )
    check_size(sampling.N, 1 + plant.nu + plant.ny, Place(str(cfg["out"]), str))
    seed = cfg["seed"]
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed must be a whole number 0..; got {seed!r}.")
    record = source.acquire(plant, excitation, noise, sampling, np.random.default_rng(seed)).record
    origin = {
        "source": "simulated",
        "seed": seed,
        **provenance("simulate", cfg, [cfg["model"]] if model else []),
    }
    return replace(record, origin=origin), model


def remarks(record: Record, model: Model | None, out: Path) -> list[str]:
    """What the user should know of the file just written."""
    found = []
    if out.suffix.lower() == ".csv":
        found.append(
            f"a CSV keeps t, u, y only; its model.yaml should say input_intersample: {_word(record)}"
        )
    if model is not None and model.hold not in (None, record.hold):
        found.append(
            f"the excitation is {record.hold} between samples, the model says {model.hold}; the excitation's was used"
        )
    return found


def _word(record: Record) -> str:
    return "smooth" if record.hold == "cubic" else str(record.hold)

"""seed -> a study folder as a sweep writes it: manifest.json and table.parquet with error laws like the real ones."""

import json
from pathlib import Path

import numpy as np

from sysid_bench.table import write_table

H = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.04, 0.02, 0.01, 0.005)
METHODS = ("n4sid_d2c", "variational_pem", "structured_ml")
BOUND = {"M": 0.0065, "D": 0.011, "K": 0.0066, "A": 0.009, "pole": 0.002}
SCALE = {"M": 1.0, "D": 2.4, "K": 0.9, "A": 1.2, "pole": 0.3}


def level(method: str, h: float) -> float:
    """Error of a method over the bound: one grows as h falls, one as h rises, one stays at the bound."""
    return {
        "n4sid_d2c": 2 + (0.03 / h) ** 2.2 + (h / 0.2) ** 1.7,
        "variational_pem": 1 + (h / 0.11) ** 2,
    }.get(method, 1)


def failure(method: str, h: float, rng: np.random.Generator) -> tuple[str, str]:
    if method == "variational_pem" and rng.random() < {0.01: 0.2, 0.005: 0.7}.get(h, 0.0):
        return "diverged", "no decrease of the output error in 40 iterations"
    if method == "n4sid_d2c" and h == 0.005 and rng.random() < 0.1:
        return "error", "LinAlgError: Singular matrix"
    return "ok", ""


def sweep_row(method: str, h: float, repetition: int, rng: np.random.Generator) -> dict:
    status, reason = failure(method, h, rng)
    row = {
        "key": f"{method}-{h}-{repetition}", "study": "synthetic", "plant": "three_dof", "excitation": "cubic_noise",
        "noise": "white", "source": "simulation", "method": method, "sampling.h_s": h, "sampling.N": 6000,
        "noise.snr_db": 15.0, "repetition": repetition, "seed": 100 + repetition, "nominal": False, "status": status,
        "reason": reason, "fit_s": float(rng.lognormal(-4, 0.3)),
    }  # fmt: skip
    for X, bound in BOUND.items():
        chi = np.sqrt(rng.chisquare(6) / 6)
        error = bound * SCALE[X] * level(method, h) * chi if method != "structured_ml" else bound * chi
        row[f"{X}_error"] = float(error) if status == "ok" else None
        row[f"{X}_bound"] = bound * (1 + 0.2 * 0.005 / h)
        row[f"{X}_over_bound"] = None if status != "ok" else row[f"{X}_error"] / row[f"{X}_bound"]
    return row


def sweep_study(folder: Path, repetitions: int = 12, seed: int = 3) -> Path:
    """A study of three methods against h, with failures."""
    rng = np.random.default_rng(seed)
    rows = [sweep_row(m, h, r, rng) for h in H for m in METHODS for r in range(repetitions)]
    panels = [{"y": f"{X}_error", "label": f"relative error of {X}", "bound": f"{X}_bound"} for X in "MKDA"]
    figure = {
        "name": "errors", "title": "Three masses, 15 dB: error against the sampling time", "x": "sampling.h_s",
        "x_label": "sampling time $h$ (s)", "x_log": True, "y_log": True, "series": "method", "panels": panels,
        "names": {"n4sid_d2c": "n4sid + d2c", "variational_pem": "variational PEM"},
        "caption": "The unstructured method fails at both ends; the bound is the Cramér-Rao bound of the very record.",
    }  # fmt: skip
    study = {"name": "synthetic", "kind": "identify", "repetitions": repetitions, "seed": seed, "records": "none",
             "question": "Which method reaches the Cramér-Rao bound, and where does each fail?"}  # fmt: skip
    axes = {"method": list(METHODS), "sampling.h_s": list(H)}
    return write(folder, rows, {"study": study, "axes": axes, "figures": [figure]})


def coefficient_study(folder: Path, repetitions: int = 10, seed: int = 5) -> Path:
    """A study of difference-equation coefficients against the sampling time, with theory columns."""
    rng = np.random.default_rng(seed)
    rows = [coefficient_row(h, r, rng) for h in np.linspace(0.2, 6.2, 31) for r in range(repetitions)]
    names = ["a1", "a2", "b1", "b2"]
    panels = [
        {
            "y": names,
            "label": "coefficient (b: m/N)",
            "theory": [f"{n}_theory" for n in names],
            "y_limits": [-2.2, 1.6],
        },
        {
            "y": ["m", "k"],
            "label": "recovered m (kg), k (N/m)",
            "hlines": [{"y": 1.0, "label": "true value"}],
        },
    ]
    marks = [{"x": 3.1416, "label": "Shannon"}, {"x": 3.63, "label": "π/ω_d"}]
    figure = {"name": "coefficients", "title": "Underdamped oscillator", "x": "sampling.h_s", "panels": panels,
              "vlines": marks}  # fmt: skip
    study = {
        "name": "coefficients",
        "kind": "identify",
        "repetitions": repetitions,
        "question": "Where is the fall?",
    }
    return write(folder, rows, {"study": study, "axes": {"sampling.h_s": []}, "figures": [figure]})


def coefficient_row(h: float, repetition: int, rng: np.random.Generator) -> dict:
    p, w = np.exp(-h / 2), np.sqrt(0.75)
    theory = {"a1": -2 * p * np.cos(w * h), "a2": p**2}
    theory["b1"] = 1 - p * (np.cos(w * h) + np.sin(w * h) / 2 / w)
    theory["b2"] = p * (p - np.cos(w * h) + np.sin(w * h) / 2 / w)
    fall = np.exp(-((h - 3.63) ** 2) / 0.1) if h > 1 else 0.0
    row = {"key": f"{h}-{repetition}", "study": "coefficients", "plant": "one_dof", "method": "arx", "sampling.h_s": h,
           "sampling.N": 42, "repetition": repetition, "seed": repetition, "status": "ok", "reason": "", "fit_s": 1e-3}  # fmt: skip
    for name, value in theory.items():
        drop = fall * {"a1": -0.4, "a2": -0.1, "b2": -0.5}.get(name, 0.0)
        row |= {name: value + drop + 0.02 * rng.standard_normal() * (1 + 8 * fall), f"{name}_theory": value}
    return row | {"m": 1 + 0.02 * rng.standard_normal() + fall, "k": 1 + 0.01 * rng.standard_normal()}


def write(folder: Path, rows: list[dict], config: dict) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    write_table(json.loads(json.dumps(rows)), folder / "table.parquet")
    origin = {"sysid_bench": "0.1.0", "numpy": np.__version__, "commit": "0" * 40, "cpu": "synthetic"}
    config = {**config, "plant": {"name": "three_dof"}, "sampling": {"h_s": 0.1, "N": 6000}}
    name, question = config["study"]["name"], config["study"]["question"]
    manifest = {"study": name, "question": question, "command": f"sysid-bench sweep experiment={name}",
                "cells": len(rows), "config": config, "origin": origin}  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=1))
    return folder

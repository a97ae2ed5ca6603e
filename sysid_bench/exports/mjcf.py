"""estimate -> MuJoCo MJCF: one slide joint per degree of freedom, couplings as fixed tendons, exactly.

A joint holds the diagonal: mass (of its body, or armature), damping, stiffness. What couples joints cannot be a joint's
parameter: X = diag(d) + sum_k x_k c_k c_k' puts it into fixed tendons of length c_k' q with armature (mass),
damping or stiffness x_k >= 0. Nothing is dropped; what MJCF cannot hold (a matrix that is not positive) is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from sysid_bench.files import atomic_write, model_of
from sysid_bench.nouns import Array, Estimate, InputError, Model

ROUNDING = 1e-12
NEGLIGIBLE_KG = "1e-14"  # MuJoCo refuses moving bodies below 1e-15
_ATTRIBUTE = {"mass": "armature", "damping": "damping", "stiffness": "stiffness"}


def write(estimate: Estimate, values: Mapping[str, Any], source: Path, path: Path) -> list[str]:
    """Write the model as MJCF. Raises InputError: no M, D, K; effects; M, D or K not positive (semi)definite."""
    model = model_of(estimate, values, source)
    if model.effects:
        names = ", ".join(effect.name for effect in model.effects)
        raise InputError(f"estimate {source}: MJCF export is for linear models; this one has {names}.")
    tree = ET.ElementTree(mjcf(model, str(source)))
    ET.indent(tree)
    with atomic_write(path) as file:
        tree.write(file, encoding="utf-8", xml_declaration=True)
    lost = ["standard errors", "how the input runs between samples (MuJoCo holds ctrl over a step)"]
    if model.output == "acceleration":
        lost.append("the acceleration outputs (MuJoCo has no joint acceleration sensor; read qacc)")
    return lost


def mjcf(model: Model, source: str) -> ET.Element:
    """The <mujoco> element: bodies, tendons, motors (input_map), sensors (output_map)."""
    terms = {
        name: rank_one_terms(getattr(model, name), f"{source}: {name}", name == "mass") for name in _ATTRIBUTE
    }
    root = ET.Element("mujoco", model="identified")
    ET.SubElement(root, "compiler", autolimits="true")
    option = ET.SubElement(root, "option", gravity="0 0 0", integrator="implicit")
    ET.SubElement(option, "flag", contact="disable")
    _bodies(root, {name: diagonal for name, (diagonal, _) in terms.items()}, nested=bool(terms["mass"][1]))
    tendons = ET.SubElement(root, "tendon")
    for name, (_, couplings) in terms.items():
        for k, (value, c) in enumerate(couplings):
            _tendon(tendons, f"{name}{k}", c, {_ATTRIBUTE[name]: repr(value)})
    actuator, sensor = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    for k, column in enumerate(np.asarray(model.input_map).T):
        _tendon(tendons, f"force{k + 1}", column, {})
        ET.SubElement(actuator, "motor", name=f"u{k + 1}", tendon=f"force{k + 1}")
    if model.output != "acceleration":
        kind = "tendonpos" if model.output == "displacement" else "tendonvel"
        for k, row in enumerate(np.asarray(model.output_map)):
            _tendon(tendons, f"output{k + 1}", row, {})
            ET.SubElement(sensor, kind, name=f"y{k + 1}", tendon=f"output{k + 1}")
    return root


def _bodies(root: ET.Element, diagonals: Mapping[str, Array], nested: bool) -> None:
    """One body per DOF, side by side; `nested` in one another with all mass as armature.

    MuJoCo keeps off-diagonal mass only between joints of one kinematic chain.
    """
    parent = ET.SubElement(root, "worldbody")
    for i in range(len(diagonals["mass"])):
        mass, damping, stiffness = (repr(float(diagonals[name][i])) for name in _ATTRIBUTE)
        body = ET.SubElement(parent, "body", name=f"m{i + 1}", pos=f"0 {int(nested) or i} 0")
        weight, armature = (NEGLIGIBLE_KG, mass) if nested else (mass, "0")
        inertia = " ".join([weight] * 3)
        ET.SubElement(body, "inertial", pos="0 0 0", mass=weight, diaginertia=inertia)
        joint = {"damping": damping, "stiffness": stiffness, "armature": armature}
        ET.SubElement(body, "joint", {"name": f"q{i + 1}", "type": "slide", "axis": "1 0 0", **joint})
        parent = body if nested else parent


def _tendon(tendons: ET.Element, name: str, c: Array, attributes: Mapping[str, str]) -> None:
    fixed = ET.SubElement(tendons, "fixed", {"name": name, **attributes})
    for i in np.flatnonzero(c):
        ET.SubElement(fixed, "joint", joint=f"q{i + 1}", coef=repr(float(c[i])))


def rank_one_terms(X: Array, name: str, definite: bool) -> tuple[Array, list[tuple[float, Array]]]:
    """(d, [(x_k, c_k)]) with X = diag(d) + sum_k x_k c_k c_k', d >= 0 (> 0 where `definite`), x_k > 0.

    Where the diagonal outweighs each row, c_k joins two joints (springs between neighbours); else the c_k are
    eigenvectors. Raises InputError where X is not positive (semi)definite.
    """
    off = X - np.diag(np.diag(X))
    rest = np.diag(X) - np.abs(off).sum(axis=1)
    scale = np.abs(X).max(initial=0.0)
    if np.all(rest > ROUNDING * scale if definite else rest >= -ROUNDING * scale):
        pairs = [(i, j) for i, j in zip(*np.triu_indices(len(X), 1), strict=True) if X[i, j] != 0.0]
        return np.maximum(rest, 0.0), [(float(abs(X[i, j])), _pair(len(X), i, j, X[i, j])) for i, j in pairs]
    eigenvalues, vectors = np.linalg.eigh(X)
    if eigenvalues[0] < -ROUNDING * scale or (definite and eigenvalues[0] <= ROUNDING * scale):
        raise InputError(
            f"estimate {name} has eigenvalue {eigenvalues[0]:g}; MJCF holds positive "
            f"{'definite' if definite else 'semidefinite'} matrices only. Export model.yaml, .mat or .py instead."
        )
    floor = 0.5 * eigenvalues[0] if definite else 0.0
    parts = [
        (float(x - floor), v)
        for x, v in zip(eigenvalues, vectors.T, strict=True)
        if x - floor > ROUNDING * scale
    ]
    return np.full(len(X), floor), parts


def _pair(n: int, i: Any, j: Any, value: float) -> Array:
    c = np.zeros(n)
    c[i], c[j] = 1.0, np.sign(value)
    return c

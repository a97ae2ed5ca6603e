"""emulate: the device as a process of its own."""

from __future__ import annotations

import signal
import sys
import time
from dataclasses import replace
from typing import Any

from sysid_bench.build import build
from sysid_bench.effects import own_effects
from sysid_bench.emulator.faults import Fault
from sysid_bench.emulator.process import Emulator
from sysid_bench.files import plant_of, read_model
from sysid_bench.frames.link import LinkLost, opened
from sysid_bench.frames.priority import before_others
from sysid_bench.mechanics.effect import Effect
from sysid_bench.nouns import InputError, Plant


def main(cfg: dict[str, Any]) -> int:
    """Answer on the bus until interrupted (exit code 0), or until the bus is lost (1)."""
    packages = cfg["plugins"].packages
    rig, bus, hardware = (build(cfg[name], packages) for name in ("rig", "bus", "hardware"))
    faults = [_fault(node) for node in cfg["faults"]]
    own = own_effects(cfg["effects_path"])
    plant = _with_effects(_plant(cfg, own), cfg["effects"], own)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda n, _: ended.append(n))
    end = time.monotonic() + (cfg["seconds"] or 1e12)
    with open(cfg["truth"] or "/dev/null", "w") as truth:
        link = opened(bus, rig, cfg["pace"])
        try:
            emulator = Emulator(rig, plant, hardware, faults, link, truth if cfg["truth"] else None)
            print(
                f"emulating {rig.name} ({plant.n} degrees of freedom, {rig.rate_hz:g} Hz) on {link.name}",
                flush=True,
            )
            with before_others():
                emulator.run(lambda: bool(ended) or time.monotonic() > end)
        except LinkLost as problem:
            print(f"sysid-bench emulate: {problem}", file=sys.stderr)
            return 1
        finally:
            link.close()
    print(f"ended; faults injected: {emulator.injector.done or 'none'}", flush=True)
    return 0


def _fault(node: Any) -> Fault:
    try:
        return Fault(**node)
    except TypeError as problem:
        raise InputError(f"faults: {node!r:.200} is no fault ({problem}).") from None


def _plant(cfg: dict[str, Any], own: tuple[type[Effect], ...]) -> Plant:
    """The plant of a model file where one is named, else the option."""
    if cfg["model"]:
        return plant_of(read_model(cfg["model"], own), cfg["model"])
    return build(cfg["plant"], cfg["plugins"].packages)


def _with_effects(plant: Plant, path: str | None, own: tuple[type[Effect], ...]) -> Plant:
    """The plant with the effects of a file added to its own: {effects: [...]} as in a model file."""
    if path is None:
        return plant
    from sysid_bench.files.effects import effect_from
    from sysid_bench.files.yaml_text import read_yaml

    stored, _ = read_yaml(path, "effects")
    if not isinstance(stored.get("effects"), list):
        raise InputError(
            f"effects={path}: wanted a file with `effects: [{{name: ..., dof: ..., parameters: ...}}]`."
        )
    effects = [effect_from(node, f"{path}, effect {i}", own) for i, node in enumerate(stored["effects"])]
    return replace(plant, effects=(*plant.effects, *effects))

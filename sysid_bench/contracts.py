"""an option of a shelf -> passed, or an AssertionError that says which promise it breaks.

The suite's own tests walk `conf/` with these; your package's tests call them for your options:

    from sysid_bench.contracts import check_option
    from sysid_bench.conf import Plugins
    check_option("method", "mine", Plugins.named("my_folder"))
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sysid_bench import conf
from sysid_bench.build import build, target_class
from sysid_bench.nouns import HOLDS, STATUSES, Diverged, Estimate, NotApplicable, Plant, Record, Signal

NO_PLUGINS = conf.Plugins()


def check_option(group: str, name: str, plugins: conf.Plugins = NO_PLUGINS) -> None:
    """All promises that an option of `group` makes: its yaml, and its shelf's behaviour."""
    node = conf.option(group, name, plugins)
    check_yaml(node, plugins.packages)
    shelf = SHELVES.get(group)
    if shelf is not None:
        shelf(build(node, plugins.packages))


def check_yaml(node: Mapping[str, Any], packages: tuple[str, ...] = ()) -> None:
    """The yaml spells every knob of its class; the class is a frozen dataclass with a docstring."""
    cls: Any = target_class(str(node["_target_"]), packages)
    known = {f.name: f for f in dataclasses.fields(cls) if f.init}
    written = set(node) - {"_target_"}
    assert written == set(known), (
        f"{cls.__name__}: yaml keys {sorted(written)} are not its knobs {sorted(known)}"
    )
    assert cls.__dataclass_params__.frozen, f"{cls.__name__} must be frozen: it holds settings only"
    assert inspect.getdoc(cls) and not str(cls.__doc__).startswith(f"{cls.__name__}("), (
        f"{cls.__name__}: no docstring"
    )


def check_defaults(node: Mapping[str, Any]) -> None:
    """The yaml's values are the class's defaults, where it has any."""
    cls: Any = target_class(str(node["_target_"]))
    for knob in dataclasses.fields(cls):
        default = knob.default if knob.default_factory is dataclasses.MISSING else knob.default_factory()
        if knob.init and default is not dataclasses.MISSING and not dataclasses.is_dataclass(default):
            given = node[knob.name]
            default = list(default) if isinstance(default, tuple) else default
            assert given == default, f"{cls.__name__}.{knob.name}: yaml says {given!r}, the class {default!r}"


def check_excitation(excitation: Any) -> None:
    """A signal has the shape asked for, a known hold, and is decided by its seed."""
    h = _sampling_time_of(excitation)
    first, again, other = (excitation.signal(400, h, 2, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert isinstance(first, Signal) and first.u.shape == (400, 2)
    assert first.hold in HOLDS and np.all(np.isfinite(first.u))
    assert np.array_equal(first.u, again.u), "the same seed must give the same signal"
    assert other.u.shape == first.u.shape


def _sampling_time_of(excitation: Any) -> float:
    return float(getattr(excitation, "knot_spacing_s", 1.0)) / 10


def check_noise(noise: Any) -> None:
    """Noise keeps the shape, leaves its argument alone, names its variance, is decided by its seed."""
    y = np.sin(0.1 * np.arange(2000))[:, None] * np.array([1.0, 2.0])
    y.setflags(write=False)
    (first, variance), (again, _) = (noise.apply(y, 0.1, np.random.default_rng(3)) for _ in range(2))
    assert first.shape == y.shape and np.shape(variance) == (2,) and np.all(np.asarray(variance) >= 0)
    assert np.array_equal(first, again), "the same seed must give the same noise"


def check_plant(plant: Any) -> None:
    """A plant is a Plant with units."""
    assert isinstance(plant, Plant)
    assert plant.units, "a plant says its units"


def check_method(method: Any) -> None:
    """fit is pure, returns an Estimate or raises NotApplicable or Diverged, and is good on clean data."""
    for plant in (_light_plant(1), _light_plant(2)):
        record = _clean_record(plant)
        before = (record.u.copy(), record.y.copy())
        model = plant.model() if method.nominal else plant.model().structure_only()
        try:
            estimate, again = method.fit(record, model), method.fit(record, model)
        except (NotApplicable, Diverged) as problem:
            assert str(problem), "a method that declines says why"
            continue
        assert np.array_equal(record.u, before[0]) and np.array_equal(record.y, before[1]), (
            "a record was changed"
        )
        _check_estimate(estimate, again, plant)


def _check_estimate(estimate: Estimate, again: Estimate, plant: Plant) -> None:
    assert isinstance(estimate, Estimate) and estimate.status in STATUSES
    for name, truth in (("M", plant.mass), ("D", plant.damping), ("K", plant.stiffness)):
        got = getattr(estimate, name)
        if got is not None:
            assert got.shape == truth.shape and np.allclose(got, got.T), f"{name} must be symmetric"
            assert np.array_equal(got, getattr(again, name)), "the same record must give the same estimate"
            assert np.linalg.norm(got - truth) < 0.5 * np.linalg.norm(truth), (
                f"{name} is far off on noise-free data"
            )
    if estimate.covariance is not None:
        n = plant.n
        assert estimate.covariance.shape == (3 * n * (n + 1) // 2,) * 2


def _light_plant(n: int) -> Plant:
    K = 2.5 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return Plant(np.diag(1.0 + 0.2 * np.arange(n)), 0.15 * K, K)


def _clean_record(plant: Plant) -> Record:
    """A noise-free record under a zero-order hold, white input, sampled ten times faster than the modes."""
    from sysid_bench.mechanics.holds import propagate
    from sysid_bench.mechanics.second_order import state_space

    N, h = 3000, 0.25
    u = np.random.default_rng(5).standard_normal((N, plant.nu))
    A, B, C, Dd = state_space(
        plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map, plant.output
    )
    x = propagate(A, B, u, h, "zoh", np.zeros(len(A)))
    return Record(h * np.arange(N), u, x @ C.T + u @ Dd.T, hold="zoh")


SHELVES: dict[str, Callable[[Any], None]] = {
    "plant": check_plant,
    "excitation": check_excitation,
    "noise": check_noise,
    "method": check_method,
}

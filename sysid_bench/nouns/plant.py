"""A plant: the truth of a simulated experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sysid_bench.nouns.model import Effect, Model
from sysid_bench.nouns.words import Array, Output


@dataclass(frozen=True, eq=False)
class Plant:
    """The truth of a simulated experiment: M q'' + D q' + K q = L u + effects, y = C q (or q', q'').

    Same fields and units as Model, all values given.
    """

    mass: Array
    damping: Array
    stiffness: Array
    input_map: Array = None  # type: ignore[assignment]  # the identity, set below
    output_map: Array = None  # type: ignore[assignment]
    output: Output = "displacement"
    effects: tuple[Effect, ...] = ()
    units: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        checked = Model(
            self.mass, self.damping, self.stiffness, input_map=self.input_map, output_map=self.output_map,
            output=self.output, effects=self.effects,
        )  # fmt: skip
        for name in ("mass", "damping", "stiffness", "input_map", "output_map", "effects"):
            object.__setattr__(self, name, getattr(checked, name))

    @property
    def n(self) -> int:
        return len(self.mass)

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """mass, damping, stiffness (n, n)."""
        return self.mass, self.damping, self.stiffness

    @property
    def nu(self) -> int:
        return self.input_map.shape[1]

    @property
    def ny(self) -> int:
        return self.output_map.shape[0]

    @property
    def is_linear(self) -> bool:
        return not self.effects

    def model(self) -> Model:
        """The model that says exactly what this plant is (values and effects included)."""
        return Model(
            self.mass, self.damping, self.stiffness, input_map=self.input_map, output_map=self.output_map,
            output=self.output, effects=self.effects, units=self.units,
        )  # fmt: skip

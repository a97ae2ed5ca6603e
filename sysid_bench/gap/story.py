"""What the search for effects goes by and what it tells: rules, rounds, story."""

from __future__ import annotations

from dataclasses import dataclass, field

from sysid_bench.gap.candidates import Screen
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.price import DECOY_NAMES, Contender


@dataclass(frozen=True)
class Rules:
    """How an effect earns its place.

    most (most_on_force where the force is judged): effects looked for; finalists: suspects fitted by simulation; practical: share of the linear gap that
    matters; first_share, second_share: of what is left, that the first and a later effect must take; enough: rho at which nothing is left
    """

    most: int = 3
    most_on_force: int = 4
    finalists: int = 7
    practical: float = 0.03
    first_share: float = 0.0
    second_share: float = 0.4
    enough: float = 1.05


@dataclass(frozen=True, eq=False)
class Round:
    """One look: the screen, the contenders (cheapest first), the fit before and the one chosen (None: nothing)."""

    screen: Screen
    contenders: list[Contender]
    before: Fit
    chosen: Contender | None


@dataclass(eq=False)
class Story:
    """linear: the refit without effects; fit: where it ends; rounds: what was looked at on the way."""

    linear: Fit
    fit: Fit
    rounds: list[Round] = field(default_factory=list)

    @property
    def ends_unnamed(self) -> bool:
        """True where a shape without a name is part of the explanation."""
        return any(e.name in DECOY_NAMES for e in self.fit.point.effects)

"""when a verdict is given: the numbers, and what each is of."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """When a verdict is given.

    left_rho, left_share (left_on_force where the force is judged): with effects found, more than this left (over the floor; of the linear gap) is `unknown`
    part_rho, part_share: the same for what is left nearer to the floor: an effect that takes only part of a weak gap is not its name
    bare_rho: with none found, more than this is `unknown`
    moved_rho: the nominal's gap over the refit's from which `parameters` are wrong
    moved: practical size of a relative change: mass, damping, stiffness; twice that off the diagonal
    """

    left_rho: float = 1.5
    left_share: float = 0.05
    part_rho: float = 1.1
    part_share: float = 0.25
    left_on_force: float = 0.5
    bare_rho: float = 1.6
    moved_rho: float = 1.3
    moved: tuple[float, float, float] = (0.05, 0.12, 0.05)

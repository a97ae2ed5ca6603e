"""fits with one more effect -> their prices, and the one that is taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.gap.candidates import Candidate
from sysid_bench.gap.decoys import DECOYS
from sysid_bench.gap.descent import Fit, free_parameters
from sysid_bench.gap.problem import Problem
from sysid_bench.mechanics.effect import Effect

DECOY_NAMES = frozenset(kind.name for kind in DECOYS)
# A richer law must gain this share of the linear gap over its own special case, and this share of what it leaves.
RICHER_GAINS, RICHER_LEAVES = 0.0015, 0.5
# Energy that the gap of a stop must gain over a coupling: of noise, and as often that of what a later effect explains
# (the dispersion of a quasi-likelihood; McCullagh, Nelder 1989).
GAP_GAINS = 15.0
HYSTERESIS = 8.0  # price by which a hysteresis that closes the gap must beat one of its simpler laws
TIE = 10.0  # of price, below which two names are alike
CLOSED = 1.15  # rho from which a fit may have missed its valley
PLAINLY = 60.0  # of the price: a shape that closes the gap is not overruled by a name that is so far behind


@dataclass(frozen=True, eq=False)
class Contender:
    """A fit with one more effect (or two), and what it costs: 2 rss + parameters ln R + what M, D, K moved."""

    fit: Fit
    candidate: Candidate
    cost: float

    @property
    def effect(self) -> Effect:
        return self.fit.point.effects[-1]

    @property
    def is_decoy(self) -> bool:
        return self.effect.name in DECOY_NAMES


def shape_count(effects: tuple[Effect, ...]) -> int:
    """Parameters that count: not the smoothing of a sign, not the loss of a contact."""
    return sum(effects[e].numeric[p] not in ("speed", "damping") for e, p in free_parameters(effects))


def price(problem: Problem, one: Fit) -> float:
    """2 rss + parameters ln R + the squared step of theta: only a trusted nominal splits forces that are alike."""
    R = len(one.rows)
    moved = 9 * one.moved  # entries in units of a third of their prior: a tenth for mass and stiffness
    count = shape_count(one.point.effects)
    return 2 * one.rss + count * np.log(R) + moved


def noticeable(R: int) -> float:
    """Energy beyond what the best of many suspects explains of R rows of noise, and a share of it that matters."""
    return 30 + 4 * np.log(R) + 0.002 * R


def cheapest(contenders: list[Contender], linear_gap: float, practical: float) -> Contender | None:
    """The lowest price; a simpler catalogue effect that is nearly as good wins over a decoy or a richer one."""
    if not contenders:
        return None
    best = contenders[0]
    margin = max(20.0, practical * linear_gap)
    left = max(best.fit.rss - len(best.fit.rows), 0.0)
    nested = 2 * max(15.0, RICHER_GAINS * linear_gap, RICHER_LEAVES * left)
    for other in contenders[1:]:
        behind = other.cost - best.cost
        if behind > max(margin, nested) or other.fit.rho > 1.4 * best.fit.rho + 0.1:
            break
        # a shape that fits better with fewer parameters is not overruled by a name that only bends towards it
        plainer = shape_count(best.fit.point.effects) < shape_count(other.fit.point.effects)
        near = 20.0 if plainer else min(max(20.0, margin / 3), PLAINLY if best.fit.rho < CLOSED else np.inf)
        named = best.is_decoy and not other.is_decoy and behind < near
        enough = HYSTERESIS if best.fit.rho < CLOSED and smooth(other.effect) else nested
        if _linear_drive_for_rate_limit(other.effect, best.effect):
            enough = TIE
        elif other.effect.name == "missing_coupling":
            enough = 2 * max(GAP_GAINS * best.fit.rho, RICHER_GAINS * linear_gap)
        if named or (behind < enough and not other.is_decoy and simpler(other.effect, best.effect)):
            return other
    return best


def simpler(one: Effect, other: Effect) -> bool:
    """True where one is the other's simpler law, or explains without a nonlinearity what the other explains with one."""
    return subset(one, other) or _linear_drive_for_rate_limit(one, other)


def _linear_drive_for_rate_limit(one: Effect, other: Effect) -> bool:
    """True for a delay or a lag beside a rate limit: on an input of two levels every ramp is as long, and they are alike."""
    return one.dof == other.dof and one.name in ("input_delay", "actuator_lag") and other.name == "rate_limit"


def smooth(effect: Effect) -> bool:
    """True for a friction whose law has no rounded sign, so that a richer law cannot gain by rounding it otherwise."""
    return effect.name == "presliding_friction"


def subset(simple: Effect, rich: Effect) -> bool:
    """True where the simple effect is the rich one with a parameter at its limit, at the same place."""
    pairs = {
        ("coulomb_friction", "stribeck_friction"), ("coulomb_friction", "presliding_friction"),
        ("coulomb_friction", "bouc_wen_hysteresis"), ("presliding_friction", "bouc_wen_hysteresis"),
        ("sensor_bias", "sensor_drift"), ("coulomb_friction", "friction_behind_play"),
        ("presliding_friction", "friction_behind_play"), ("missing_coupling", "end_stop"),
    }  # fmt: skip
    return simple.dof == rich.dof and (simple.name, rich.name) in pairs

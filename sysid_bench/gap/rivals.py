"""answer, effect -> what it was told apart from, and what it was not."""

from __future__ import annotations

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.decide import place_value
from sysid_bench.gap.price import Contender
from sysid_bench.mechanics.effect import Effect

# What the evidence cannot split by itself, and why (same data).
ALIKE = {
    frozenset({"constant_force", "sensor_bias"}): "one DOF started at rest",
    frozenset({"input_delay", "actuator_lag"}): "to first order the same phase",
    frozenset({"input_delay", "wrong_hold"}): "half a sample of delay",
}
# A richer law holds the simpler one as a limit: no experiment speaks against it.
HELD = frozenset(
    {
        ("coulomb_friction", "stribeck_friction"), ("coulomb_friction", "presliding_friction"),
        ("coulomb_friction", "bouc_wen_hysteresis"), ("sensor_bias", "sensor_drift"),
        ("missing_coupling", "end_stop"),
    }
)  # fmt: skip
ELSEWHERE = -0.02  # on the force, what takes so much more of the gap explains another part of it: no rival


def rivals(answer: Answer, effect: Effect) -> tuple[list, list]:
    """(told apart from, not told apart from): what else was fitted in the round that chose this effect."""
    apart, close = [], []
    told = {(e.name, e.dof) for e in answer.story.fit.point.effects}  # and each rival once, at its best
    for r in answer.story.rounds:
        if r.chosen is None or r.chosen.effect.name != effect.name:
            continue
        for other in r.contenders:
            behind = float((other.cost - r.chosen.cost) / _linear_gap(r))
            known = (other.effect.name, other.effect.dof)
            if known in told or (answer.judged and behind < ELSEWHERE):
                continue
            told.add(known)
            entry = {"name": other.effect.name, "dof": place_value(other.effect.dof), "behind": behind}
            (close if _is_close(r, other) else apart).append(entry)
    for pair, why in ALIKE.items():
        if effect.name in pair and answer.problem.model.n == 1:
            other = next(iter(pair - {effect.name}))
            if not any(x["name"] == other for x in apart + close):
                close.append({"name": other, "dof": place_value(effect.dof), "why": why})
    return apart, close


def _linear_gap(r) -> float:
    return max(r.before.rss - len(r.before.rows), 1.0)


def _is_close(r, other: Contender) -> bool:
    """True where the evidence for the chosen effect over this one is less than what matters."""
    return other.cost - r.chosen.cost <= max(20.0, 0.003 * _linear_gap(r))


def alike(answer: Answer) -> list[list[Contender]]:
    """The chosen effect of each round with the named ones that it was not told apart from; none where all were."""
    found = []
    for r in answer.story.rounds if answer.verdict.word == "effect" else []:
        if r.chosen is None:
            continue
        known = (r.chosen.effect.name, r.chosen.effect.dof)
        close = [c for c in r.contenders if not c.is_decoy and _is_close(r, c)]
        close = [c for c in close if (r.chosen.effect.name, c.effect.name) not in HELD]
        close = [c for c in close if (c.effect.name, c.effect.dof) != known]
        if close:
            found.append([r.chosen, *close])
    return found

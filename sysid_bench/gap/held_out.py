"""fits on the force -> which one is kept: on a machine what is left is never noise, so held-out blocks decide.

Every fit is scored on blocks that it was not fitted on: linear near its end, it takes one step without the block
(Cook, Weisberg 1982), no second fit.
"""

from __future__ import annotations

import numpy as np

from sysid_bench.gap.descent import Fit
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.nouns import Array

BLOCKS = 12
DAMPED = 1e-3  # keeps a step where a block alone told about a parameter
LARGE, HARMED = (
    0.4,
    0.05,
)  # share of what is left that a rare gain must take; of the gain that blocks may lose by it
PRACTICAL = 0.01  # of the force: what a smaller effect takes away matters on no machine


def block_losses(problem: ForceProblem, fit: Fit) -> Array:
    """(BLOCKS,) squared residual of each stretch of the records, of a fit that did not see it.

    How steeply a sign is smoothed stays as it is: one step says nothing of a force that jumps.
    """
    shapes = [(e, p) for e, p in fit.parameters if fit.point.effects[e].numeric[p] != "speed"]
    J = problem.jacobian(fit.point, fit.runs, shapes)
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    H, losses = J.T @ J, []
    for part in np.array_split(np.arange(len(fit.rows)), BLOCKS):
        r, Jb = fit.rows[part], J[part]
        # the step away from the whole fit, where J' r = 0
        step = np.linalg.solve(H - Jb.T @ Jb + DAMPED * np.eye(len(H)), -Jb.T @ r)
        out = r - Jb @ step
        losses.append(float(out @ out))
    return np.array(losses)


def earns_on_force(problem: ForceProblem, before: Fit, after: Fit, practical: float) -> bool:
    """True where the held-out gain is sure, and exceeds `practical` of what is left over the noise."""
    gains = block_losses(problem, before) - block_losses(problem, after)
    total, left = float(gains.sum()), max(before.rss - len(before.rows), 0.0)
    if total < PRACTICAL**2 * force_of(problem, before):
        return False
    return total > practical * left and total > 25 and is_sure(gains, left)


def is_sure(gains: Array, left: float) -> bool:
    """True where gains per block exceed two standard errors; or are large, rare and harm no block.

    A sweep passes a mode once, a stop is hit once: what one block gains by far then counts as spread.
    """
    total, error = gains.sum(), np.std(gains, ddof=1) * np.sqrt(len(gains))
    harmed = -gains[gains < 0].sum()
    return bool(total > 2 * error or (total > LARGE * left and harmed < HARMED * total))


def force_of(problem: ForceProblem, fit: Fit) -> float:
    """Squared sum of the given force over the rows, in noise floors."""
    return fit.rss / problem.share_missed(fit) ** 2


def held_out_cost(problem: ForceProblem, fit: Fit) -> float:
    """Twice the held-out loss: comparable with the price of a fit by free-run simulation."""
    return 2 * float(block_losses(problem, fit).sum())


def simplest(
    losses: list[Array], ranks: list[tuple], related: list[bool], rules: tuple[float, float], force: float
) -> int:
    """Number of the fit to keep: the lowest rank of those as good as the best on held-out blocks.

    losses per fit and block; related: the best is this one with more shape; rules: what a richer shape must take of
    what the simpler leaves, and a stranger of what the best leaves; force: its squared sum over the rows, of which a
    richer shape must take a practical share. Within two standard errors all are as good.
    """
    best = losses[int(np.argmin([x.sum() for x in losses]))]
    as_good = []
    for k, loss in enumerate(losses):
        behind, (richer, stranger) = loss - best, rules
        allowed = max(richer * loss.sum(), PRACTICAL**2 * force) if related[k] else stranger * best.sum()
        unclear = (
            behind.sum() < 2 * np.std(behind, ddof=1) * np.sqrt(BLOCKS) and behind.sum() < 0.1 * best.sum()
        )
        if behind.sum() <= allowed or unclear:
            as_good.append((ranks[k], float(behind.sum()), k))
    return min(as_good)[2]

"""a fit -> which entries of M, D, K, and which parameters of given effects, it moved; and whether it had to."""

from __future__ import annotations

import numpy as np

from sysid_bench.gap.descent import Fit
from sysid_bench.gap.problem import MATRICES, Problem
from sysid_bench.gap.thresholds import Thresholds
from sysid_bench.nouns import Array

FINEST = 1e-12  # of the largest variance: what is smaller is rounding


def moves(problem: Problem, fit: Fit) -> list[dict]:
    """Every entry that the fit moved: which, from, to, standard error."""
    std = np.full(len(problem.entries), np.nan)
    if fit.covariance is not None:
        std = np.sqrt(np.maximum(np.diag(fit.covariance)[: len(std)], 0)) * problem.scale
    now = problem.matrices(fit.point.theta)
    out = []
    for k, (m, i, j) in enumerate(problem.entries):
        before = float(getattr(problem.model, MATRICES[m])[i, j])
        after = float(now[m][i, j])
        change = fit.point.theta[k]
        out.append(
            {
                "matrix": MATRICES[m],
                "row": i,
                "column": j,
                "from": before,
                "to": after,
                "std": float(std[k]),
                "relative": float(change * problem.scale[k] / abs(before)) if before else None,
                "significance": float(abs(after - before) / std[k]) if std[k] > 0 else None,
            }
        )
    return out


def practical_moves(problem: Problem, fit: Fit, thresholds: Thresholds) -> list[int]:
    """Numbers of the entries that moved by more than a practical size and four standard errors.

    Where none is as certain as that, but no M, D, K nearer to the nominal close the gap, all that moved by a practical size.
    """
    far = np.abs(fit.point.theta) > _practical_sizes(problem, thresholds)
    errors = [move["significance"] for move in moves(problem, fit)]
    moved = [int(k) for k in np.flatnonzero(far)]
    certain = [k for k in moved if errors[k] is None or errors[k] > 4]
    if certain or not moved or closed_nearby(problem, fit, thresholds):
        return certain
    return moved


def _practical_sizes(problem: Problem, thresholds: Thresholds) -> Array:
    """(ntheta,) relative change from which an entry of M, D, K counts as moved."""
    return np.array([thresholds.moved[m] * (1.0 if i == j else 1.6) for m, i, j in problem.entries])


def closed_nearby(problem: Problem, fit: Fit, thresholds: Thresholds) -> bool:
    """True where M, D, K within a practical size of the nominal leave hardly more than the fit does.

    Few sensors tell M, D, K only together: each entry alone is uncertain, and that some of them are off is not. The cost
    around the fit is taken as its normal equations tell it.
    """
    if fit.covariance is None or not problem.entries or not np.isfinite(fit.covariance).all():
        return True
    from scipy.optimize import lsq_linear  # slow to load, and rarely needed

    count, sizes = len(problem.entries), _practical_sizes(problem, thresholds)
    spread, axes = np.linalg.eigh(fit.covariance[:count, :count])
    root = axes.T * np.sqrt(max(fit.rho, 1) / np.maximum(spread, FINEST * spread[-1]))[:, None]
    rise = 2 * lsq_linear(root, root @ fit.point.theta, (-sizes, sizes)).cost
    return bool(rise < (thresholds.moved_rho - 1) * max(fit.rho, 1) * len(fit.rows))


def moved_knobs(problem: Problem, fit: Fit, thresholds: Thresholds) -> list[dict]:
    """Parameters of the effects that the model had already, where they moved by a practical size and four standard errors."""
    found = []
    for k, (e, p) in enumerate(fit.parameters):
        if e >= len(problem.effects) or fit.covariance is None:
            continue  # found, not given
        if (
            problem.on_force
            and problem.effects[e].name == "constant_force"
            and not problem.effects[e].values[p]
        ):
            continue  # the offset that every record may have
        one, now, at = problem.effects[e], fit.point.effects[e], len(problem.entries) + k
        before, after = float(one.values[p]), float(now.values[p])
        size = abs(after) if problem.by_log(now, p) else 1.0
        std = float(np.sqrt(max(fit.covariance[at, at], 0)) * size)
        if abs(after - before) > max(thresholds.moved[0] * abs(before), 4 * std):
            found.append({
                "effect": one.name, "dof": list(one.dof) if isinstance(one.dof, tuple) else one.dof,
                "parameter": one.numeric[p], "from": before, "to": after, "std": std,
                "relative": (after - before) / abs(before) if before else None,
                "significance": abs(after - before) / std if std > 0 else None,
            })  # fmt: skip
    return found

"""matrix -> its exponential, in units that suit it: a machine of nanograms keeps the digits of one of kilograms."""

from __future__ import annotations

from scipy.linalg import expm, matrix_balance

from sysid_bench.nouns import Array


def balanced(A: Array) -> tuple[Array, Array]:
    """(B, units (nx,)): A (nx, nx) = diag(units) B diag(1 / units), units powers of two, so nothing is rounded.

    A norm that is large only by the units of the states costs a digit for each factor of ten wherever a matrix is
    squared or triangularised. James, Langou, Lowery 2014: On matrix balancing.
    """
    B, (units, _) = matrix_balance(A, permute=False, separate=True)
    return B, units


def exponential(A: Array) -> Array:
    """exp(A) of a square matrix, by scipy in balanced units."""
    B, units = balanced(A)
    return units[:, None] * expm(B) / units

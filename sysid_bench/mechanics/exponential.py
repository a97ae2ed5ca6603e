"""matrix -> its exponential, in units that suit it: a machine of nanograms keeps the digits of one of kilograms."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm, get_lapack_funcs

from sysid_bench.nouns import Array


def balanced(A: Array) -> tuple[Array, Array]:
    """(B, units (nx,)): A (nx, nx) = diag(units) B diag(1 / units), units powers of two, so nothing is rounded.

    A norm that is large only by the units of the states costs a digit for each factor of ten wherever a matrix is
    squared or triangularised. James, Langou, Lowery 2014: On matrix balancing.
    """
    A = np.asarray_chkfinite(A)
    gebal = get_lapack_funcs("gebal", (A,))  # scipy's matrix_balance warns of units from 2^63 on
    B, _, _, units, _ = gebal(A, scale=1, permute=0)
    return B, units


def exponential(A: Array) -> Array:
    """exp(A) of a square matrix, by scipy in balanced units."""
    B, units = balanced(A)
    return units[:, None] * expm(B) / units

"""information matrix -> its rank and condition, and the entries of M, D, K that the record cannot tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.second_order import pairs
from sysid_bench.nouns import Array

BLIND = 1e-12  # smallest eigenvalue over largest, unit diagonal: below it a direction has no information
SHARE = 0.1  # of a blind direction's largest component: entries that take part in it


@dataclass(frozen=True)
class Identifiability:
    """rank of the information of `count` unknowns, its condition, names of entries that cannot be told."""

    count: int
    rank: int
    condition: float
    untold: tuple[str, ...]


def entry_names(n: int) -> list[str]:
    """M[0,0], M[0,1], ... in the order of theta."""
    return [f"{name}[{i},{j}]" for name in "MDK" for i, j in pairs(n)]


@dataclass(frozen=True, eq=False)
class Directions:
    """Information scaled to a unit diagonal by d (nphi,), so that units play no part: its eigenvalues and vectors."""

    d: Array
    values: Array
    vectors: Array

    def inverse(self, blind: float) -> Array:
        """(nphi, nphi) of the information, without the directions below `blind` of the largest."""
        kept = self.values > blind * self.values[-1]
        vectors = self.vectors[:, kept] / self.d[:, None]
        return (vectors / self.values[kept]) @ vectors.T


def directions(H: Array) -> Directions:
    """Of H (nphi, nphi)."""
    d = np.sqrt(np.maximum(np.diag(H), 0.0))
    seen = d > 0
    unit = np.where(seen, d, 1.0)
    scaled = np.where(np.outer(seen, seen), H / np.outer(unit, unit), 0.0)
    return Directions(unit, *np.linalg.eigh((scaled + scaled.T) / 2))


def identifiability(found: Directions, names: Sequence[str]) -> Identifiability:
    """What the information of the named unknowns tells."""
    values, vectors = found.values, found.vectors
    blind = values < BLIND * values[-1]
    weight = np.abs(vectors[:, blind]).max(axis=1, initial=0.0)
    untold = (
        tuple(np.array(names)[weight > SHARE * max(weight.max(initial=0.0), 1e-300)]) if blind.any() else ()
    )
    return Identifiability(
        len(names), int((~blind).sum()), float(values[-1] / max(values[0], 1e-300)), untold
    )


def drowned(covariance: Array, theta: Array, n: int) -> tuple[str, ...]:
    """Entries of M and K whose 95 % interval reaches from zero to twice their size: this record hardly tells them.

    Small entries count as a quarter of the largest of their matrix; damping may be zero and is left out.
    """
    q = len(theta) // 3
    largest = np.abs(theta.reshape(3, q)).max(axis=1).repeat(q)
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    wide = error > 0.5 * np.maximum(np.abs(theta), largest / 4)
    wide[q : 2 * q] = False
    return tuple(np.array(entry_names(n))[wide])

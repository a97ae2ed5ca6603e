"""What a claim, its verdict and a misprint are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sysid_bench.papers.evidence import Tables

Numbers = tuple[float, float, float]  # as printed, as meant, exact
CONFIRMED, PARTLY, REFUTED = "confirmed", "confirmed in part", "refuted"


@dataclass(frozen=True)
class Verdict:
    """word: confirmed, confirmed in part, refuted. numbers: what shows it. runs: per point; 0 where exact."""

    word: str
    numbers: str
    runs: int = 0


@dataclass(frozen=True)
class Claim:
    """One claim of a paper: what it says, where, the studies it is judged on, and the judge."""

    text: str
    where: str
    studies: tuple[str, ...]
    judge: Callable[[Tables], Verdict]


@dataclass(frozen=True)
class Misprint:
    """One misprint: where, what is printed, what is meant; numbers() -> (printed, corrected, exact) of `quantity`.

    `exact` comes from first principles, not from either formula. numbers None: a matter of wording.
    """

    where: str
    printed: str
    meant: str
    quantity: str = ""
    numbers: Callable[[], Numbers] | None = None


def word(holds: bool, partly: bool = False) -> str:
    """The verdict's word: confirmed where it holds, confirmed in part where only some of it does."""
    return CONFIRMED if holds else PARTLY if partly else REFUTED


def number(x: float, digits: int = 2) -> str:
    """Significant digits, exponents only where the size needs them: 0.0123 -> 0.012, 137 -> 137, 2e-13."""
    if x == 0 or not 1e-4 <= abs(x) < 1e6:
        return f"{x:.{digits}g}"
    text = f"{x:.{digits}g}"
    return text if "e" not in text else f"{x:.0f}"


def percent(x: float) -> str:
    """0.0123 -> 1.2 %. Infinite where more than half of the runs gave no estimate."""
    if x == float("inf"):
        return "no estimate"
    return f"{number(100 * x)} %"

"""wrapped counter -> whole number: the value next to what is expected."""

from __future__ import annotations


def unwrap(value: int, bits: int, expected: int) -> int:
    """The number congruent to `value` modulo 2^bits that is nearest to `expected`."""
    span = 1 << bits
    return expected + (value - expected + span // 2) % span - span // 2

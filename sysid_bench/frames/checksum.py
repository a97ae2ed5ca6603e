"""bytes -> checksum byte, by the rule that a rig's yaml names."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from sysid_bench.nouns import InputError

RULES: dict[str, Callable[[bytes], int]] = {}


@lru_cache
def _table(polynomial: int) -> tuple[int, ...]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value << 1) ^ polynomial if value & 0x80 else value << 1
        table.append(value & 0xFF)
    return tuple(table)


def _crc8(polynomial: int, data: bytes) -> int:
    """CRC-8 with start value and final exclusive-or 0xFF (AUTOSAR, Specification of CRC Routines)."""
    table, crc = _table(polynomial), 0xFF
    for byte in data:
        crc = table[crc ^ byte]
    return crc ^ 0xFF


def crc8_j1850(data: bytes) -> int:
    return _crc8(0x1D, data)


def crc8_autosar(data: bytes) -> int:
    return _crc8(0x2F, data)


def xor8(data: bytes) -> int:
    value = 0
    for byte in data:
        value ^= byte
    return value


def sum8(data: bytes) -> int:
    return sum(data) & 0xFF


RULES.update(crc8_j1850=crc8_j1850, crc8_autosar=crc8_autosar, xor8=xor8, sum8=sum8)


def rule(name: str) -> Callable[[bytes], int]:
    """The function of a rule's name. Raises InputError for an unknown one."""
    if name not in RULES:
        raise InputError(f"checksum.rule must be one of {', '.join(RULES)}; got {name!r}.")
    return RULES[name]

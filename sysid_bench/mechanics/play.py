"""tape -> numbers: the compiled interpreter of laws, one switch per elementary operation."""

from __future__ import annotations

import math

import numba as nb

from sysid_bench.mechanics.compiled import UNCOUNTED

# fmt: off
NAMES = (
    "ADD SUB MUL DIV POW CONSTPOW LT LE EQ NE AND OR FMOD COPYSIGN IF_ELSE_ZERO FMIN FMAX ATAN2 HYPOT "
    "NEG EXP LOG SQRT SQ TWICE SIN COS TAN ASIN ACOS ATAN NOT FLOOR CEIL FABS SIGN ERF INV SINH COSH TANH LOG1P EXPM1"
).split()
(ADD, SUB, MUL, DIV, POW, CONSTPOW, LT, LE, EQ, NE, AND, OR, FMOD, COPYSIGN, IF_ELSE_ZERO, FMIN, FMAX, ATAN2, HYPOT, NEG, EXP, LOG, SQRT, SQ, TWICE, SIN, COS, TAN, ASIN, ACOS, ATAN, NOT, FLOOR, CEIL, FABS, SIGN, ERF, INV, SINH, COSH, TANH, LOG1P, EXPM1) = range(43)
# fmt: on
CODES = {name: code for code, name in enumerate(NAMES)}


@nb.njit(**UNCOUNTED, forceinline=True)
def play(operations, first, last, cells):
    """Run operations first..last on the cells. Their numbers are unsigned: no index counts from the end."""
    for k in range(first, last):
        code, a = operations[k, 0], cells[operations[k, 2]]
        if code < NEG:
            cells[operations[k, 1]] = _of_two(code, a, cells[operations[k, 3]])
        else:
            cells[operations[k, 1]] = _of_one(code, a)


@nb.njit(**UNCOUNTED, forceinline=True)
def play_rows(operations, cells):
    """Run all operations on cells (nc, K): K laws of one kind at once, which share the work of reading the tape."""
    for k in range(len(operations)):
        code, to, a, b = operations[k, 0], operations[k, 1], operations[k, 2], operations[k, 3]
        if code == ADD:
            for j in range(cells.shape[1]):
                cells[to, j] = cells[a, j] + cells[b, j]
        elif code == SUB:
            for j in range(cells.shape[1]):
                cells[to, j] = cells[a, j] - cells[b, j]
        elif code == MUL:
            for j in range(cells.shape[1]):
                cells[to, j] = cells[a, j] * cells[b, j]
        elif code == DIV:
            for j in range(cells.shape[1]):
                cells[to, j] = cells[a, j] / cells[b, j]
        elif code == POW or code == CONSTPOW:
            for j in range(cells.shape[1]):
                cells[to, j] = _power(cells[a, j], cells[b, j])
        elif code == FABS:
            for j in range(cells.shape[1]):
                cells[to, j] = abs(cells[a, j])
        elif code == SIGN:
            for j in range(cells.shape[1]):
                cells[to, j] = (cells[a, j] > 0.0) - (cells[a, j] < 0.0)
        elif code == FMIN:
            for j in range(cells.shape[1]):
                cells[to, j] = cells[a, j] if cells[a, j] < cells[b, j] else cells[b, j]
        elif code == FMAX:
            for j in range(cells.shape[1]):
                cells[to, j] = cells[a, j] if cells[a, j] > cells[b, j] else cells[b, j]
        elif code < NEG:
            for j in range(cells.shape[1]):
                cells[to, j] = _of_two(code, cells[a, j], cells[b, j])
        else:
            for j in range(cells.shape[1]):
                cells[to, j] = _of_one(code, cells[a, j])


@nb.njit(**UNCOUNTED, forceinline=True)
def _power(a, b):
    """a**b, by products where b is 1 or 2, as the exponents of most laws are."""
    if b == 1.0:
        return a
    if b == 2.0:
        return a * a
    return a**b


@nb.njit(**UNCOUNTED, forceinline=True)
def _of_two(code, a, b):
    if code == ADD:
        return a + b
    if code == SUB:
        return a - b
    if code == MUL:
        return a * b
    if code == DIV:
        return a / b
    if code == POW or code == CONSTPOW:
        return _power(a, b)
    if code == LT:
        return 1.0 if a < b else 0.0
    if code == LE:
        return 1.0 if a <= b else 0.0
    if code == EQ:
        return 1.0 if a == b else 0.0
    if code == NE:
        return 1.0 if a != b else 0.0
    if code == AND:
        return 1.0 if a != 0.0 and b != 0.0 else 0.0
    if code == OR:
        return 1.0 if a != 0.0 or b != 0.0 else 0.0
    if code == FMOD:
        return a - b * float(math.trunc(a / b))
    if code == COPYSIGN:
        return math.copysign(a, b)
    if code == IF_ELSE_ZERO:
        return b if a != 0.0 else 0.0
    if code == FMIN:
        return min(a, b)
    if code == FMAX:
        return max(a, b)
    if code == ATAN2:
        return math.atan2(a, b)
    if code == HYPOT:
        return math.hypot(a, b)
    return math.nan


@nb.njit(**UNCOUNTED, forceinline=True)
def _of_one(code, a):
    if code == NEG:
        return -a
    if code == EXP:
        return math.exp(a)
    if code == LOG:
        return math.log(a)
    if code == SQRT:
        return math.sqrt(a)
    if code == SQ:
        return a * a
    if code == TWICE:
        return 2.0 * a
    if code == SIN:
        return math.sin(a)
    if code == COS:
        return math.cos(a)
    if code == TAN:
        return math.tan(a)
    if code == ASIN:
        return math.asin(a)
    if code == ACOS:
        return math.acos(a)
    if code == ATAN:
        return math.atan(a)
    if code == NOT:
        return 1.0 if a == 0.0 else 0.0
    if code == FLOOR:
        return float(math.floor(a))
    if code == CEIL:
        return float(math.ceil(a))
    if code == FABS:
        return abs(a)
    if code == SIGN:
        return 1.0 if a > 0.0 else (-1.0 if a < 0.0 else 0.0)
    if code == ERF:
        return math.erf(a)
    if code == INV:
        return 1.0 / a
    if code == SINH:
        return math.sinh(a)
    if code == COSH:
        return math.cosh(a)
    if code == TANH:
        return math.tanh(a)
    if code == LOG1P:
        return math.log1p(a)
    if code == EXPM1:
        return math.expm1(a)
    return math.nan

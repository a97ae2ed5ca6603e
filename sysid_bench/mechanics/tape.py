"""CasADi expression -> tape: the elementary operations of an effect's law, run by a small compiled interpreter.

A law is written once, as an expression, and its derivatives come from CasADi; the simulation loop reads the
tape. So an effect of the user's own runs as fast as the catalogue's, and nothing is compiled for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numba as nb
import numpy as np

from sysid_bench.nouns import Array, InputError

# fmt: off
NAMES = (
    "ASSIGN ADD SUB MUL DIV NEG EXP LOG POW CONSTPOW SQRT SQ TWICE SIN COS TAN ASIN ACOS ATAN "
    "LT LE EQ NE NOT AND OR FLOOR CEIL FMOD FABS SIGN COPYSIGN IF_ELSE_ZERO ERF FMIN FMAX INV "
    "SINH COSH TANH ATAN2 HYPOT LOG1P EXPM1 CONST INPUT OUTPUT"
).split()
(ASSIGN, ADD, SUB, MUL, DIV, NEG, EXP, LOG, POW, CONSTPOW, SQRT, SQ, TWICE, SIN, COS, TAN, ASIN, ACOS, ATAN, LT, LE, EQ, NE, NOT, AND, OR, FLOOR, CEIL, FMOD, FABS, SIGN, COPYSIGN, IF_ELSE_ZERO, ERF, FMIN, FMAX, INV, SINH, COSH, TANH, ATAN2, HYPOT, LOG1P, EXPM1, CONST, INPUT, OUTPUT) = range(47)
# fmt: on
_OPCODES = {getattr(ca, name): name.removeprefix("OP_") for name in dir(ca) if name.startswith("OP_")}
_CODE = {name: code for code, name in enumerate(NAMES)}


@dataclass(frozen=True, eq=False)
class Tape:
    """operations (m, 4) int64: code, out, first, second; constants (m,); work cells; number of outputs."""

    operations: np.ndarray
    constants: Array
    work: int
    outputs: int


def tape(function: ca.Function) -> Tape:
    """Tape of an SX function of one input vector and one output vector. Raises InputError on an unknown operation."""
    rows, constants = [], []
    for k in range(function.n_instructions()):
        name = _OPCODES[function.instruction_id(k)]
        if name not in _CODE:
            known = ", ".join(NAMES[1:44]).lower()
            raise InputError(f"an effect's law uses {name.lower()}; it may use {known}.")
        into, out = list(function.instruction_input(k)), function.instruction_output(k)
        into = [into[1]] if name == "INPUT" else into
        out = [out[1]] if name == "OUTPUT" else out
        rows.append([_CODE[name], out[0], *(into + into + [0, 0])[:2]])
        constants.append(function.instruction_constant(k) if name == "CONST" else 0.0)
    operations = np.array(rows, dtype=np.int64).reshape(-1, 4)
    return Tape(operations, np.array(constants, dtype=float), function.sz_w(), function.nnz_out())


def join(tapes: list[Tape]) -> tuple[np.ndarray, Array, np.ndarray, int]:
    """Tapes end to end: operations, constants, first row of each (len + 1), work cells needed."""
    starts = np.cumsum([0, *(len(one.operations) for one in tapes)]).astype(np.int64)
    if not tapes:
        return np.zeros((0, 4), dtype=np.int64), np.zeros(0), starts, 1
    operations = np.concatenate([one.operations for one in tapes])
    return (
        operations,
        np.concatenate([one.constants for one in tapes]),
        starts,
        max(one.work for one in tapes),
    )


def over(one: Tape, given: list) -> list:
    """Outputs of a tape for whole arrays at once: given holds one array or number per input."""
    work: list = [0.0] * max(one.work, 1)
    result: list = [0.0] * one.outputs
    for (code, out, first, second), constant in zip(one.operations.tolist(), one.constants.tolist()):
        if code == INPUT:
            work[out] = given[first]
        elif code == CONST:
            work[out] = constant
        elif code == OUTPUT:
            result[out] = work[first]
        else:
            work[out] = _ARRAY[code](work[first], work[second])
    return result


_ARRAY = {
    ASSIGN: lambda a, b: a, ADD: lambda a, b: a + b, SUB: lambda a, b: a - b, MUL: lambda a, b: a * b,
    DIV: lambda a, b: a / b, NEG: lambda a, b: -a, EXP: lambda a, b: np.exp(a), LOG: lambda a, b: np.log(a),
    POW: lambda a, b: a**b, CONSTPOW: lambda a, b: a**b, SQRT: lambda a, b: np.sqrt(a), SQ: lambda a, b: a * a,
    TWICE: lambda a, b: 2.0 * a, SIN: lambda a, b: np.sin(a), COS: lambda a, b: np.cos(a), TAN: lambda a, b: np.tan(a),
    ASIN: lambda a, b: np.arcsin(a), ACOS: lambda a, b: np.arccos(a), ATAN: lambda a, b: np.arctan(a),
    LT: lambda a, b: 1.0 * (a < b), LE: lambda a, b: 1.0 * (a <= b), EQ: lambda a, b: 1.0 * (a == b),
    NE: lambda a, b: 1.0 * (a != b), NOT: lambda a, b: 1.0 * (a == 0), AND: lambda a, b: 1.0 * ((a != 0) & (b != 0)),
    OR: lambda a, b: 1.0 * ((a != 0) | (b != 0)), FLOOR: lambda a, b: np.floor(a), CEIL: lambda a, b: np.ceil(a),
    FMOD: lambda a, b: np.fmod(a, b), FABS: lambda a, b: np.abs(a), SIGN: lambda a, b: np.sign(a),
    COPYSIGN: lambda a, b: np.copysign(a, b), IF_ELSE_ZERO: lambda a, b: np.where(a != 0, b, 0.0),
    ERF: lambda a, b: np.vectorize(math.erf)(a), FMIN: lambda a, b: np.minimum(a, b), FMAX: lambda a, b: np.maximum(a, b),
    INV: lambda a, b: 1.0 / a, SINH: lambda a, b: np.sinh(a), COSH: lambda a, b: np.cosh(a), TANH: lambda a, b: np.tanh(a),
    ATAN2: lambda a, b: np.arctan2(a, b), HYPOT: lambda a, b: np.hypot(a, b), LOG1P: lambda a, b: np.log1p(a),
    EXPM1: lambda a, b: np.expm1(a),
}  # fmt: skip


@nb.njit(cache=True, error_model="numpy")
def _of_one(code, a):
    if code == ASSIGN:
        return a
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


@nb.njit(cache=True, error_model="numpy")
def _of_two(code, a, b):
    if code == ADD:
        return a + b
    if code == SUB:
        return a - b
    if code == MUL:
        return a * b
    if code == DIV:
        return a / b
    if code == POW:
        return a**b
    if code == CONSTPOW:
        return a**b
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


@nb.njit(cache=True, error_model="numpy")
def play(operations, constants, first, last, given, work, result):
    """Run rows first..last on the input vector `given`; writes `result`."""
    for k in range(first, last):
        code, out = operations[k, 0], operations[k, 1]
        if code == INPUT:
            work[out] = given[operations[k, 2]]
        elif code == CONST:
            work[out] = constants[k]
        elif code == OUTPUT:
            result[out] = work[operations[k, 2]]
        elif code == MUL:
            work[out] = work[operations[k, 2]] * work[operations[k, 3]]
        elif code == ADD:
            work[out] = work[operations[k, 2]] + work[operations[k, 3]]
        elif code == SUB:
            work[out] = work[operations[k, 2]] - work[operations[k, 3]]
        elif code in (
            DIV,
            POW,
            CONSTPOW,
            LT,
            LE,
            EQ,
            NE,
            AND,
            OR,
            FMOD,
            COPYSIGN,
            IF_ELSE_ZERO,
            FMIN,
            FMAX,
            ATAN2,
            HYPOT,
        ):
            work[out] = _of_two(code, work[operations[k, 2]], work[operations[k, 3]])
        else:
            work[out] = _of_one(code, work[operations[k, 2]])

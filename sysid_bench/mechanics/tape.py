"""CasADi expression -> tape: the elementary operations of an effect's law, run by a small compiled interpreter.

A law is written once, as an expression, and its derivatives come from CasADi; the simulation loop reads the
tape. So an effect of the user's own runs as fast as the catalogue's, and nothing is compiled for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from sysid_bench.mechanics.play import CODES, NAMES
from sysid_bench.nouns import Array, InputError

EMPTY = np.zeros((0, 4), dtype=np.uint64)
_OPCODES = {getattr(ca, name): name.removeprefix("OP_") for name in dir(ca) if name.startswith("OP_")}


@dataclass(frozen=True, eq=False)
class Tape:
    """A law as operations on numbered cells: first its inputs, then constants (nc,), then what each operation gives.

    operations (m, 4) unsigned: code, cell of the result, of the first and of the second operand; results (k,): cells of
    the outputs; steady: number of the first operations, which depend on no input that varies during a run
    """

    inputs: int
    constants: Array
    operations: np.ndarray
    results: np.ndarray
    steady: int = 0

    @property
    def cells(self) -> int:
        return self.inputs + len(self.constants) + len(self.operations)


def tape(function: ca.Function, varying: frozenset[int]) -> Tape:
    """Tape of an SX function of one input vector and one output vector. Raises InputError on an unknown operation.

    varying: numbers of the inputs that vary during a run
    """
    count, inputs = function.n_instructions(), function.nnz_in()
    kinds = [_OPCODES[function.instruction_id(k)] for k in range(count)]
    constants = [float(function.instruction_constant(k)) for k in range(count) if kinds[k] == "CONST"]
    # cell that holds now what CasADi keeps in each place of its own work vector, which it uses again and again
    held, rows, results = {}, [], np.zeros(function.nnz_out(), dtype=np.uint64)
    fixed, free = inputs, inputs + len(constants)
    for k, kind in enumerate(kinds):
        into, out = function.instruction_input(k), function.instruction_output(k)
        if kind == "INPUT":
            held[out[0]] = into[1]
        elif kind == "CONST":
            held[out[0]], fixed = fixed, fixed + 1
        elif kind == "OUTPUT":
            results[out[1]] = held[into[0]]
        elif kind == "ASSIGN":
            held[out[0]] = held[into[0]]
        elif kind in CODES:
            operands = [held[i] for i in into]
            rows.append([CODES[kind], free, operands[0], operands[-1]])
            held[out[0]], free = free, free + 1
        else:
            raise InputError(f"an effect's law uses {kind.lower()}; it may use {', '.join(NAMES).lower()}.")
    steady, rest = _parted(rows, varying)
    operations = np.array(steady + rest, dtype=np.uint64).reshape(-1, 4)
    return Tape(inputs, np.array(constants), operations, results, len(steady))


def _parted(rows: list[list[int]], varying: frozenset[int]) -> tuple[list, list]:
    """Operations that depend on no varying input, and those that do, each in their order."""
    moving, parts = set(varying), ([], [])
    for row in rows:
        moves = not moving.isdisjoint(row[2:])
        parts[moves].append(row)
        if moves:
            moving.add(row[1])
    return parts


@dataclass(frozen=True, eq=False)
class Joined:
    """Tapes end to end on one row of cells, as the compiled loops read them.

    operations (m, 4); results (k,); laws (ne, 6): cell of the first input, first and last operation, first and last result,
    first operation that is not steady; cells (nc,): constants in their places
    """

    operations: np.ndarray
    results: np.ndarray
    laws: np.ndarray
    cells: Array

    @property
    def code(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All but the cells, for a compiled loop."""
        return self.operations, self.results, self.laws


def join(tapes: list[Tape]) -> Joined:
    """Tapes end to end."""
    sizes = np.array([(x.cells, len(x.operations), len(x.results)) for x in tapes], dtype=int).reshape(-1, 3)
    bases, ends, last = np.pad(np.cumsum(sizes, axis=0), ((1, 0), (0, 0))).T
    cells, steady = np.zeros(bases[-1]), np.array([x.steady for x in tapes], dtype=int)
    for one, base in zip(tapes, bases):
        at = base + one.inputs
        cells[at : at + len(one.constants)] = one.constants
    shift = np.array([0, 1, 1, 1], dtype=np.uint64)
    return Joined(
        np.concatenate([*(x.operations + shift * np.uint64(at) for x, at in zip(tapes, bases)), EMPTY]),
        np.concatenate([*(x.results + np.uint64(at) for x, at in zip(tapes, bases)), EMPTY[:, 0]]),
        np.column_stack([bases[:-1], ends[:-1], ends[1:], last[:-1], last[1:], ends[:-1] + steady]),
        cells,
    )


def over(one: Tape, given: list) -> list:
    """Outputs of a tape for whole arrays at once: given holds one array or number per input."""
    return next(over_each(one, [given]))


def over_each(one: Tape, many: Iterable[list]) -> Iterator[list]:
    """The same for one list of inputs after another: what depends on none that changed since the last is kept."""
    cells: list = [*[None] * one.inputs, *one.constants.tolist(), *([0.0] * len(one.operations))]
    operations, results = one.operations.tolist(), one.results.tolist()
    changed = set(range(len(cells)))
    for given in many:
        for k, (now, last) in enumerate(zip(given, cells)):
            if now is not last and not (type(now) is type(last) is float and now == last):
                changed.add(k)
        cells[: len(given)] = given
        for code, to, first, second in operations:
            if first in changed or second in changed:
                cells[to] = _ARRAY[code](cells[first], cells[second])
                changed.add(to)
        yield [cells[k] for k in results]
        changed.clear()


def _if_else_zero(a, b):
    if isinstance(a, float):  # a choice for the whole array
        return b if a != 0 else 0.0
    return np.where(a != 0, b, 0.0)


_ARRAY = [
    {
        "ADD": lambda a, b: a + b, "SUB": lambda a, b: a - b, "MUL": lambda a, b: a * b,
        "DIV": lambda a, b: a / b, "NEG": lambda a, b: -a, "EXP": lambda a, b: np.exp(a), "LOG": lambda a, b: np.log(a),
        "POW": lambda a, b: a**b, "CONSTPOW": lambda a, b: a**b, "SQRT": lambda a, b: np.sqrt(a), "SQ": lambda a, b: a * a,
        "TWICE": lambda a, b: 2.0 * a, "SIN": lambda a, b: np.sin(a), "COS": lambda a, b: np.cos(a), "TAN": lambda a, b: np.tan(a),
        "ASIN": lambda a, b: np.arcsin(a), "ACOS": lambda a, b: np.arccos(a), "ATAN": lambda a, b: np.arctan(a),
        "LT": lambda a, b: 1.0 * (a < b), "LE": lambda a, b: 1.0 * (a <= b), "EQ": lambda a, b: 1.0 * (a == b),
        "NE": lambda a, b: 1.0 * (a != b), "NOT": lambda a, b: 1.0 * (a == 0), "AND": lambda a, b: 1.0 * ((a != 0) & (b != 0)),
        "OR": lambda a, b: 1.0 * ((a != 0) | (b != 0)), "FLOOR": lambda a, b: np.floor(a), "CEIL": lambda a, b: np.ceil(a),
        "FMOD": lambda a, b: np.fmod(a, b), "FABS": lambda a, b: np.abs(a), "SIGN": lambda a, b: np.sign(a),
        "COPYSIGN": lambda a, b: np.copysign(a, b), "IF_ELSE_ZERO": _if_else_zero,
        "ERF": lambda a, b: np.vectorize(math.erf)(a), "FMIN": lambda a, b: np.minimum(a, b), "FMAX": lambda a, b: np.maximum(a, b),
        "INV": lambda a, b: 1.0 / a, "SINH": lambda a, b: np.sinh(a), "COSH": lambda a, b: np.cosh(a), "TANH": lambda a, b: np.tanh(a),
        "ATAN2": lambda a, b: np.arctan2(a, b), "HYPOT": lambda a, b: np.hypot(a, b), "LOG1P": lambda a, b: np.log1p(a),
        "EXPM1": lambda a, b: np.expm1(a),
    }[name]
    for name in NAMES
]  # fmt: skip

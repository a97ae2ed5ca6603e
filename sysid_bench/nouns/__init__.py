"""READ FIRST: the nouns of the suite and the promises of every shelf.

words        the types of arrays, the closed lists (holds, outputs, statuses, quality bits), the ways to say no
record       Record: t, u, y of one run
model        Model: what a method is handed; Effect (promise): a term of its equation, its actuator or sensor
plant        Plant: the truth of a simulated experiment
experiment   Signal, Sampling, Acquired; Excitation, Noise, Source (promises)
estimate     Estimate: M, D, K and how sure; Method (promise): fit(record, model) -> Estimate
grid         Task, Cell: a study's work; Analysis, Executor (promises)

All are imported from here. Shapes: time first, always two-dimensional: t (N,), u (N, nu), y (N, ny), q (N, n). SI units inside.
"""

from sysid_bench.nouns.estimate import Estimate, Method
from sysid_bench.nouns.experiment import Acquired, Excitation, Noise, Sampling, Signal, Source
from sysid_bench.nouns.grid import Analysis, Cell, Executor, Task
from sysid_bench.nouns.model import Effect, Model
from sysid_bench.nouns.plant import Plant
from sysid_bench.nouns.record import Record
from sysid_bench.nouns.words import (
    CLIPPED,
    CORRUPTED,
    DUPLICATED,
    HOLDS,
    LATE,
    LOST,
    OUTPUTS,
    REORDERED,
    STATUSES,
    STUCK,
    UNIFORM_STEP_RTOL,
    Array,
    Complex,
    Diverged,
    Hold,
    InputError,
    NotApplicable,
    Output,
    Status,
    frozen_array,
)

__all__ = [
    "CLIPPED",
    "CORRUPTED",
    "DUPLICATED",
    "HOLDS",
    "LATE",
    "LOST",
    "OUTPUTS",
    "REORDERED",
    "STATUSES",
    "STUCK",
    "UNIFORM_STEP_RTOL",
    "Acquired",
    "Analysis",
    "Array",
    "Cell",
    "Complex",
    "Diverged",
    "Effect",
    "Estimate",
    "Excitation",
    "Executor",
    "Hold",
    "InputError",
    "Method",
    "Model",
    "Noise",
    "NotApplicable",
    "Output",
    "Plant",
    "Record",
    "Sampling",
    "Signal",
    "Source",
    "Status",
    "Task",
    "frozen_array",
]

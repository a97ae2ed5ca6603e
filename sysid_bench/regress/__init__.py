"""Regression of error tables: exact at the same seeds, paired statistics over many, claims on fresh seeds."""

from sysid_bench.regress.claims import Claim, Measured, judge, measure
from sysid_bench.regress.exact import compare_exact
from sysid_bench.regress.paired import FEWEST_PAIRS, compare_paired
from sysid_bench.regress.reference import (
    COMPARED,
    ERRORS,
    Change,
    medians,
    part_of,
    read_reference,
    reference_rows,
    text_of,
)

__all__ = [
    "COMPARED",
    "ERRORS",
    "FEWEST_PAIRS",
    "Change",
    "Claim",
    "Measured",
    "compare_exact",
    "compare_paired",
    "judge",
    "measure",
    "medians",
    "part_of",
    "read_reference",
    "reference_rows",
    "text_of",
]

"""Regression of error tables: exact at the same seeds, paired statistics over many."""

from sysid_bench.regress.exact import compare_exact
from sysid_bench.regress.paired import compare_paired
from sysid_bench.regress.reference import Change, read_reference, reference_rows, text_of

__all__ = ["Change", "compare_exact", "compare_paired", "read_reference", "reference_rows", "text_of"]

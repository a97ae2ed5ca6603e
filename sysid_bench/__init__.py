"""Benchmark and experiment orchestration for identifying M q'' + D q' + K q = L u from sampled data."""

__version__ = "0.1.0"

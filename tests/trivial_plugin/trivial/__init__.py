"""A trivial analysis."""

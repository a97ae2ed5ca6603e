"""Excitations: seeded input signals that know how they run between samples."""

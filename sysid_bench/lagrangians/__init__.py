"""Mechanical systems given by a Lagrangian, dissipation and input map, one file each."""

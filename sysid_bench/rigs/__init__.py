"""Shelf of rigs: a DBC file and a yaml say what a device speaks."""

"""Shelf of buses: how frames travel. Each opens a Link; loopback only unless an interface is named."""

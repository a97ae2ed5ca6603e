"""Noises: what a measurement adds to, or does to, the noise-free output."""

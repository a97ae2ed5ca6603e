"""Doors: one file per verb, `main(cfg) -> exit code`."""

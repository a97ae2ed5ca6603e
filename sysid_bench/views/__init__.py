"""results folder -> figures, reports, rerun recordings. Reads files only; nothing imports it but the doors."""

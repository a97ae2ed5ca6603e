"""CAN frames: what both ends of a bus share. Numbers <-> frames, checksums, counters, bus load."""

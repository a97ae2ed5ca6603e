"""The device when there is none: a process of its own that knows the plant and speaks only the bus."""

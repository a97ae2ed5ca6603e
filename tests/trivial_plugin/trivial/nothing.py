"""settings -> one random number: a cell that costs nothing, so that the engine is what is seen."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Nothing:
    """Answers one number."""

    value: float = 0.0

    def compute(self, plant, sampling, rng):
        return {"value": self.value + rng.random()}

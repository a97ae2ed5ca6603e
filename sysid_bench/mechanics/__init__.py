"""The mathematics that shelves share: matrices, holds, sensitivities, bounds."""

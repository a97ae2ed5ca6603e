"""The mathematics that shelves share: matrices, holds, sensitivities, bounds."""

from sysid_bench.mechanics.compiled import prepare

prepare()

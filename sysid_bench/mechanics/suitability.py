"""record, model -> nothing, or the reason why a method that wants plain samples cannot take them."""

from __future__ import annotations

from sysid_bench.nouns import InputError, Model, NotApplicable, Record


def require_plain(record: Record, model: Model, method: str) -> None:
    """Even steps and good samples only (NotApplicable), channels as the model has them (InputError)."""
    require_channels(record, model)
    if not record.is_uniform:
        raise NotApplicable(f"{method} wants a constant sampling time; the steps of this record are uneven.")
    if not record.all_good:
        raise NotApplicable(f"{method} wants every sample good; this record has flagged samples.")


def require_channels(record: Record, model: Model) -> None:
    """Raises InputError where the record has other channels than the model's maps."""
    for name, got, wanted in (("input", record.nu, model.nu), ("output", record.ny, model.ny)):
        if got != wanted:
            raise InputError(
                f"the model's {name}_map is for {wanted} {name}s; the record has {got}. "
                f"Give an {name}_map that fits the record."
            )


def hold_of(record: Record, model: Model) -> str:
    """The hold that the model states, else the record's, else zoh."""
    return model.hold or record.hold or "zoh"

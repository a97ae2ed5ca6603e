"""The files beside records: model.yaml, estimate.json, and how every file is written whole or not at all."""

from sysid_bench.files.disk import atomic_write, plain, read_json, results_folder, sha256, write_json
from sysid_bench.files.estimate import model_of, read_estimate, write_estimate
from sysid_bench.files.model import plant_of, read_model, write_model

__all__ = [
    "atomic_write", "model_of", "plain", "plant_of", "read_estimate", "read_json", "read_model", "results_folder",
    "sha256", "write_estimate", "write_json", "write_model",
]  # fmt: skip

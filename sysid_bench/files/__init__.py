"""The files beside records: model.yaml, estimate.json, and how every file is written whole."""

from .disk import atomic_write, plain, read_json, sha256, write_json

__all__ = ["atomic_write", "plain", "read_json", "sha256", "write_json"]

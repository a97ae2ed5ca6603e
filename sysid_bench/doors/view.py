"""a record, a study, an identify or a gap folder, or a .rrd -> the rerun viewer."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from sysid_bench.nouns import InputError
from sysid_bench.records import SUFFIXES

# What each kind of folder is known by -> its recording.
FOLDERS = {"table.parquet": "study.rrd", "estimate.json": "identify.rrd", "gap.json": "gap.rrd"}


def main(cfg: dict[str, Any]) -> int:
    """Show, serve, save or picture what lies at cfg["path"]; 0, or the viewer's exit code."""
    if not cfg["path"]:
        raise InputError(
            "view needs a path: a record, the folder of a study, an identify or a gap run, or a .rrd file."
        )
    with tempfile.TemporaryDirectory(prefix="sysid-bench-view-") as scratch:
        rrd = recording_of(Path(cfg["path"]), Path(scratch))
        return _present(rrd, cfg)


def _present(rrd: Path, cfg: dict[str, Any]) -> int:
    from sysid_bench.views import viewer

    if cfg["out"]:
        print(shutil.copyfile(rrd, _target(cfg["out"], ".rrd")))
    if cfg["screenshot"]:
        print(viewer.picture(rrd, _target(cfg["screenshot"], ".png"), str(cfg["size"])))
    if cfg["serve"]:
        return viewer.serve(rrd)
    if cfg["out"] or cfg["screenshot"]:
        return 0
    if viewer.has_display():
        return viewer.show(rrd)
    print(f"There is no display here. Instead: sysid-bench view {cfg['path']} with serve=true (in a browser of this "
          "machine), screenshot=FILE.png, or out=FILE.rrd (open it with rerun elsewhere).")  # fmt: skip
    return 0


def recording_of(path: Path, scratch: Path) -> Path:
    """The .rrd of a path; a record is converted into the folder `scratch`, a study without one gets its own.

    Raises InputError where the path is nothing that can be shown.
    """
    if path.is_dir():
        return _of_folder(path)
    if not path.is_file():
        raise InputError(f"{path} does not exist; give a record, a results folder or a .rrd file.")
    if path.suffix.lower() == ".rrd":
        return path
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{path} cannot be shown; known are {', '.join(SUFFIXES)}, .rrd and results folders."
        )
    from sysid_bench.records import read_record
    from sysid_bench.views.rerun_record import write_record_rrd

    return write_record_rrd(read_record(path), scratch / f"{path.stem}.rrd", path.name)


def _of_folder(folder: Path) -> Path:
    for mark, name in FOLDERS.items():
        if (folder / mark).is_file():
            if not (folder / name).is_file() and name == "study.rrd":
                from sysid_bench.views.study import write_views

                write_views(folder)
            if (folder / name).is_file():
                return folder / name
            raise InputError(f"{folder} has {mark} but no {name}; make it again with the verb that wrote it.")
    raise InputError(f"{folder} holds nothing to show: none of {', '.join(FOLDERS)} is in it.")


def _target(name: str, suffix: str) -> Path:
    path = Path(name)
    if path.suffix.lower() != suffix or not path.parent.is_dir():
        raise InputError(f"{path} must be a {suffix} file in a folder that exists.")
    return path

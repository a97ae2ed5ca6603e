"""record -> black-box model by Octave's control package (SLICOT) in a process of its own, M, D, K projected."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid_bench.mechanics.black_box import estimate_of_black_box
from sysid_bench.mechanics.suitability import require_plain
from sysid_bench.nouns import Diverged, Estimate, InputError, Model, NotApplicable, Record

SCRIPT = """
pkg load control
data = load('{data}');
dat = iddata(data(:, {nu} + 1:end), data(:, 1:{nu}), {h});
tic;
[sys, x0] = {algorithm}(dat, {order}, 's', {horizon}, 'noise', 'n', 'rcond', 0.0, 'tol', -1.0);
seconds = toc;
f = fopen('{out}', 'w');
fprintf(f, '{{"seconds": %.9g', seconds);
names = {{'a', 'b', 'c', 'd'}};
for k = 1:4
  X = sys.(names{{k}})';
  fprintf(f, ', "%s": [%s]', names{{k}}, strjoin(arrayfun(@(x) sprintf('%.17g', x), X(:)', 'UniformOutput', false), ','));
end
fprintf(f, '}}');
fclose(f);
"""
LIMIT_S = 120


@dataclass(frozen=True)
class PeerOctave:
    """algorithm: n4sid | moen4 (moesp crashes in SLICOT); horizon: block rows, null: the package's own choice.

    `seconds` of a row counts the start of Octave (about 1 s); the diagnostic octave_s is the fit alone.
    """

    algorithm: str = "n4sid"
    horizon: int | None = 20

    nominal = False

    def __post_init__(self) -> None:
        if self.algorithm not in ("n4sid", "moen4"):
            raise InputError(f"algorithm of octave must be n4sid or moen4; got {self.algorithm!r}.")

    def fit(self, record: Record, model: Model) -> Estimate:
        """Raises NotApplicable without Octave and its control package, Diverged where it fails."""
        require_plain(record, model, "octave")
        if shutil.which("octave-cli") is None:
            raise NotApplicable("Octave is not installed: apt-get install octave octave-control.")
        su, sy = record.u.std(axis=0), record.y.std(axis=0)
        found = self._run(np.hstack([record.u / su, record.y / sy]), record, 2 * model.n)
        nx, nu, ny = 2 * model.n, record.nu, record.ny
        A, B, C, D = (
            np.reshape(found[k], size) for k, size in zip("abcd", ((nx, nx), (nx, nu), (ny, nx), (ny, nu)))
        )
        scaled = (A, B / su, C * sy[:, None], D * sy[:, None] / su)
        return estimate_of_black_box(*scaled, record.h, model, {"octave_s": found["seconds"]})

    def _run(self, data: np.ndarray, record: Record, order: int) -> dict:
        with tempfile.TemporaryDirectory() as folder:
            table, out, script = (Path(folder) / name for name in ("data.txt", "out.json", "fit.m"))
            np.savetxt(table, data, fmt="%.17g")
            text = SCRIPT.format(
                data=table, out=out, nu=record.nu, h=record.h, algorithm=self.algorithm, order=order,
                horizon=self.horizon or "[]",
            )  # fmt: skip
            script.write_text(text if self.horizon else text.replace(" 's', [],", ""))
            command = ["octave-cli", "--quiet", "--no-init-file", str(script)]
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
            except subprocess.TimeoutExpired:
                raise Diverged(f"octave took more than {LIMIT_S} s.") from None
            if "control" in done.stderr and "not installed" in done.stderr:
                raise NotApplicable(
                    "Octave's control package is not installed: apt-get install octave-control."
                )
            if done.returncode or not out.exists():
                raise Diverged(f"octave failed: {' '.join(done.stderr.split())[-200:]}")
            return json.loads(out.read_text())

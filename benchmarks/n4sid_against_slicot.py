"""n4sid here against SLICOT's (Octave control), same records: error of the poles and seconds, as ratios.

Three masses, N = 6000, h = 0.1 s, cubic force of Ta = 0.2 s, 15 dB. Without Octave it says so and stops.
"""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.second_order import poles, state_space
from sysid_bench.methods.n4sid import N4sid
from sysid_bench.nouns import Model, Record

N, H, TA, SNR_DB, SEEDS, REPEATS = 6000, 0.1, 0.2, 15.0, range(3), 15
HORIZONS = (10, 20)
K = np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]])
PLANT = (np.diag([0.8, 2.0, 1.2]), K / 10, K)

OCTAVE = """
pkg load control
data = load('{data}');
seconds = zeros(1, {repeats});
dat = iddata(data(:, {nu} + 1:end), data(:, 1:{nu}), {h});
for k = 1:{repeats}
  tic;
  [sys, x0] = n4sid(dat, {order}, 's', {horizon}, 'noise', 'n', 'rcond', 0.0, 'tol', -1.0);
  seconds(k) = toc;
end
p = eig(sys.a);
printf('{{"seconds": %.6g, "re": [%s], "im": [%s]}}\\n', median(seconds), ...
       strjoin(arrayfun(@(x) sprintf('%.12g', x), real(p)', 'UniformOutput', false), ','), ...
       strjoin(arrayfun(@(x) sprintf('%.12g', x), imag(p)', 'UniformOutput', false), ','));
"""


def record(seed: int) -> Record:
    """The record of that seed."""
    rng = np.random.default_rng(seed)
    every = round(TA / H)
    knots = rng.standard_normal((N // every + 4, 3))
    u = CubicSpline(np.arange(len(knots)) * TA, knots)(np.arange(N) * H)
    A, B, C, _ = state_space(*PLANT)
    y = propagate(A, B, u, H, "cubic") @ C.T
    y = y + rng.standard_normal(y.shape) * y.std(axis=0) * 10 ** (-SNR_DB / 20)
    return Record(np.arange(N) * H, u, y, "cubic")


def pole_error(found: np.ndarray) -> float:
    """Relative error of continuous poles after optimal assignment."""
    truth = poles(*PLANT)
    distance = np.abs(np.asarray(found)[:, None] - truth[None, :]) ** 2
    return float(np.sqrt(distance[linear_sum_assignment(distance)].sum()) / np.linalg.norm(truth))


def here(data: Record, horizon: int) -> tuple[float, float]:
    """Pole error and median seconds of the method without standard errors."""
    method, model, seconds = N4sid(horizon=horizon, blocks=0), Model(n=3), []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        estimate = method.fit(data, model)
        seconds.append(time.perf_counter() - begin)
    return pole_error(estimate.poles), statistics.median(seconds)


def octave(data: Record, horizon: int, program: str) -> tuple[float, float]:
    """The same of Octave's, which gives no M, D, K."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.txt"
        np.savetxt(path, np.hstack([data.u, data.y]), fmt="%.17g")
        code = OCTAVE.format(data=path, repeats=REPEATS, nu=3, h=H, order=6, horizon=horizon)
        run = [program, "--no-gui", "--quiet", "--eval", code]
        output = subprocess.run(run, capture_output=True, text=True, check=True, timeout=300).stdout
    answer = json.loads(output.strip().splitlines()[-1])
    p = np.array(answer["re"]) + 1j * np.array(answer["im"])
    return pole_error(np.log(p.astype(complex)) / H), answer["seconds"]


def main() -> int:
    """Prints one line per horizon; 1 where the poles are worse or the time is more than twice Octave's."""
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        print("n4sid against SLICOT: not run, Octave with its control package is not installed")
        return 0
    good = True
    for horizon in HORIZONS:
        rows = [(here(record(seed), horizon), octave(record(seed), horizon, program)) for seed in SEEDS]
        errors = np.array([[ours[0], theirs[0]] for ours, theirs in rows])
        ratio = statistics.median(ours[1] / theirs[1] for ours, theirs in rows)
        accuracy = float(np.median(errors[:, 0] / errors[:, 1]))
        listed = ", ".join(f"{a:.4f}/{b:.4f}" for a, b in errors)
        milliseconds = 1e3 * statistics.median(ours[1] for ours, _ in rows)
        print(
            f"n4sid against SLICOT, horizon {horizon}: time x{ratio:.2f} ({milliseconds:.1f} ms here), "
            f"pole error x{accuracy:.2f} (ours/theirs {listed})"
        )
        good &= ratio <= 2 and accuracy <= 1.1
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())

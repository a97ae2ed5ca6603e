"""seed -> one hidden trial: plant, excitation, noise, effect and strength at random; records, model, sealed truth."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from engine import (
    BOUC_WEN,
    CONSTANT,
    COULOMB,
    CUBIC,
    CUBIC_DAMPING,
    DAHL,
    DRAG,
    EXPONENTIAL,
    GAP,
    LOCAL_DAMPING,
    PLAY,
    PRODUCT,
    RIPPLE,
    ROOT_SPEED,
    SINE_SPEED,
    SLOPE,
    SQUARE,
    SQUARE_SPEED,
    STOP,
    STRIBECK,
    SWING,
    TIMED_DAMPING,
    TONE,
    VAN_DER_POL,
    fine_input,
    first_order,
    integrate,
    slow,
)  # fmt: skip

K8 = [
    [27071.1, 0, 0, 0, -10000, 0, -3535.5, -3535.5], [0, 17071.1, 0, -10000, 0, 0, -3535.5, -3535.5],
    [0, 0, 27071.1, 0, -3535.5, 3535.5, -10000, 0], [0, -10000, 0, 17071.1, 3535.5, -3535.5, 0, 0],
    [-10000, 0, -3535.5, 3535.5, 27071.1, 0, 0, 0], [0, 0, 3535.5, -3535.5, 0, 17071.1, 0, -10000],
    [-3535.5, -3535.5, -10000, 0, 0, 0, 27071.1, 0], [-3535.5, -3535.5, 0, 0, 0, -10000, 0, 17071.1],
]  # fmt: skip
FORCES = (
    "coulomb_friction stribeck_friction presliding_friction quadratic_drag cubic_stiffness quadratic_stiffness dead_zone backlash "
    "bouc_wen_hysteresis end_stop position_ripple time_varying_stiffness missing_coupling extra_mode periodic_disturbance "
    "constant_force"
).split()
ACTUATORS = "saturation input_delay actuator_lag input_dead_band rate_limit".split()
SENSORS = "sensor_bias sensor_drift quantisation sensor_clipping".split()
OUTSIDE = (
    "cubic_damping van_der_pol square_speed exponential local_damping timed_damping root_speed sine_speed product "
    "random_force input_square"
).split()


@dataclass
class Trial:
    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    L: np.ndarray
    h: float
    hold: str
    initial_state: str
    train: tuple
    test: tuple
    truth: dict
    C: np.ndarray | None = None
    quality: tuple = field(default=(None, None))


def plant(kind, rng):
    if kind == "one":
        return np.eye(1), np.array([[rng.choice([0.15, 0.3, 1.0])]]), np.eye(1), 0.05
    if kind == "three":
        K = np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]])
        return np.diag([0.8, 2, 1.2]), 0.1 * K, K, 0.05
    K = np.array(K8)
    return 100 * np.eye(8), 0.005 * K + np.eye(8), K, 0.01


def excite(kind, N, h, nu, low, high, rng):
    t, U = np.arange(N) * h, np.zeros((N, nu))
    for c in range(nu):
        if kind == "noise":
            w = 2 * np.pi * np.fft.rfftfreq(N, h)
            X = (rng.normal(size=len(w)) + 1j * rng.normal(size=len(w))) / (1 + (w / (1.2 * high)) ** 8)
            X[0] = 0
            u = np.fft.irfft(X, N)
        elif kind == "prbs":
            width = max(1, round(np.pi / high / 1.5 / h))
            u = np.repeat(rng.choice([-1.0, 1.0], N // width + 1), width)[:N]
        elif kind == "multisine":
            base = 2 * np.pi / (N * h / 4)
            w = base * np.unique(np.round(np.linspace(0.3 * low, 1.6 * high, 60) / base))
            u = sum(np.sin(x * t + p) for x, p in zip(w, rng.uniform(0, 2 * np.pi, len(w))))
        else:
            T = N * h / rng.integers(2, 5)
            s = t % T
            f0, f1 = (0.2 * low, 1.6 * high) if c % 2 == 0 else (1.6 * high, 0.2 * low)
            u = np.sin(f0 * s + (f1 - f0) * s**2 / 2 / T)
        U[:, c] = u / u.std()
    return U


class Draw:
    """The state of one draw; `trial` runs it."""

    def __init__(self, seed, kind=None, size=None, name=None, strength=(0.1, 0.6), small=12):
        self.rng = rng = np.random.default_rng(seed)
        self.size = size or str(rng.choice(["one", "three", "eight"], p=[0.4, 0.45, 0.15]))
        self.kind = kind or str(
            rng.choice(["single", "double", "none", "parameters", "unknown"], p=[0.6, 0.12, 0.08, 0.08, 0.12])
        )
        self.M, self.D, self.K, self.h = plant(self.size, rng)
        self.n = n = len(self.M)
        self.nominal = [self.M.copy(), self.D.copy(), self.K.copy()]
        nu = 1 if n == 1 else int(rng.integers(1, 4))
        self.L = np.zeros((n, nu))
        for c, i in enumerate(rng.permutation(n)[:nu]):
            self.L[i, c] = 1
        self.ex = str(rng.choice(["noise", "prbs", "multisine", "chirp"]))
        self.hold = (
            "zoh" if self.ex == "prbs" else str(rng.choice(["cubic", "zoh", "foh"], p=[0.6, 0.2, 0.2]))
        )
        self.N = int(rng.choice([6000, 8000, 10000]))
        w = np.sqrt(np.linalg.eigvals(np.linalg.solve(self.M, self.K)).real)
        self.low, self.high = w.min(), w.max()
        self.small = small
        amplitude = rng.uniform(0.5, 2) * (1 if n < 8 else 4e3)
        self.us = [
            amplitude * excite(self.ex, self.N, self.h, nu, self.low, self.high, rng) for _ in range(2)
        ]
        self.kinds, self.places, self.P, self.path, self.sensor, self.random = [], [], [], [], [], None
        self.base = self.run(self.us[0], 3)
        self.truth = {
            "verdict": self.kind if self.kind in ("none", "parameters", "unknown") else "effect",
            "effects": [],
        }
        self.strength, self.name = strength, name

    def run(self, u, small, effects=False, x0=None):
        path = self.path if effects else []
        delay = np.zeros(u.shape[1])
        for nm, ch, p in path:
            if nm == "input_delay":
                delay[ch] += p
        w = np.column_stack(
            [fine_input(u[:, [c]], self.h, self.hold, small, delay[c])[:, 0] for c in range(u.shape[1])]
        )
        d = self.h / (2 * small)
        for nm, ch, p in path:
            if nm == "saturation":
                w[:, ch] = np.clip(w[:, ch], -p, p)
            if nm == "input_dead_band":
                w[:, ch] -= np.clip(w[:, ch], -p, p)
            if nm == "input_square":
                w[:, ch] += p * (w[:, ch] ** 2 - np.mean(w[:, ch] ** 2))
            if nm == "rate_limit":
                w[:, ch] = slow(w[:, ch].copy(), p * d)
        is_held = self.hold == "zoh"
        for nm, ch, p in path:
            if nm == "actuator_lag":
                w[:, ch] = first_order(w[:, ch].copy(), d, p, self.hold == "zoh")
                is_held = False
        f = w @ self.L.T
        M, D, K = self.M, self.D, self.K
        kinds, places, P = (self.kinds, self.places, self.P) if effects else ([], [], [])
        if effects and self.random is not None:
            f = f + np.outer(
                np.interp(np.arange(len(f)) / (2 * small), np.arange(self.N), self.random[1][:, 0]),
                self.random[0],
            )
        n = self.n
        hidden = [e for e in self.extra] if effects and getattr(self, "extra", None) else []
        for i, m, k, dm in hidden:
            M, D, K = (np.pad(X, ((0, 1), (0, 1))) for X in (M, D, K))
            M[-1, -1] = m
            b = np.zeros(len(M))
            b[i], b[-1] = 1, -1
            K = K + k * np.outer(b, b)
            D = D + dm * np.outer(b, b)
            f = np.pad(f, ((0, 0), (0, 1)))
        places = np.array([np.pad(c, (0, len(M) - n)) for c in places]).reshape(len(kinds), len(M))
        P = np.array([list(p) + [0.0] * (6 - len(p)) for p in P]).reshape(len(kinds), 6)
        q0 = np.zeros(len(M))
        v0 = np.zeros(len(M))
        if x0 is not None:
            q0[:n], v0[:n] = x0[0], x0[1]
            for k in range(n, len(M)):
                q0[k] = q0[hidden[k - n][0]]
        Q, V = integrate(
            M,
            D,
            K,
            np.ascontiguousarray(f),
            self.h,
            small,
            is_held,
            np.array(kinds, dtype=np.int64),
            places,
            P,
            q0,
            v0,
        )
        return Q[:, :n], V[:, :n]

    def place(self, pairs=0.35):
        rng, n = self.rng, self.n
        c = np.zeros(n)
        linked = [(i, j) for i in range(n) for j in range(i + 1, n) if self.K[i, j] < 0]
        if n > 1 and rng.random() < pairs:
            i, j = linked[rng.integers(len(linked))]
            c[i], c[j] = 1, -1
            return c, [i, j]
        i = int(rng.integers(n))
        c[i] = 1
        return c, i

    def add(self, name):
        rng = self.rng
        s = rng.uniform(*self.strength)
        single = name in ("extra_mode", "periodic_disturbance", "constant_force")
        c, place = self.place(0 if single else 0.35)
        x, v = self.base[0] @ c, self.base[1] @ c
        sx, sv, top = x.std(), v.std(), np.abs(x).max()
        kc = (c @ self.K @ c) / (c @ c) ** 2 if c @ c > 1 else c @ self.K @ c
        size = kc * sx

        def law(kind, *p):
            self.kinds.append(kind), self.places.append(c), self.P.append(p)

        sign = rng.choice([-1, 1])
        if name == "coulomb_friction":
            law(COULOMB, 0.7 * s * size, rng.uniform(0.002, 0.01) * sv)
        elif name == "stribeck_friction":
            law(
                STRIBECK,
                0.4 * s * size,
                s * size * rng.uniform(0.4, 1),
                sv * rng.uniform(0.1, 0.4),
                0.005 * sv,
            )
        elif name == "presliding_friction":
            F, reach = 0.7 * s * size, rng.uniform(0.08, 0.4) * sx
            law(DAHL, F / reach, reach)
        elif name == "quadratic_drag":
            law(DRAG, 0.5 * s * size / sv**2)
        elif name == "cubic_stiffness":
            law(CUBIC, rng.choice([1, 1, 1, -0.15]) * 0.4 * s * size / sx**3)
        elif name == "quadratic_stiffness":
            law(SQUARE, sign * 0.25 * s * size / sx**2)
        elif name == "dead_zone":
            law(GAP, kc * (rng.uniform(0.4, 0.9) if self.n > 1 else 0.95), sx * rng.uniform(0.2, 0.8))
        elif name == "backlash":
            law(PLAY, kc * rng.uniform(0.4, 0.9), sx * rng.uniform(0.15, 0.6))
        elif name == "bouc_wen_hysteresis":
            e, reach, share = rng.choice([1, 2]), sx * rng.uniform(0.3, 1.2), rng.uniform(0.5, 0.9)
            law(BOUC_WEN, kc * rng.uniform(0.2, 0.7), share / reach**e, (1 - share) / reach**e, e)
        elif name == "end_stop":
            law(
                STOP,
                kc * rng.uniform(3, 15),
                rng.uniform(0.45, 0.8) * top,
                rng.choice([-1, 0, 1]),
                rng.choice([0, 0.1]) * kc / self.high,
            )
        elif name == "position_ripple":
            law(RIPPLE, 0.5 * s * size, 2 * np.pi / (sx * rng.uniform(0.6, 2.2)), rng.uniform(0, 6.28))
        elif name == "time_varying_stiffness":
            if rng.random() < 0.5:
                law(SLOPE, sign * 0.6 * s * kc / (self.N * self.h))
            else:
                law(SWING, 0.5 * s * kc, rng.uniform(0.02, 1.0) * self.low, rng.uniform(0, 6.28))
        elif name == "missing_coupling":
            linked = [(i, j) for i in range(self.n) for j in range(i + 1, self.n) if self.K[i, j] < 0]
            i, j = place = list(linked[rng.integers(len(linked))])
            for X, b in ((self.nominal[2], self.K[i, j]), (self.nominal[1], self.D[i, j])):
                X[i, j] = X[j, i] = 0
                X[i, i] -= abs(b)
                X[j, j] -= abs(b)
        elif name == "extra_mode":
            m, w0, zeta = (
                self.M[place, place] * rng.uniform(0.05, 0.25),
                rng.uniform(0.7, 1.5) * rng.uniform(self.low, self.high),
                rng.uniform(0.02, 0.1),
            )
            self.extra = [*getattr(self, "extra", []), (place, m, m * w0**2, 2 * zeta * w0 * m)]
        elif name == "periodic_disturbance":
            w = rng.uniform(0.4, 1.4) * self.low if self.n == 1 else rng.uniform(0.5 * self.low, self.high)
            law(TONE, s * size, w, rng.uniform(0, 6.28))
        elif name == "constant_force":
            law(CONSTANT, sign * s * size)
        elif name in ACTUATORS:
            ch = int(rng.integers(self.L.shape[1]))
            place = int(np.argmax(self.L[:, ch]))
            u = self.us[0][:, ch]
            if self.ex == "prbs" and name in ("saturation", "input_dead_band"):
                name = "input_delay"  # on two levels these are a gain
            if self.hold == "zoh" and name == "rate_limit":
                name = "actuator_lag"
            fastest = np.abs(np.diff(u)).max() / self.h
            self.path.append((name, ch, {
                "saturation": np.abs(u).max() * rng.uniform(0.4, 0.75), "input_delay": self.h * rng.uniform(0.6, 6),
                "actuator_lag": rng.uniform(0.05, 0.35) / self.high, "input_dead_band": u.std() * rng.uniform(0.3, 0.8),
                "rate_limit": fastest * rng.uniform(0.2, 0.45),
            }[name]))  # fmt: skip
        elif name in SENSORS:
            place = int(rng.integers(self.n))
            y = self.base[0][:, place]
            self.sensor.append((name, place, {
                "sensor_bias": sign * y.std() * rng.uniform(0.1, 0.6), "sensor_drift": sign * y.std() * rng.uniform(0.3, 1),
                "quantisation": y.std() * rng.uniform(0.1, 0.6), "sensor_clipping": np.abs(y).max() * rng.uniform(0.4, 0.7),
            }[name]))  # fmt: skip
        elif name == "random_force":
            self.random = (c, excite("noise", self.N, self.h, 1, self.low, self.high, rng) * s * size)
        elif name == "input_square":
            ch = int(rng.integers(self.L.shape[1]))
            if self.ex == "prbs":
                law(PRODUCT, s * size / sx / sv)
            else:
                self.path.append((name, ch, 0.5 * s / self.us[0][:, ch].std()))
        else:
            law(*{
                "cubic_damping": (CUBIC_DAMPING, 0.4 * s * size / sv**3), "van_der_pol": (VAN_DER_POL, s * size / sv / sx**2),
                "square_speed": (SQUARE_SPEED, 0.4 * s * size / sv**2), "exponential": (EXPONENTIAL, 0.5 * s * size, 0.7 * sx),
                "local_damping": (LOCAL_DAMPING, 2 * s * size / sv, 0.6 * sx),
                "timed_damping": (TIMED_DAMPING, 0.6 * s * size / sv, rng.uniform(0.02, 0.6) * self.low),
                "root_speed": (ROOT_SPEED, 0.7 * s * size / np.sqrt(sv)), "sine_speed": (SINE_SPEED, 0.6 * s * size, 0.6 * sv),
                "product": (PRODUCT, s * size / sx / sv),
            }[name])  # fmt: skip
        if name in OUTSIDE:
            self.truth["outside"] = name
        else:
            self.truth["effects"].append({"name": name, "dof": place})

    def trial(self, nominal_spread=None) -> Trial:
        rng = self.rng
        if self.kind == "single":
            self.add(self.name or str(rng.choice(self.available())))
        elif self.kind == "double":
            for name in rng.choice(
                [x for x in FORCES if self.n > 1 or x != "missing_coupling"], 2, replace=False
            ):
                self.add(str(name))
        elif self.kind == "unknown":
            self.strength = (0.3, 0.7)
            self.add(self.name or str(rng.choice(OUTSIDE)))
        self.blur(nominal_spread)
        snr, free = rng.uniform(15, 40), rng.random() < 0.3
        data, clean = [], []
        for u in self.us:
            x0 = (
                [rng.normal(size=self.n) * self.base[0].std(0), rng.normal(size=self.n) * self.base[1].std(0)]
                if free
                else [np.zeros(self.n)] * 2
            )
            Q, _ = self.run(u, self.small, True, x0)
            clean.append(Q)
            Y = Q + rng.normal(size=Q.shape) * np.nanstd(Q, axis=0) * 10 ** (-snr / 20)
            data.append((u, self.sense(Y)))
        bad = (
            any(not np.isfinite(y).all() for _, y in data)
            or np.abs(data[0][1]).max() > 50 * np.abs(self.base[0]).max()
        )
        if not bad:
            bad = np.linalg.eigvalsh(self.nominal[2]).min() < 0.3 * np.linalg.eigvalsh(self.K).min()
        self.truth.update(
            size=self.size,
            excitation=self.ex,
            hold=self.hold,
            snr_db=float(snr),
            kind=self.kind,
            bad=bool(bad),
        )
        self.truth["values"] = [[int(k), [float(x) for x in p]] for k, p in zip(self.kinds, self.P)] + [
            [a, int(b), float(c)] for a, b, c in self.path + self.sensor
        ]
        self.clean = clean
        return Trial(
            *self.nominal,
            self.L,
            self.h,
            self.hold,
            "free" if free else "at_rest",
            data[0],
            data[1],
            self.truth,
        )

    def available(self):
        return [x for x in (*FORCES, *ACTUATORS, *SENSORS) if self.n > 1 or x != "missing_coupling"]

    def blur(self, spread):
        rng = self.rng
        if spread is None:
            spread = rng.choice([0.0, 0.01])
        for m, X in enumerate(self.nominal):
            wrong = rng.choice([-1, 1], X.shape) * rng.uniform(0.1, 0.3, X.shape)
            F = 1 + (
                wrong
                if self.kind == "parameters"
                else spread * (3 if m == 1 else 1) * rng.normal(size=X.shape)
            )
            X *= np.tril(F) + np.tril(F, -1).T
        self.nominal[0] = np.diag(np.diag(self.nominal[0]))

    def sense(self, Y):
        t = np.arange(len(Y)) / len(Y)
        for name, i, p in self.sensor:
            if name == "sensor_bias":
                Y[:, i] += p
            if name == "sensor_drift":
                Y[:, i] += p * t
            if name == "quantisation":
                Y[:, i] = p * np.round(Y[:, i] / p)
            if name == "sensor_clipping":
                Y[:, i] = np.clip(Y[:, i], -p, p)
        return Y


def write(trial: Trial, folder: Path) -> None:
    """train.csv, test.csv, model.yaml and, beside them in a folder of its own, the sealed truth."""
    import yaml

    folder.mkdir(parents=True, exist_ok=True)
    n, nu = trial.L.shape
    for name, (u, y) in (("train", trial.train), ("test", trial.test)):
        table = np.column_stack([np.arange(len(u)) * trial.h, u, y])
        header = ",".join(["t", *(f"u{i + 1}" for i in range(nu)), *(f"y{i + 1}" for i in range(y.shape[1]))])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
    model = {
        "mass": trial.M.tolist(), "damping": trial.D.tolist(), "stiffness": trial.K.tolist(), "input_map": trial.L.tolist(),
        "output_map": np.eye(n).tolist(), "output": "displacement", "initial_state": trial.initial_state,
        "input_intersample": {"cubic": "smooth"}.get(trial.hold, trial.hold), "sample_time": trial.h,
    }  # fmt: skip
    (folder / "model.yaml").write_text(yaml.safe_dump(model))
    (folder / "sealed.json").write_text(json.dumps(trial.truth))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    write(Draw(given.seed).trial(), given.out)

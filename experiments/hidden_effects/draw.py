"""seed -> one hidden trial: plant, excitation, noise, effect and strength at random; records, model, sealed truth."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from laws import FORCES as LAWS
from laws import Law, Site, on_the_input, on_the_sensor, plain, unnamed
from motion import Hidden, Machine, run, sensed
from plants import excite, plant
from sensing import flags, measured, sensors
from trial import STRATA, Trial, write

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
ALONE = ("extra_mode", "periodic_disturbance", "constant_force")  # act on one DOF, never between two


class Draw:
    """The state of one draw; `trial` runs it. `own` draws what only harder conditions need: the rest stays the same."""

    def __init__(self, seed, kind=None, size=None, name=None, strength=(0.1, 0.6), small=12, stratum="main"):
        self.rng = rng = np.random.default_rng(seed)
        self.own = np.random.default_rng([seed, 77])
        self.conditions = STRATA[stratum]
        self.size = size or str(rng.choice(["one", "three", "eight"], p=[0.4, 0.45, 0.15]))
        self.kind = kind or str(
            rng.choice(["single", "double", "none", "parameters", "unknown"], p=[0.6, 0.12, 0.08, 0.08, 0.12])
        )
        if self.conditions.sensors < 1 and self.size == "one":
            self.size = "three"
        self.M, self.D, self.K, self.h = plant(self.size, rng)
        self.n = n = len(self.M)
        self.nominal = [self.M.copy(), self.D.copy(), self.K.copy()]
        nu = 1 if n == 1 else int(rng.integers(1, 4))
        self.L = np.zeros((n, nu))
        for c, i in enumerate(rng.permutation(n)[:nu]):
            self.L[i, c] = 1
        self._draw_inputs(nu)
        self.hidden, self.small = Hidden(), small
        self.base = run(self.machine, self.hidden, self.us[0], 3)
        verdict = self.kind if self.kind in ("none", "parameters", "unknown") else "effect"
        if self.kind == "none" and self.conditions.wrong_parameters:
            verdict = "parameters"
        self.truth = {"verdict": verdict, "effects": [], "stratum": stratum}
        self.strength, self.name = strength, name

    def _draw_inputs(self, nu: int) -> None:
        rng, n = self.rng, self.n
        self.ex = str(rng.choice(["noise", "prbs", "multisine", "chirp"]))
        self.hold = (
            "zoh" if self.ex == "prbs" else str(rng.choice(["cubic", "zoh", "foh"], p=[0.6, 0.2, 0.2]))
        )
        if self.conditions.in_loop:
            self.hold = "zoh"
        self.N = int(rng.choice([6000, 8000, 10000]))
        w = np.sqrt(np.linalg.eigvals(np.linalg.solve(self.M, self.K)).real)
        self.low, self.high = w.min(), w.max()
        amplitude = rng.uniform(0.5, 2) * (1 if n < 8 else 4e3)
        self.us = [
            amplitude * excite(self.ex, self.N, self.h, nu, self.low, self.high, rng) for _ in range(2)
        ]
        for level in self.conditions.levels:
            N = int(0.6 * self.N)
            u = excite(self.ex, N, self.h, nu, self.low, self.high, self.own)
            self.us.append(level * amplitude * u)

    @property
    def machine(self) -> Machine:
        return Machine(self.M, self.D, self.K, self.L, self.h, self.hold)

    def trial(self, nominal_spread=None) -> Trial:
        """The records of the drawn machine, and what the model says of it. truth["bad"]: no fair case."""
        self._choose()
        self.blur(nominal_spread)
        snr, free = self.rng.uniform(15, 40), self.rng.random() < 0.3
        records = [measured(self, u, snr, free) for u in self.us]
        noise = [y - clean for _, y, clean in records]
        data = [(u, sensed(self.hidden, y)) for u, y, _ in records]
        bad = self._bad(data)
        C = sensors(self)
        share = np.sqrt(np.mean(np.mean(noise[1] ** 2, axis=0) / np.mean(data[1][1] ** 2, axis=0)))
        self.truth.update(
            size=self.size, excitation=self.ex, hold=self.hold, snr_db=float(snr), kind=self.kind, bad=bad,
            noise_share=float(share), true=[X.tolist() for X in (self.M, self.D, self.K)],
        )  # fmt: skip
        data = [(u, y @ C.T) for u, y in data]
        quality = [flags(self, len(u)) for u, _ in data]
        data = [
            (u, y if q is None else np.where(q[:, None] > 0, np.nan, y)) for (u, y), q in zip(data, quality)
        ]
        return Trial(
            *self.nominal, self.L, self.h, self.hold, "free" if free else "at_rest", data[0], data[1], self.truth,
            C, data[2:], quality,
        )  # fmt: skip

    def _choose(self) -> None:
        rng = self.rng
        if self.kind == "single":
            self.add(self.name or str(rng.choice(self.available())))
        elif self.kind == "double":
            names = [x for x in FORCES if self.n > 1 or x != "missing_coupling"]
            for name in rng.choice(names, 2, replace=False):
                self.add(str(name))
        elif self.kind == "unknown":
            self.strength = (0.3, 0.7)
            self.add(self.name or str(rng.choice(OUTSIDE)))

    def available(self) -> list[str]:
        names = FORCES if self.conditions.in_loop else (*FORCES, *ACTUATORS, *SENSORS)
        return [x for x in names if self.n > 1 or x != "missing_coupling"]

    def add(self, name: str) -> None:
        """Hide one more effect at a random place."""
        rng = self.rng
        s = rng.uniform(*self.strength)
        c, place = self.place(0 if name in ALONE else 0.35)
        site = self._site(s, c)
        values: dict = {}
        if name in LAWS:
            values = self._force(LAWS[name](site), c)
        elif name == "missing_coupling":
            place, values = self._coupling()
        elif name == "extra_mode":
            values = self._mode(place)
        elif name in ACTUATORS:
            name, place, values = self._actuator(name)
        elif name in SENSORS:
            place = int(rng.integers(self.n))
            key, value = on_the_sensor(name, self.base[0][:, place], site.sign, rng)
            self.hidden.sensor.append((name, place, value))
            values = {key: value / site.seconds if name == "sensor_drift" else value}
        else:
            name = self._outside(name, site, c)
        if name in OUTSIDE:
            self.truth["outside"] = name
        else:
            self.truth["effects"].append({"name": name, "dof": place, "values": plain(values)})

    def place(self, pairs=0.35):
        """(c (n,), DOF or pair): a pair that a spring links, with the given probability."""
        rng, n = self.rng, self.n
        c = np.zeros(n)
        if n > 1 and rng.random() < pairs:
            linked = self._linked()
            i, j = linked[rng.integers(len(linked))]
            c[i], c[j] = 1, -1
            return c, [i, j]
        i = int(rng.integers(n))
        c[i] = 1
        return c, i

    def _linked(self) -> list[tuple[int, int]]:
        return [(i, j) for i in range(self.n) for j in range(i + 1, self.n) if self.K[i, j] < 0]

    def _site(self, s: float, c: np.ndarray) -> Site:
        x, v = self.base[0] @ c, self.base[1] @ c
        kc = (c @ self.K @ c) / (c @ c) ** 2 if c @ c > 1 else c @ self.K @ c
        return Site(
            self.rng, s, x.std(), v.std(), np.abs(x).max(), kc, self.rng.choice([-1, 1]), self.low, self.high,
            self.N * self.h, self.n,
        )  # fmt: skip

    def _force(self, law: Law, c: np.ndarray) -> dict:
        self.hidden.laws.append((law.kind, c, law.p))
        return law.values

    def _coupling(self):
        linked = self._linked()
        i, j = linked[self.rng.integers(len(linked))]
        for X, b in ((self.nominal[2], self.K[i, j]), (self.nominal[1], self.D[i, j])):
            X[i, j] = X[j, i] = 0
            X[i, i] -= abs(b)
            X[j, j] -= abs(b)
        return [i, j], {"stiffness": -self.K[i, j], "damping": -self.D[i, j]}

    def _mode(self, place: int) -> dict:
        rng = self.rng
        m = self.M[place, place] * rng.uniform(0.05, 0.25)
        w0, zeta = rng.uniform(0.7, 1.5) * rng.uniform(self.low, self.high), rng.uniform(0.02, 0.1)
        self.hidden.modes.append((place, m, m * w0**2, 2 * zeta * w0 * m))
        return {"mass": m, "frequency": w0 / (2 * np.pi), "damping_ratio": zeta}

    def _actuator(self, name: str):
        ch = int(self.rng.integers(self.L.shape[1]))
        if self.ex == "prbs" and name in ("saturation", "input_dead_band"):
            name = "input_delay"  # on two levels these are a gain
        if self.hold == "zoh" and name == "rate_limit":
            name = "actuator_lag"
        key, value = on_the_input(name, self.us[0][:, ch], self.h, self.high, self.rng)
        self.hidden.path.append((name, ch, value))
        return name, int(np.argmax(self.L[:, ch])), {key: value}

    def _outside(self, name: str, site: Site, c: np.ndarray) -> str:
        """Hide a force that no catalogue names; its name, another where this one would show nothing."""
        if name == "random_force" and not self.conditions.in_loop:
            force = excite("noise", self.N, self.h, 1, self.low, self.high, self.rng)[:, 0]
            self.hidden.random = (c, force * site.s * site.size)
            return name
        if name == "input_square":
            ch = int(self.rng.integers(self.L.shape[1]))
            if self.ex != "prbs" and not self.conditions.in_loop:
                self.hidden.path.append((name, ch, 0.5 * site.s / self.us[0][:, ch].std()))
                return name
        if name in ("random_force", "input_square"):
            name = "product"  # two levels squared are a constant; the controller's run takes laws of the state only
        self._force(unnamed(name, site), c)
        return name

    def blur(self, spread) -> None:
        """The nominal: right but for `spread`, or 10-30 % off."""
        rng = self.rng
        if spread is None:
            spread = rng.choice([0.0, 0.01])
        off = self.kind == "parameters" or self.conditions.wrong_parameters
        for m, X in enumerate(self.nominal):
            wrong = rng.choice([-1, 1], X.shape) * rng.uniform(0.1, 0.3, X.shape)
            F = 1 + (wrong if off else spread * (3 if m == 1 else 1) * rng.normal(size=X.shape))
            X *= np.tril(F) + np.tril(F, -1).T
        self.nominal[0] = np.diag(np.diag(self.nominal[0]))

    def _bad(self, data) -> bool:
        if any(not np.isfinite(y).all() for _, y in data):
            return True
        if np.abs(data[0][1]).max() > 50 * np.abs(self.base[0]).max():
            return True
        lowest = np.linalg.eigvalsh(self.nominal[2]).min()
        return bool(lowest < 0.3 * np.linalg.eigvalsh(self.K).min())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--stratum", choices=sorted(STRATA), default="main")
    parser.add_argument("--kind")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    write(Draw(given.seed, kind=given.kind, stratum=given.stratum).trial(), given.out)

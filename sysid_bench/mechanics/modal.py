"""M, D, K, L, C, input -> output and its exact sensitivities to theta and the initial state, fast.

With q the model's own motion, dq/dM_ij = -G(s) E_ij q'', dq/dD_ij = -G(s) E_ij q', dq/dK_ij = -G(s) E_ij q,
E_ij the symmetric unit matrix, each from rest. All of them lie in the span of few signals (`basis`): q_j filtered
once more by each pole, psi_kj' = lam_k psi_kj + q_j; the exponentials of the poles; q, q' (and q''). The sampled
psi follow the same rule as the state, with divided differences R[lam_k, lam_l] of its functions: no difference of
poles is ever divided by, so repeated poles are no case of their own. The filtered derivatives of q need no filter:
psi^(1) = lam psi + q - exp(lam t) q(0) and so on, for every rule that is a function of A.
A defective A (critical damping, rigid body) goes through the cascade of two state-space systems instead (slower).

Any rule of mechanics.rules serves: zoh, foh, cubic, cayley (the midpoint variational integrator), gauss2; and
bandlimited inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sysid_bench.mechanics.bandlimited import Lines, evaluate, input_lines, line_responses
from sysid_bench.mechanics.holds import free_response, propagate
from sysid_bench.mechanics.phi import divided_difference
from sysid_bench.mechanics.rules import Rule, rule
from sysid_bench.mechanics.second_order import Modes, input_matrix, modes, state_space
from sysid_bench.nouns import Array, Complex


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The output and its derivatives to p = (theta, x0), theta as packed by second_order.pack, x0 = [q; q'].

    y      (N, ny)        predicted output
    x      (N, 2n)        predicted state
    basis  (nb, N)        signals that span the derivatives
    maps   (ny, nb, np)   dy_o/dp = basis.T @ maps[o]
    """

    y: Array
    x: Array
    basis: Array
    maps: Array

    def jacobian(self) -> Array:
        """dy/dp (N, ny, np)."""
        return (self.basis.T @ self.maps).swapaxes(0, 1)

    def normal(
        self, residual: Array | None, weights: Array, good: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array]:
        """(J' W J (np, np), J' W residual (np,)) for weights (ny,) = 1 / noise variance, without forming J.

        residual (N, ny), None for zeros; good (N,): samples that count, None for all.
        """
        basis = self.basis if good is None else self.basis[:, good]
        gram = basis @ basis.T
        hessian = sum((w * (T.T @ (gram @ T)) for w, T in zip(weights, self.maps)), np.zeros(()))
        if residual is None:
            return hessian, np.zeros(len(hessian))
        shadow = basis @ (residual if good is None else residual[good])
        parts = (w * (T.T @ column) for w, T, column in zip(weights, self.maps, shadow.T))
        return hessian, sum(parts, np.zeros(()))


class _System(NamedTuple):
    """x' = A x + B u, y = C x + D u; kick (2n, n): state after a unit impulse on each DOF; direct (ny, n): what a
    force on each DOF adds to the output at once (accelerations only)."""

    A: Array
    B: Array
    C: Array
    D: Array
    kick: Array
    direct: Array

    @property
    def n(self) -> int:
        return len(self.A) // 2


def sensitivity(
    M: Array,
    D: Array,
    K: Array,
    L: Array,
    C: Array,
    output: str,
    u: Array,
    h: float,
    hold: str,
    x0: Array | None = None,
    period: int | None = None,
    series: tuple[Array, Complex] | None = None,
) -> Sensitivity:
    """Output and sensitivities for u (N, nu), h in s, x0 (2n,) (zero where None).

    hold: zoh, foh, cubic, bandlimited, cayley, gauss2; period and series as in holds.propagate.
    """
    kick = input_matrix(M, np.eye(len(M)))
    direct = C @ kick[len(M) :] if output == "acceleration" else np.zeros(np.shape(C))
    system = _System(*state_space(M, D, K, L, C, output), kick, direct)
    x = propagate(system.A, system.B, u, h, hold, x0, period, series)
    y = x @ system.C.T + u @ system.D.T
    modal = modes(system.A)
    if modal.defective:
        return Sensitivity(y, x, *_cascade(system, x, u, h, hold, period, series))
    if hold == "bandlimited":
        psi = _psi_bandlimited(system, modal, x, h, input_lines(u, h, period, series))
    else:
        psi = _psi(system, modal, x, u, h, rule(hold))
    return Sensitivity(y, x, _basis(system, modal, psi, x, u, h, hold), _maps(system, modal, x[0]))


def _stepper(hold: str) -> Rule:
    """The rule of the state's own motion between samples."""
    return rule("zoh" if hold == "bandlimited" else hold)


def _all_modes(modal: Modes) -> tuple[Complex, Complex, Complex]:
    """lam (2n,), V (2n, 2n), W (2n, 2n) with the conjugate of each pair."""
    pair = modal.weight == 2
    lam = np.concatenate([modal.lam, modal.lam[pair].conj()])
    V = np.hstack([modal.V, modal.V[:, pair].conj()])
    return lam, V, np.vstack([modal.W, modal.W[pair].conj()])


def _gains(system: _System, modal: Modes, h: float, stepper: Rule) -> Complex:
    """(nm, n, 2n + P nu): what one step adds to psi_kj, of the state and of the input's P coefficients."""
    lam, V, W = _all_modes(modal)
    F = divided_difference(stepper.functions, stepper.slopes, h * modal.lam[:, None], h * lam)
    of_state, of_input = h * W, h**2 * W @ system.B
    parts = [(V[: system.n] * F[0][:, None]) @ of_state]
    parts += [(V[: system.n] * weight[:, None]) @ of_input for weight in F[1:]]
    return np.concatenate(parts, axis=2)


def _filtered(poles: Complex, gains: Complex, drive: Array, start: Complex) -> Complex:
    """psi (nm, n, N): psi[k+1] = pole psi[k] + gains @ drive[k], drive (N-1, nd) real, start (nm, n)."""
    nm, n, nd = gains.shape
    forcing = np.empty((nm * n, len(drive)), dtype=complex)
    forcing.real = gains.real.reshape(-1, nd) @ drive.T
    forcing.imag = gains.imag.reshape(-1, nd) @ drive.T
    psi = np.empty((nm, n, len(drive) + 1), dtype=complex)
    psi[:, :, 0] = start
    for k, rows in enumerate(forcing.reshape(nm, n, -1)):
        memory = poles[k] * start[k][:, None]
        psi[k, :, 1:] = lfilter([1.0], [1.0, -poles[k]], rows, zi=memory)[0]
    return psi


def _psi(system: _System, modal: Modes, x: Array, u: Array, h: float, stepper: Rule) -> Complex:
    """(nm, n, N): q_j filtered by 1 / (s - lam_k), from rest, under the rule."""
    drive = np.hstack([x[:-1], *stepper.coefficients(u)])
    poles, gains = stepper.functions(h * modal.lam)[0], _gains(system, modal, h, stepper)
    return _filtered(poles, gains, drive, np.zeros(gains.shape[:2], dtype=complex))


def _psi_bandlimited(system: _System, modal: Modes, x: Array, h: float, lines: Lines) -> Complex:
    """The same for a Fourier series: its steady state, and the free response that makes psi start at rest."""
    N, nm, n = len(x), len(modal.lam), system.n
    states = line_responses(system.A, system.B, lines)
    iw, Q = 1j * lines.omega[:, None, None], states[:, None, :n]
    up, down = Q / (iw - modal.lam[:, None]), Q / (iw - modal.lam.conj()[:, None])
    parts = [0.5 * (up + down), -0.5j * (up - down)]  # of the real and the imaginary part of psi
    real, imag = (evaluate(lines, part.reshape(len(iw), -1), N, h) for part in parts)
    steady = (real + 1j * imag).T.reshape(nm, n, N)
    free = x - evaluate(lines, states, N, h)
    gains = _gains(system, modal, h, rule("zoh"))[:, :, : 2 * n]
    return steady + _filtered(np.exp(h * modal.lam), gains, free[:-1], -steady[:, :, 0])


def _basis(system: _System, modal: Modes, psi: Complex, x: Array, u: Array, h: float, hold: str) -> Array:
    """Rows: Re psi, Im psi (nm n each), Re and Im of the poles' powers (nm each), q, q', q'' (n each)."""
    poles = _stepper(hold).functions(h * modal.lam)[0]
    powers = np.empty((len(poles), len(x)), dtype=complex)
    powers[:, 0], powers[:, 1:] = 1.0, poles[:, None]
    powers = np.cumprod(powers, axis=1)
    flat = psi.reshape(-1, len(x))
    acceleration = x @ system.A[system.n :].T + u @ system.B[system.n :].T
    return np.vstack([flat.real, flat.imag, powers.real, powers.imag, x.T, acceleration.T])


def _maps(system: _System, modal: Modes, x0: Array) -> Array:
    """(ny, nb, ntheta + 2n): how the derivatives are put together from the rows of _basis."""
    n, nm, ny, j = system.n, len(modal.lam), len(system.C), np.arange(system.n)
    q0, v0 = x0[:n], x0[n:]
    readout = modal.weight * (system.C @ modal.V)  # (ny, nm)
    g = readout[:, :, None] * (modal.W @ system.kick)  # (ny, nm, n): y_o of mode k for a force on DOF i
    lam = modal.lam[:, None]
    starts = [np.zeros((nm, n)), np.tile(q0, (nm, 1)), lam * q0 + v0]  # what psi^(a)_kj decays from
    rows = [nm * n, nm * n, nm, nm, n, n, n]
    full = np.zeros((ny, sum(rows), 3, n, n))  # [o, row, a, i, j]: response to q_j^(a) as a force on DOF i
    blocks = np.split(full, np.cumsum(rows)[:-1], axis=1)
    for a in range(3):
        for block, part in zip(blocks[:2], (np.real(g * lam**a), -np.imag(g * lam**a))):
            block.reshape(ny, nm, n, 3, n, n)[:, :, j, a, :, j] = part
        decay = -g[..., None] * starts[a][:, None, :]
        blocks[2][:, :, a], blocks[3][:, :, a] = decay.real, -decay.imag
        for m in range(a):  # psi^(a) holds lam^(a-1-m) q^(m)
            blocks[4 + m][:, j, a, :, j] = (g * lam ** (a - 1 - m)).sum(axis=1).real
        blocks[4 + a][:, j, a, :, j] += system.direct
    state = np.zeros((ny, sum(rows), 2 * n))
    of_state = readout[:, :, None] * modal.W
    state[:, 2 * nm * n : 2 * nm * n + 2 * nm] = np.concatenate(
        [np.real(of_state), -np.imag(of_state)], axis=1
    )
    return np.concatenate([-_symmetric(full), state], axis=2)


def _symmetric(full: Array) -> Array:
    """(..., a, i, j) -> (..., ntheta): a = 2, 1, 0 (M, D, K), each the pairs i <= j of pack, (i, j) + (j, i)."""
    n = full.shape[-1]
    rows, cols = np.triu_indices(n)
    both = full[..., ::-1, rows, cols] + np.where(rows == cols, 0.0, 1.0) * full[..., ::-1, cols, rows]
    return both.reshape(*full.shape[:-3], -1)


def _cascade(
    system: _System, x: Array, u: Array, h: float, hold: str, period: int | None, series: tuple | None
) -> tuple[Array, Array]:
    """Basis and maps for a defective A: the motion and a second copy of the system that q_j drives, in one."""
    n, N, ny = system.n, len(x), len(system.C)
    Ad, _ = _stepper(hold).step(system.A, system.B, h)
    motion = [x[:, :n], x[:, n:], x @ system.A[n:].T + u @ system.B[n:].T]
    full = np.empty((N, ny, 3, n, n))
    B, start = np.vstack([system.B, 0 * system.B]), np.concatenate([x[0], 0 * x[0]])
    for i in range(n):
        kick = system.kick[:, i]
        decay = free_response(Ad, N, kick)
        for j in range(n):
            A = np.block([[system.A, 0 * system.A], [np.outer(kick, np.eye(2 * n)[j]), system.A]])
            xi = propagate(A, B, u, h, hold, start, period, series)[:, 2 * n :]
            for a in range(3):
                q = motion[a][:, j]
                full[:, :, a, i, j] = xi @ system.C.T + np.outer(q, system.direct[:, i])
                xi = xi @ system.A.T + np.outer(q, kick) - q[0] * decay
    state = [free_response(Ad, N, unit) @ system.C.T for unit in np.eye(2 * n)]
    jacobian = np.concatenate([-_symmetric(full), np.stack(state, axis=2)], axis=2)  # (N, ny, np)
    count = jacobian.shape[2]
    maps = np.eye(ny * count).reshape(ny, count, ny * count).swapaxes(1, 2)
    return jacobian.reshape(N, -1).T, np.ascontiguousarray(maps)

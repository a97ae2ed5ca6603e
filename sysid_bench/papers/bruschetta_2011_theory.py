"""tables -> verdicts on chapters 1 to 3 and the appendix of Bruschetta (2011): discretisation and conversion."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from sysid_bench.mechanics.conversion import c2d_zoh
from sysid_bench.mechanics.integrators import one_step
from sysid_bench.mechanics.second_order import companion, input_matrix
from sysid_bench.nouns import Array
from sysid_bench.papers.claims import Claim, Numbers, Verdict, number, percent, word
from sysid_bench.papers.evidence import Tables, slope

M3 = np.diag([0.8, 2.0, 1.2])
K3 = np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]])
D3 = K3 / 10


def zoh_companion(h: float) -> tuple[Array, Array, Array, Array]:
    """F21, F22, B1, B2 (3, 3) of the three masses' exact ZOH model, (4.9)-(4.12)."""
    A, B = companion(M3, D3, K3), input_matrix(M3, np.eye(3))
    F, G = c2d_zoh(A, B, h)
    H = np.eye(3, 6)
    F21, F22 = np.hsplit(np.linalg.solve(np.vstack([H, H @ F]).T, (H @ F @ F).T).T, 2)
    return F21, F22, H @ G, H @ F @ G - F22 @ H @ G


def start_of_pem(h: float = 0.05) -> Numbers:
    """M[0][0] that (4.15) and (2.26) find in an exact ZOH model, J = B1 + B2 and (B1 + B2) / h."""
    F21, F22, B1, B2 = zoh_companion(h)

    def mass(J: Array) -> float:
        Md = np.linalg.inv(J)
        return float((h / 4 * (Md - Md @ F21 + Md @ F22))[0, 0])

    return mass(B1 + B2), mass((B1 + B2) / h), float(M3[0, 0])


def midpoint_keeps_passivity(tables: Tables) -> Verdict:
    table = tables["passivity"].at(analysis__rule="midpoint")
    kept, printed = table.at(analysis__output="averaged"), table.at(analysis__output="sampled")
    lmi = float(kept.values("lmi").max())
    unscaled = float(kept.at(plant="three_dof", sampling__h_s=0.1).median("lmi_printed"))
    holds = bool((kept.values("passive") == 1).all())
    numbers = (
        f"With the averaged velocity of (3.12) the LMI (3.45) holds in all {kept.rows} cases (largest eigenvalue {number(lmi)}, "
        f"relative) with P = diag(K, M)/h. The energy is the continuous one only up to this 1/h: with P = diag(K, M) as Theorem 3.3.1 has it, "
        f"the LMI fails (largest eigenvalue {number(unscaled)} for three masses at h = 0.1 s). With the velocity of the instant, v_k, the midpoint rule loses passivity too, in "
        f"{int((printed.values('passive') == 0).sum())} of {printed.rows} cases."
    )  # fmt: skip
    same_energy = unscaled < 1e-9
    return Verdict(word(holds and same_energy, holds), numbers)


def zoh_loses_passivity(tables: Tables) -> Verdict:
    table = tables["passivity"].at(analysis__rule="zoh")
    lost, kept = table.at(analysis__output="sampled"), table.at(analysis__output="increment")
    three = lost.at(plant="three_dof")
    margins = ", ".join(number(three.at(sampling__h_s=h).median("margin")) for h in (0.005, 0.1, 0.5))
    all_lost = bool((lost.values("passive") == 0).all())
    numbers = (
        f"Sampled velocity: lost in {int((lost.values('passive') == 0).sum())} of {lost.rows} cases (three masses: smallest eigenvalue of G + G^H "
        f"relative {margins} at h = 0.005, 0.1, 0.5 s). Yet with the increment (q_k+1 - q_k)/h as output, whose product with the held "
        f"force is the exact work, ZOH is passive in {int((kept.values('passive') == 1).sum())} of {kept.rows}."
    )  # fmt: skip
    return Verdict(word(all_lost), numbers)


def midpoint_conserves(tables: Tables) -> Verdict:
    table = tables["energy"]
    rule = {name: table.at(analysis__rule=name) for name in ("midpoint", "verlet", "zoh", "explicit_euler")}
    swing, balance = (float(rule["midpoint"].values(x).max()) for x in ("swing", "balance"))
    numbers = (
        f"10 000 steps, h = 0.05 .. 0.5 s: largest |E/E0 - 1| {number(swing)}, forced energy balance to {number(balance)}. The exact flow (ZOH) "
        f"keeps free motion as well ({number(float(rule['zoh'].values('swing').max()))}), but its balance with the mean velocity only to "
        f"{number(rule['zoh'].at(sampling__h_s=0.5).median('balance'))} (h = 0.5); explicit Euler ends at "
        f"{number(rule['explicit_euler'].at(sampling__h_s=0.05).median('drift'))} E0 (h = 0.05)."
    )  # fmt: skip
    return Verdict(word(swing < 1e-10 and balance < 1e-12), numbers, table.runs)


def variational_oscillates(tables: Tables) -> Verdict:
    table = tables["energy"].at(analysis__rule="verlet")
    h, swing = table.curve("swing")
    words = ", ".join(f"{percent(s)} at h = {number(x)}" for x, s in zip(h, swing))
    numbers = (
        f"Verlet, a variational integrator, 10 000 steps: the energy stays within {words} s of its start."
    )
    return Verdict(word(bool(swing.max() < 10 and swing.min() > 1e-6)), numbers, table.runs)


def midpoint_second_order(tables: Tables) -> Verdict:
    table = tables["discretisation"].at(analysis__rule="cayley")
    rate = slope(table, "error", "sampling.h_s", 0.025, 0.1)
    bias = tables["bias"].at(method=EXACT_START)
    ratios = {
        X: bias.at(sampling__h_s=0.1).median(f"{X}_error") / bias.at(sampling__h_s=0.05).median(f"{X}_error")
        for X in "MDK"
    }
    numbers = (
        f"Simulation error h^{number(rate, 3)}; bias of the estimates from noise-free data, h = 0.1 over h = 0.05: "
        + ", ".join(f"{X} {number(r, 3)}" for X, r in ratios.items())
        + "."
    )
    holds = abs(rate - 2) < 0.1 and all(3.6 < r < 4.4 for r in ratios.values())
    return Verdict(word(holds), numbers, table.runs)


def same_order_as_zoh(tables: Tables) -> Verdict:
    table = tables["discretisation"]
    pairs = {
        h: [table.at(analysis__rule=r, sampling__h_s=h).median("error") for r in ("cayley", "zoh")]
        for h in (0.5, 0.1, 0.025)
    }
    words = ", ".join(f"{percent(a)} / {percent(b)} at h = {h}" for h, (a, b) in pairs.items())
    rates = [
        slope(table.at(analysis__rule=r), "error", "sampling.h_s", 0.025, 0.1) for r in ("cayley", "zoh")
    ]
    numbers = f"Smooth force, midpoint / ZOH: {words}; orders {number(rates[0], 3)} and {number(rates[1], 3)}. For small h the midpoint is far better."
    return Verdict(word(abs(rates[0] - rates[1]) < 0.3), numbers, table.runs)


def no_exact_rule(tables: Tables) -> Verdict:
    table = tables["discretisation"].at(analysis__rule="cubic")
    worst = float(table.values("error").max())
    spline = float(table.values("spline").max())
    numbers = (
        f"The spline through the samples is the force itself (to {number(spline)}), also at h = Ta, and the spline hold reproduces the "
        f"noise-free output to {number(worst)} at every h from 0.025 to 1 s."
    )
    return Verdict(word(worst > 1e-6), numbers, table.runs)


def higher_order_rules(tables: Tables) -> Verdict:
    table = tables["discretisation"].at(analysis__rule="gauss2")
    rate = slope(table, "error", "sampling.h_s", 0.05, 0.25)
    ends = ", ".join(
        f"{percent(table.at(sampling__h_s=h).median('error'))} at h = {h}" for h in (0.5, 0.25, 0.1)
    )
    return Verdict(
        word(rate > 3.5),
        f"Gauss collocation of 2 stages, a variational rule: order {number(rate, 3)}; {ends}.",
        table.runs,
    )


def symplectic_not_energy(tables: Tables) -> Verdict:
    A, B = companion(M3, 0 * D3, K3), input_matrix(M3, np.eye(3))
    J = np.block([[np.zeros((3, 3)), M3], [-M3, np.zeros((3, 3))]])
    off = {}
    for rule in ("midpoint", "verlet", "explicit_euler"):
        Phi = one_step(rule, A, B, 0.1)[0]
        off[rule] = _relative(Phi.T @ J @ Phi, J)
    swing = tables["energy"].at(analysis__rule="verlet", sampling__h_s=0.1).median("swing")
    numbers = (
        f"Change of the symplectic form in one step, h = 0.1: midpoint {number(off['midpoint'])}, Verlet {number(off['verlet'])}, explicit Euler "
        f"{number(off['explicit_euler'])}. Verlet's energy moves by {percent(swing)}; the midpoint rule's, for linear plants, not at all."
    )  # fmt: skip
    holds = max(off["midpoint"], off["verlet"]) < 1e-12 and swing > 1e-6
    return Verdict(word(holds), numbers)


def step_invariant_is_zoh(tables: Tables) -> Verdict:
    worst = 0.0
    for h in (0.01, 0.1, 1.0):
        A, B = companion(M3, D3, K3), input_matrix(M3, np.eye(3))
        Ad, Bd = c2d_zoh(A, B, h)
        markov = [np.linalg.matrix_power(Ad, k)[:3] @ Bd for k in range(50)]
        steps = [np.linalg.solve(A, (expm(A * k * h) - np.eye(6)) @ B)[:3] for k in range(51)]
        worst = max(worst, *(_relative(steps[k + 1] - steps[k], markov[k]) for k in range(50)))
    return Verdict(word(worst < 1e-10), f"Differences of the step response against the ZOH's pulse response, 50 lags, h = .01, .1, 1: {number(worst)}.")  # fmt: skip


def _relative(X: Array, Y: Array) -> float:
    return float(np.linalg.norm(X - Y) / np.linalg.norm(Y))


def midpoint_is_cayley(tables: Tables) -> Verdict:
    worst = 0.0
    for h in (0.01, 0.1, 1.0):
        A, B = companion(M3, D3, K3), input_matrix(M3, np.eye(3))
        Ad, Bd = one_step("midpoint", A, B, h)
        C = np.eye(3, 6)
        C_half, D_half = C @ (np.eye(6) + Ad) / 2, C @ Bd / 2
        Md, Dd, Kd = M3 / h + h * K3 / 4 + D3 / 2, -2 * M3 / h + h * K3 / 2, M3 / h + h * K3 / 4 - D3 / 2
        for z in np.exp(1j * np.linspace(0.1, 3.0, 20)):
            state_space = C_half @ np.linalg.solve(z * np.eye(6) - Ad, Bd) + D_half
            difference = np.linalg.solve(Md * z**2 + Dd * z + Kd, np.eye(3)) * h / 4 * (z + 1) ** 2
            worst = max(worst, _relative(state_space, difference))
    return Verdict(word(worst < 1e-10), f"Transfer functions of (2.23), (2.24) and of (3.13) on 20 points of the unit circle, h = .01, .1, 1: {number(worst)}.")  # fmt: skip


def signs_of_discrete_matrices(tables: Tables) -> Verdict:
    omega = float(np.sqrt(np.linalg.eigvals(np.linalg.solve(M3, K3)).real.max()))
    limit = 2 / omega
    found = {scale: _definite(scale * limit) for scale in (0.1, 0.99, 1.01)}
    sharp = "and no longer" if found[0.99] and not found[1.01] else "but not just there"
    numbers = f"Three masses: it holds for h < 2/omega_max = {number(limit, 3)} s {sharp} (checked at 0.1, 0.99 and 1.01 of it)."
    return Verdict(word(found[0.1]), numbers)


def _definite(h: float) -> bool:
    Md, Dd, Kd = M3 / h + h * K3 / 4 + D3 / 2, -2 * M3 / h + h * K3 / 2, M3 / h + h * K3 / 4 - D3 / 2
    return bool(min(np.linalg.eigvalsh(X).min() for X in (Md, -Dd, Kd)) > 0)


def held_input_hides_h(tables: Tables) -> Verdict:
    table = tables["zoh_input"]
    h = table.points("sampling.h_s")
    errors = {x: max(table.at(sampling__h_s=x).median(f"{X}_error") for X in "MDK") for x in h}
    words = ", ".join(f"{number(e)} at h = {number(x)}" for x, e in errors.items())
    numbers = f"Noise-free binary force held over h, n4sid + d2c: largest error of M, D, K {words}. Rounding alone is amplified."
    return Verdict(word(max(errors.values()) < 1e-3), numbers, table.runs)


EXACT_START = "variational_pem_exact"

CLAIMS = (
    Claim("The midpoint rule is the Cayley-Tustin transform.", "Proposition 3.1.1", (), midpoint_is_cayley),
    Claim("Step-invariant discretisation and ZOH are the same.", "A.1", (), step_invariant_is_zoh),
    Claim("M_d > 0, K_d > 0, D_d < 0 if h is small enough.", "(2.25)", (), signs_of_discrete_matrices),
    Claim("The midpoint rule errs by O(h^2).", "section 2.2", ("discretisation", "bias"), midpoint_second_order),
    Claim("Other rules approximate the flow to higher order than O(h^2).", "section 2.2, chapter 6", ("discretisation",), higher_order_rules),
    Claim("A variational rule keeps the symplectic form, but in general not the energy.", "section 2.1", ("energy",), symplectic_not_energy),
    Claim("For small h the Cayley-Tustin error is of the same order of magnitude as that of ZOH.", "section 3.1", ("discretisation",), same_order_as_zoh),
    Claim("Under the midpoint rule passivity is kept, with the same energy function.", "section 3.3, Theorem 3.3.1", ("passivity",), midpoint_keeps_passivity),
    Claim("With the standard sampled input and output, ZOH does not preserve passivity.", "section 3.3", ("passivity",), zoh_loses_passivity),
    Claim("The midpoint rule conserves the energy of a lossless linear system perfectly.", "section 3.3", ("energy",), midpoint_conserves),
    Claim("The energy of every variational integrator stays bounded and oscillates.", "section 3.3", ("energy",), variational_oscillates),
    Claim("With a held input and no noise, identification gives the same whatever h.", "section 5.1", ("zoh_input",), held_input_hides_h),
    Claim("No discretisation rule describes the smooth data, even without noise.", "section 5.1", ("discretisation",), no_exact_rule),
)  # fmt: skip

"""record -> black-box model by jax-sysid (PyPI): gradient search of the output error, M, D, K projected."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass

from sysid_bench.mechanics.black_box import estimate_of_black_box, peer_module
from sysid_bench.mechanics.suitability import require_plain
from sysid_bench.nouns import Estimate, Model, Record


@dataclass(frozen=True)
class PeerJaxSysid:
    """LinearModel from a random start. adam_epochs, lbfgs_epochs: iterations of the two searches; seed: of the start."""

    adam_epochs: int = 1000
    lbfgs_epochs: int = 1000
    seed: int = 0

    nominal = False

    def fit(self, record: Record, model: Model) -> Estimate:
        """Raises NotApplicable where the package is missing, Diverged where the model found is not finite."""
        require_plain(record, model, "jax-sysid")
        jax = peer_module("jax", "jax-sysid")
        peer = peer_module("jax_sysid.models", "jax-sysid")
        jax.config.update("jax_enable_x64", True)
        su, sy = record.u.std(axis=0), record.y.std(axis=0)
        with contextlib.redirect_stdout(io.StringIO()):
            found = peer.LinearModel(2 * model.n, record.ny, record.nu, feedthrough=True, seed=self.seed)
            found.loss(rho_x0=1e-6, rho_th=1e-8)
            found.optimization(adam_epochs=self.adam_epochs, lbfgs_epochs=self.lbfgs_epochs, iprint=-1)
            found.fit(record.y / sy, record.u / su)
            A, B, C, D = found.ssdata()[:4]
        scaled = (A, B / su, C * sy[:, None], D * sy[:, None] / su)
        return estimate_of_black_box(*scaled, record.h, model, {"lbfgs_epochs": self.lbfgs_epochs})

"""The engine on the same work, called like its peers: chunks of a planned sweep, as a worker runs them."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers import Peer, Run
from benchmarks.promises import run_chunks
from benchmarks.work import Peaks, Work
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Scene
from pounding_sweep.plan.plan import Plan
from pounding_sweep.run.sweep import Sweep

#: What every tool reports, and nothing else.
OUTPUTS = ("displacement_max", "displacement_min", "impact_force_max", "impact_count")
#: Scenarios timed together: whole lane groups.
BATCH = 256


def plan_gaps(work: Work, gaps: np.ndarray, **settings: Any) -> Plan:
    """Return the plan of a sweep of the work over gaps (m)."""
    axes = {"gaps": gaps, "stiffnesses": work.stiffness}
    if get_law(work.law).takes_restitution:
        axes["restitutions"] = work.restitution
    return Sweep(work.scene, work.record, work.law, **axes, **{"outputs": OUTPUTS, "rest": 0.0, **settings}).plan()


def peaks_of(scene: Scene, found: dict[str, np.ndarray]) -> Peaks:
    """Return the peaks of a cube's variables, shape (n, *inner), by floor and by contact."""
    contact = tuple(np.array([(c.pair, c.storey - 1) for c in scene.contacts]).T)
    floor = tuple(np.array([(b, s) for b, one in enumerate(scene.buildings) for s in range(one.n_storeys)]).T)
    return Peaks(
        found["impact_force_max"][:, *contact],
        found["impact_count"][:, *contact].astype(float),
        found["displacement_max"][:, *floor],
        found["displacement_min"][:, *floor],
    )


def prepare(work: Work, **settings: Any) -> Run:
    """Return what runs scenarios of the work through the engine; each set of gaps is planned once."""
    plans: dict[bytes, Plan] = {}

    def run(gaps: np.ndarray) -> Peaks:
        key = np.ascontiguousarray(gaps).tobytes()
        if key not in plans:
            plans[key] = plan_gaps(work, gaps, **settings)
        plan = plans[key]
        found = run_chunks(plan)
        return peaks_of(work.scene, {name: found[name][plan.inverse] for name in OUTPUTS})

    return run


def _scheme(
    key: str, title: str, settings: tuple[float, ...], short: tuple[float, ...] = (), knob: str = "dt", **fixed: Any
) -> Peer:
    def prepared(work: Work, value: float) -> Run:
        return prepare(work, **{knob: value}, **fixed)

    laws = ("linear", "hertz_damped", "nonlinear_viscoelastic")
    return Peer(key, title, "pounding-sweep", "pounding_sweep", knob, settings, short, prepared, laws, BATCH)


#: The engine's own rows.
SCHEMES = (
    _scheme("exact", "engine exact", (5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4), (2.5e-3,), method="exact"),
    _scheme("rk4", "engine rk4", (1e-2, 5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4), (2.5e-3, 1e-3), method="rk4"),
    _scheme("newmark", "engine newmark", (2.5e-3, 1e-3, 5e-4, 2.5e-4), method="newmark"),
    _scheme("exact-float32", "engine exact, float32", (5e-3, 2.5e-3, 1e-3), method="exact", precision="float32"),
    _scheme("rk4-float32", "engine rk4, float32", (1e-2, 5e-3, 2.5e-3, 1e-3), method="rk4", precision="float32"),
    _scheme("rk4-plain", "engine rk4, not located", (1e-3, 2.5e-4), method="rk4", locate=False),
    _scheme("accuracy", "engine, accuracy asked for", (1e-2, 1e-3, 1e-4, 1e-5, 1e-6), knob="accuracy"),
)

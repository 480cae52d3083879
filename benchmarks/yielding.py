"""What yielding costs: ``python -m benchmarks.yielding`` prints the paper's row elastic and yielding, and OpenSees.

A second table has exact flight, which costs by what happens, at several strengths: alone by
``python -m benchmarks.yielding flight``.

The row of Mate, Bakre & Jaiswal (2015) without pounding under El Centro, its strengths a fourth of the largest elastic
storey shears, hardening 5 %. In OpenSees, where it can be imported, the same storeys of `Steel01` under Newmark's
average acceleration. The error is the largest of a storey drift, over the largest drift, against RK4 at 0.1 ms.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import pounding_sweep as ps
from benchmarks.degrading import build
from benchmarks.peers.opensees import largest_drifts, shake
from benchmarks.timing import medians
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import get_law
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, reducers_for

#: Strength reduction, hardening, scenarios at a time, and turns of each job.
REDUCTION, HARDENING, BATCH, ROUNDS = 4.0, 0.05, 64, 31
#: Steps (s) of each scheme, and of OpenSees.
STEPS = {"rk4": (5e-3, 2e-3, 1e-3), "newmark": (2e-3, 1e-3, 5e-4)}
OPENSEES = (1e-3, 5e-4)
FINEST = 1e-4
#: Strength reductions and step (s) of the table of exact flight, and the width (m) of a gap that is never closed.
REDUCTIONS, STEP, FAR = (1.2, 2.0, 4.0), 2e-3, 1e3


def runner(scene: ps.Scene, record: ps.Record, method: str, dt: float, law: str = "none") -> Callable[[], np.ndarray]:
    """Return what runs scenarios of a row at neighbouring gaps, and returns the largest storey drifts (m)."""
    kernel = RowKernel(scene, get_law(law), Numerics(method, dt), reducers_for(DEFAULT_OUTPUTS))
    gaps = np.linspace(0.002, 0.024, BATCH)[:, None] * np.ones(len(scene.pair_names))
    ones = np.ones(BATCH)
    given: dict[str, Any] = {"scale": ones, "gaps": gaps, "stiffness": 2e6 * ones, "restitution": 0.6 * ones}
    return lambda: kernel.run(record, **given)["drift"]


def weakened(scene: ps.Scene, record: ps.Record, reduction: float = REDUCTION) -> ps.Scene:
    """Return the row with storeys that yield at a share of the largest shears of the elastic row."""
    k = np.concatenate([building.storey_stiffnesses for building in scene.buildings])
    parts = np.split(runner(scene, record, "rk4", 1e-3)()[0] * k / reduction, scene.offsets[1:-1])
    pairs = zip(scene.buildings, parts, strict=True)
    row = [replace(building, yield_strengths=part.tolist(), hardening=HARDENING) for building, part in pairs]
    return ps.Scene(row, scene.gaps, scene.contact)


def opensees(ops: Any, scene: ps.Scene, record: ps.Record, dt: float) -> np.ndarray:
    """Run the row alone through OpenSees; returns the largest storey drifts (m)."""
    build(ops, scene, "none")
    shake(ops, record)
    return largest_drifts(ops, range(1, scene.n_dof + 1), record, dt)


def yielded(scene: ps.Scene, record: ps.Record) -> tuple[float, int]:
    """Share of the time in which any storey of a row without pounding yields, and how many times one begins to."""
    alone = ps.Scene(scene.row, [FAR] * len(scene.gaps), scene.contact)
    plastic = ps.simulate(alone, record, law="none", dt=STEP).plastic_drift.values
    moves = np.diff(plastic.reshape(len(plastic), -1), axis=0) != 0.0
    return float(moves.any(axis=1).mean()), int((moves[1:] & ~moves[:-1]).sum())


def flight(scene: ps.Scene, record: ps.Record) -> None:
    """Print the table of exact flight."""
    print("| strength reduction | time in which a storey yields | onsets | pounding | elastic, `exact` (µs) |", end="")
    print(" yielding, `exact` (µs) | yielding, `rk4` (µs) | drifts differ by |")
    print("|---|---|---|---|---|---|---|---|")
    for reduction in REDUCTIONS:
        weak = weakened(scene, record, reduction)
        share, onsets = yielded(weak, record)
        for law, name in (("none", "no"), ("kelvin_voigt", "yes")):
            cases = ((scene, "exact"), (weak, "exact"), (weak, "rk4"))
            jobs = [runner(row, record, method, STEP, law) for row, method in cases]
            _, mine, other = (job() for job in jobs)
            times = " | ".join(f"{each / BATCH * 1e6:.1f}" for each in medians(*jobs))
            off = np.abs(mine - other).max() / other.max()
            print(f"| {reduction:g} | {share:.1%} | {onsets} | {name} | {times} | {off:.1e} |")


def main() -> None:
    """Print the tables."""
    scene, record = ps.get_preset("mate2015"), ps.find_record("el_centro")
    if "flight" in sys.argv[1:]:
        flight(scene, record)
        return
    weak = weakened(scene, record)
    want = runner(weak, record, "rk4", FINEST)()[0]
    print("| | step (ms) | elastic (ms) | yielding (ms) | ratio | error of drifts | ratio with pounding |")
    print("|---|---|---|---|---|---|---|")
    for method, steps in STEPS.items():
        for dt in steps:
            jobs = [runner(row, record, method, dt, law) for law in ("none", "kelvin_voigt") for row in (scene, weak)]
            drift = [job()[0] for job in jobs][1]
            plain, yields, touching, both = (each / BATCH * 1e3 for each in medians(*jobs, rounds=ROUNDS))
            error = np.abs(drift - want).max() / want.max()
            print(
                f"| engine `{method}` | {dt * 1e3:g} | {plain:.3f} | {yields:.3f} | {yields / plain:.1f} | {error:.1e} "
                f"| {both / touching:.1f} |"
            )
    compare_opensees(weak, record, want)
    print()
    flight(scene, record)


def compare_opensees(weak: ps.Scene, record: ps.Record, want: np.ndarray) -> None:
    """Print the rows of OpenSees."""
    try:
        import openseespy.opensees as ops
    except (ImportError, RuntimeError) as fault:
        print(f"\nOpenSees is left out: {fault}")
        return
    for dt in OPENSEES:
        drift = opensees(ops, weak, record, dt)
        (seconds,) = medians(lambda dt=dt: opensees(ops, weak, record, dt), rounds=3)  # type: ignore[misc]
        error = np.abs(drift - want).max() / want.max()
        print(f"| OpenSees `Steel01` | {dt * 1e3:g} | | {seconds * 1e3:.0f} | | {error:.1e} | |")


if __name__ == "__main__":
    main()

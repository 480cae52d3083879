"""Storeys that degrade beside OpenSees: ``python -m benchmarks.degrading > docs/_static/degrading.txt``.

The row of `sweeps/degrading.toml`: histories of both frames under four records by both programs, what a scenario of the
row costs at equal error, and what its storeys cost beside bilinear ones between the same number of events.
"""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import pounding_sweep as ps
from benchmarks.engine import run_chunks
from benchmarks.peers.opensees import displacements, floors_of, shake, start_row
from benchmarks.timing import medians
from pounding_sweep.kernel.spec import history_slots
from pounding_sweep.model.building import Building
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.run.refinement import STATES, run_scenarios
from pounding_sweep.run.sweep import Sweep, load_sweep

SWEEP = Path(__file__).resolve().parent.parent / "sweeps" / "degrading.toml"
#: Peak accelerations (m/s2) of the records of the comparison, and OpenSees's step (s) there.
PEAKS, STEP = {"el_centro": 5.0, "synthetic-1": 4.5, "synthetic-2": 4.0, "synthetic-3": 4.0}, 2e-4
#: Steps of OpenSees (s) whose cost is compared, and the gap (m).
STEPS, GAP = (2e-3, 1e-3, 5e-4), 0.02
MATERIALS = {"peak_oriented": "IMKPeakOriented", "pinching": "IMKPinching", "bilinear": "IMKBilin"}
#: Reference drift (m) of a mode that does not deteriorate.
NEVER = 1e12


def materials(building: Building) -> list[list[tuple[Any, ...]]]:
    """Return the materials of each storey's springs in parallel: a name and arguments each."""
    result = []
    for storey in range(building.n_storeys):
        assert building.yield_strengths is not None
        own = building.storey_stiffnesses[storey], building.yield_strengths[storey], building.hardenings[storey]
        wall = [building.of_infill(name)[storey] for name in ("stiffnesses", "yield_strengths", "hardening")]
        springs: list[tuple[Any, ...]] = [("Elastic", -building.geometric_stiffnesses[storey])] * building.p_delta
        for law, parameters, is_infill in building.springs_of(storey):
            k, strength, hardening = wall if is_infill else own
            if not law.can_fail:
                springs.append(("Steel01", strength, k, hardening))
                continue
            cap, dy = parameters.cap_drift, strength / k
            peak = strength + hardening * k * (cap - dy)
            side = [cap - dy, peak / (-parameters.post_cap * k), parameters.ultimate_drift or 1e3, strength]
            side += [peak / strength, parameters.residual]
            modes = [getattr(parameters.deterioration, name, NEVER) for name in ("strength", "post_cap")]
            modes += [getattr(parameters.deterioration, name, NEVER) for name in ("reloading", "unloading")]
            pinch = [parameters.pinch_force, parameters.pinch_drift] if law.name == "pinching" else []
            springs.append((MATERIALS[law.name], k, *side, *side, *modes, *[1.0] * 6, *pinch))
        result.append(springs)
    return result


def build(ops: Any, scene: ps.Scene, law: str) -> None:
    """Build a row, its springs side by side, with gap elements between floors under the law "linear"."""
    start_row(ops)
    tag = 0
    for building, first in zip(scene.buildings, scene.offsets, strict=False):
        elements = []
        for storey, springs in enumerate(materials(building)):
            node = first + storey + 1
            ops.node(node, 0.0)
            ops.mass(node, building.masses[storey])
            for name, *arguments in springs:
                tag += 1
                ops.uniaxialMaterial(name, tag, *map(float, arguments))
                ends = 1000 if storey == 0 else node - 1, node
                ops.element("zeroLength", tag, *ends, "-mat", tag, "-dir", 1, "-doRayleigh", 1)
                elements.append(tag)
        alpha, beta = map(float, building.rayleigh)
        ops.region(1 + first, "-ele", *elements, "-rayleigh", alpha, 0.0, beta, 0.0)
    for contact in scene.contacts if law == "linear" else ():
        tag += 1
        ops.uniaxialMaterial("ElasticPPGap", tag, scene.contact.linear_stiffness, -1e20, -GAP)
        ops.element("zeroLength", tag, contact.left + 1, contact.right + 1, "-mat", tag, "-dir", 1)


def histories(ops: Any, scene: ps.Scene, record: ps.Record, law: str, dt: float) -> np.ndarray:
    """Displacements (m) of all floors by OpenSees at the points of the record, shape (points, floors)."""
    build(ops, scene, law)
    shake(ops, record)
    return displacements(ops, range(1, scene.n_dof + 1), record, dt, round(record.dt / dt))


def simulated(scene: ps.Scene, record: ps.Record, law: str = "none") -> tuple[xr.Dataset, np.ndarray]:
    """Return a run of the row by `exact`, and the same of it."""
    one = ps.simulate(scene, record, law=law, method="exact", rest=0.0, output_step=record.dt)
    return one, floors_of(one, scene, record.time)


def distance(some: np.ndarray, others: np.ndarray) -> float:
    """Return the largest difference over the largest value."""
    return float(np.abs(some - others).max() / np.abs(others).max())


def count_events(scene: ps.Scene, record: ps.Record) -> int:
    """Return how often a spring of the row without pounding changes its branch, by points of 1 ms."""
    plan = make_plan(Sweep(scene, record, "none", method="exact", dt=1e-3, rest=0.0, outputs=["drift_max"]).spec)
    kernel = replace(plan.kernel(0, record=0, steps=int(plan.steps[0])), history=True)
    states = run_scenarios(ChunkTask(kernel, record, plan.unique, plan.variants, plan.outputs))[STATES][0]
    slots = history_slots(kernel.shape)
    phases = states[:, slots.first["phase"] :][:, : slots.count["phase"]]
    return int((np.diff(phases, axis=0) != 0.0).sum())


def agree(ops: Any, scene: ps.Scene, records: list[ps.Record]) -> None:
    """Print how far displacements of both programs are apart."""
    print(f"Displacements of all floors at all points of the record, OpenSees at steps of {STEP:g} s")
    print(f"{'building':<10}{'record':<14}{'strength left':>24}{'largest (mm)':>14}{'difference':>12}")
    for alone, record in product([ps.Scene([building]) for building in scene.buildings], records):
        one, mine = simulated(alone, record)
        shares = ", ".join(f"{share:.2f}" for share in one.strength_left.values[0])
        error, largest = distance(histories(ops, alone, record, "none", STEP), mine), 1e3 * np.abs(mine).max()
        print(f"{alone.buildings[0].name:<10}{record.name:<14}{shares:>24}{largest:>14.1f}{error:>12.1e}", flush=True)


def cost(ops: Any, sweep: Sweep, record: ps.Record) -> None:
    """Print what scenarios of the sweep cost, and one with contacts in OpenSees at several steps."""
    spec, row = sweep.spec, replace(sweep.spec.scene, gaps=[GAP])
    arguments: dict[str, Any] = {"gaps": list(spec.gaps or ())[1:], "pgas": spec.pgas, "outputs": list(spec.outputs)}
    part = Sweep(spec.scene, list(spec.records[:4]), ["none", "kelvin_voigt"], **arguments).plan()
    run_chunks(part)
    each = medians(lambda: run_chunks(part), rounds=3)[0] / len(part.unique)
    print(
        f"\n{len(part.unique)} scenarios of the sweep, at accuracy 1e-3: {1e3 * each:.2f} ms of a core each, ", end=""
    )
    print(f"{2.0 / each:.0f} scenarios per second on two cores")
    many = Sweep(row, record, "linear", scales=np.linspace(0.95, 1.0, 64), rest=0.0, outputs=list(spec.outputs)).plan()
    run_chunks(many)
    mine = medians(lambda: run_chunks(many), rounds=3)[0] / 64
    one, fine = simulated(row, record, "linear")
    told = distance(run_chunks(many)["drift_ratio_max"][-1], one.drift_ratio_max.values)
    print(f"The row under {record.name}, {GAP * 1e3:g} mm apart, law linear, no rest, at accuracy 1e-3: ", end="")
    print(f"{1e3 * mine:.2f} ms of a core, drifts off by {told:.1e}")
    for dt in STEPS:
        began = time.process_time()
        error = distance(histories(ops, row, record, "linear", dt), fine)
        took = time.process_time() - began
        print(
            f"  OpenSees, {1e3 * dt:g} ms: {took:.2f} s, off by {error:.1e}, {took / mine:.0f} times as long",
            flush=True,
        )


def beside_bilinear(scene: ps.Scene, records: list[ps.Record]) -> None:
    """Print what storeys that degrade cost beside bilinear ones, by `exact` without contacts."""
    rows = {}
    for law, more in (
        ("bilinear", None),
        ("peak_oriented", {}),
        ("pinching", {"pinch_force": 0.3, "pinch_drift": 0.3}),
    ):
        tables = [None if more is None else vars(item.hysteresis) | {"law": law, **more} for item in scene.buildings]
        pairs = zip(scene.buildings, tables, strict=True)
        rows[law] = replace(scene, row=[replace(item, hysteresis=table, infill=None) for item, table in pairs])
    settings: dict[str, Any] = {"scales": np.linspace(0.9, 1.0, 64), "method": "exact", "dt": 5e-3, "rest": 0.0}
    plans = [Sweep(row, records, "none", **settings).plan() for row in rows.values()]
    jobs = [lambda plan=plan: run_chunks(plan) for plan in plans]
    events = [sum(count_events(row, record) for record in records) for row in rows.values()]
    for job in jobs:
        job()
    times = medians(*jobs)
    print("\nBoth frames without infill and contacts, by `exact`")
    for law, count, seconds in zip(rows, events, times, strict=True):
        ratio, per_event = seconds / times[0], seconds / times[0] * events[0] / count
        print(f"  {law:<14}{count:>6} events, {ratio:.2f} times the time, {per_event:.2f} at as many events")


def main() -> None:
    """Print what differs from OpenSees, and what storeys that degrade cost."""
    import openseespy.opensees as ops

    ops.logFile("/dev/null", "-noEcho")
    sweep = load_sweep(SWEEP)
    found = {record.name: record for record in (*sweep.spec.records, ps.find_record("el_centro"))}
    records = [found[name].scaled_to(peak) for name, peak in PEAKS.items()]
    agree(ops, sweep.spec.scene, records)
    cost(ops, sweep, records[1])
    beside_bilinear(sweep.spec.scene, records)


if __name__ == "__main__":
    main()

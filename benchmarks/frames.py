"""Frames beside OpenSees and beside shear chains: ``python -m benchmarks.frames > docs/_static/frames.txt``.

A frame of 3 bays and 6 storeys and the same with a wall, built in OpenSees and taken over by `building_from_opensees`:
histories under El Centro by both programs; what a shear chain fitted to the frame gets wrong; and what a matrix costs
in place of a chain of storeys.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import pounding_sweep as ps
from benchmarks.engine import OUTPUTS
from benchmarks.peers.opensees import displacements, floors_of, shake
from benchmarks.sizes import job_of
from benchmarks.timing import medians
from pounding_sweep.run.sweep import Sweep

#: Nodes of each floor, and their mass (t) below the roof and at it.
FLOORS = {floor: [10 * floor + column for column in range(4)] for floor in range(1, 7)}
NODE_MASS, ROOF_MASS = 30.0, 24.0
#: Damping proportional to masses (1/s), in both programs.
ALPHA = 0.4
#: What stands to the right of each frame, and the gap (m) and contact stiffness (kN/m) between them.
NEIGHBOUR = ps.Building(
    "neighbour",
    [150.0] * 4,
    [2.4e5, 2.1e5, 1.7e5, 1.2e5],
    storey_heights=[3.5] * 4,
    damping_matrix=(ALPHA * 150.0 * np.eye(4)).tolist(),
)
GAP, STIFFNESS = 0.03, 2e5
#: Step of OpenSees (s), and how many of them pass between instants that are compared.
STEP, EVERY = 1e-4, 10


def build_frame(ops: Any, walls: bool) -> None:
    """Build the frame, its floors tied; with walls, the last column of each storey is one."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    for floor in range(7):
        for column in range(4):
            ops.node(10 * floor + column, 6.0 * column, 3.5 * floor)
            if floor == 0:
                ops.fix(column, 1, 1, 1)
            else:
                ops.mass(10 * floor + column, NODE_MASS if floor < 6 else ROOF_MASS, 0.0, 0.0)
    ops.geomTransf("Linear", 1)
    for floor in range(1, 7):
        for column in range(4):
            inertia = 1.2 if walls and column == 3 else 0.4**4 / 12
            ends = 10 * (floor - 1) + column, 10 * floor + column
            ops.element("elasticBeamColumn", 100 + ends[1], *ends, 0.25, 3e7, inertia, 1)
        for column in range(3):
            ends = 10 * floor + column, 10 * floor + column + 1
            ops.element("elasticBeamColumn", 200 + ends[0], *ends, 0.15, 3e7, 0.3 * 0.6**3 / 12, 1)
            ops.equalDOF(10 * floor, 10 * floor + column + 1, 1)


def frame_building(ops: Any, walls: bool) -> ps.Building:
    """Return the building of the frame, damped by its masses."""
    build_frame(ops, walls)
    masses = [4.0 * (NODE_MASS if floor < 6 else ROOF_MASS) for floor in FLOORS]
    damping = ALPHA * np.diag(masses)
    return ps.building_from_opensees(ops, FLOORS, name="frame", damping_matrix=damping)


def add_neighbour(ops: Any) -> None:
    """Build the neighbour, and gap elements that press between its floors and the frame's."""
    for i, height in enumerate((0.0, *NEIGHBOUR.elevations)):
        ops.node(1000 + i, 18.0, float(height))
        ops.fix(1000 + i, int(i == 0), 1, 1)
    for i, (mass, stiffness) in enumerate(zip(NEIGHBOUR.masses, NEIGHBOUR.storey_stiffnesses, strict=True), 1):
        ops.mass(1000 + i, mass, 0.0, 0.0)
        ops.uniaxialMaterial("Elastic", i, stiffness)
        ops.element("zeroLength", 1000 + i, 999 + i, 1000 + i, "-mat", i, "-dir", 1)
        ops.uniaxialMaterial("ElasticPPGap", 100 + i, STIFFNESS, -1e20, -GAP)  # it never yields
        ops.element("zeroLength", 1100 + i, 10 * i + 3, 1000 + i, "-mat", 100 + i, "-dir", 1)


def histories(ops: Any, walls: bool, beside: bool, record: ps.Record) -> np.ndarray:
    """Displacements (m) of all floors by OpenSees, every `EVERY` steps of `STEP`, shape (instants, floors)."""
    build_frame(ops, walls)
    nodes = [10 * floor for floor in FLOORS]
    if beside:
        add_neighbour(ops)
        nodes += [1000 + i for i in range(1, NEIGHBOUR.n_storeys + 1)]
    ops.rayleigh(ALPHA, 0.0, 0.0, 0.0)
    shake(ops, record, "Transformation", *(["Newton"] if beside else ["Linear", "-factorOnce"]))
    return displacements(ops, nodes, record, STEP, EVERY)


def row_of(building: ps.Building) -> ps.Scene:
    """Return the row of a building and the neighbour."""
    return ps.Scene([building, NEIGHBOUR], [GAP], ps.ContactProperties(linear_stiffness=STIFFNESS))


def difference(ops: Any, walls: bool, beside: bool, record: ps.Record) -> tuple[float, float]:
    """Return the largest difference of displacements from OpenSees over the largest displacement, and that (m)."""
    building = frame_building(ops, walls)
    scene = row_of(building) if beside else ps.Scene([building])
    law, dt = "linear" if beside else "none", STEP * EVERY
    one = ps.simulate(scene, record, law=law, method="exact", dt=dt, rest=0.0, output_step=dt)
    other = histories(ops, walls, beside, record)
    at = np.arange(len(other)) * dt
    largest = float(abs(other).max())
    return float(abs(floors_of(one, scene, at) - other).max()) / largest, largest


def fitted_chain(building: ps.Building) -> ps.Building:
    """Return the shear chain of a building: shears over drifts under forces of its first mode.

    The chain has the first mode and period of the building, and its damping matrix.
    """
    shape = building.modes[1][:, 0]
    forces = building.lateral_matrix @ shape
    stiffnesses = np.cumsum(forces[::-1])[::-1] / np.diff(shape, prepend=0.0)
    return replace(building, stiffness_matrix=None, stiffnesses=stiffnesses.tolist())


#: What the chain is asked for: title, and the value of a run without pounding, of one with it, and of the gap.
ANSWERS: dict[str, Callable[[Any, Any, Any], np.ndarray]] = {
    "drift, alone": lambda alone, pounding, gap: alone.drift_max.values[0],
    "drift, pounding": lambda alone, pounding, gap: pounding.drift_max.values[0],
    "largest drift": lambda alone, pounding, gap: pounding.drift_max.values[0].max(),
    "impact force": lambda alone, pounding, gap: np.nanmax(pounding.impact_force_max.values),
    "required gap": lambda alone, pounding, gap: gap.exact.values.ravel(),
}


def answers(building: ps.Building, record: ps.Record) -> list[np.ndarray]:
    """Return what `ANSWERS` asks of a building beside the neighbour, under a record."""
    scene = row_of(building)
    alone, pounding = (ps.simulate(scene, record, law=law, accuracy=1e-5) for law in ("none", "linear"))
    gap = ps.analysis.required_gap(scene, record)
    return [np.atleast_1d(value(alone, pounding, gap)) for value in ANSWERS.values()]


def row_cost(storeys: int, method: str, rounds: int = 15) -> float:
    """Return how much more processor time a row takes with a chain given as its matrix than with the chain.

    The row is two buildings that pound at all floors under El Centro, which differ by their stiffness.
    """
    chains = [ps.Building(name, [175.0] * storeys, [k] * storeys) for name, k in (("a", 5.5e5), ("b", 4e5))]
    dense = replace(chains[0], stiffnesses=None, stiffness_matrix=chains[0].lateral_matrix.tolist())
    contact = ps.ContactProperties(linear_stiffness=2e6)
    jobs = []
    for first in (chains[0], dense):
        scene = ps.Scene([first, chains[1]], [0.01 * storeys / 3.0], contact)
        gaps = 0.01 * storeys / 3.0 * np.linspace(0.8, 1.2, 512)
        plan = Sweep(scene, "el_centro", "linear", gaps=gaps, method=method, dt=2.5e-3, outputs=OUTPUTS).plan()
        jobs.append(job_of(plan))
    chain, matrix = medians(*jobs, rounds=rounds)
    return matrix / chain


#: Rows whose cost is compared, and most that a matrix may cost in place of a chain.
COSTS = {(3, "exact"): 1.3, (10, "exact"): 2.0, (3, "rk4"): 2.0}


def main() -> None:
    """Print what differs from OpenSees, what a fitted chain gets wrong, and what a matrix costs."""
    import openseespy.opensees as ops

    ops.logFile("/dev/null", "-noEcho")  # elements of no length between floors have one
    record = ps.find_record("el_centro")
    kinds = {"frame": False, "frame and wall": True}
    print(f"Displacements under El Centro, of all floors at all instants, OpenSees at steps of {STEP:g} s")
    for name, walls in kinds.items():
        for beside in (False, True):
            error, largest = difference(ops, walls, beside, record)
            what = f"{name}, {'beside a neighbour' if beside else 'alone'}"
            print(f"  {what:<36} largest {1e3 * largest:6.1f} mm, difference {error:.1e} of it", flush=True)
    records = [record, *(ps.synthetic_record(seed, pga=3.0) for seed in (1, 2, 3, 4, 5))]
    print("\nA shear chain fitted to the first mode in place of the building, errors of largest responses")
    for name, walls in kinds.items():
        building = frame_building(ops, walls)
        chain = fitted_chain(building)
        periods = [", ".join(f"{period:.3f}" for period in item.periods[:3]) for item in (building, chain)]
        print(f"{name}: periods {periods[0]} s, chain {periods[1]} s")
        print(f"  {'record':<14}" + "".join(f"{title:>18}" for title in ANSWERS))
        for each in records:
            pairs = zip(answers(building, each), answers(chain, each), strict=True)
            errors = [of_chain / true - 1.0 for true, of_chain in pairs]
            worst = [error[np.argmax(abs(error))] for error in errors]
            print(f"  {each.name:<14}" + "".join(f"{error:>18.1%}" for error in worst), flush=True)
    print("\nProcessor time with a chain given as its matrix, over that with the chain")
    for (storeys, method), most in COSTS.items():
        print(f"  {storeys:>2} storeys, {method:<6} {row_cost(storeys, method):.2f} (at most {most:g})", flush=True)


if __name__ == "__main__":
    main()

"""P-Delta beside OpenSees: ``python -m benchmarks.p_delta`` prints largest drifts of a yielding row by both.

OpenSees gets no geometric stiffness: weights stand on a leaning column of stiff corotational trusses that floors take
along, so that its equilibrium is that of the displaced shape, to any order.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import pounding_sweep as ps
from benchmarks.peers.opensees import largest_drifts
from pounding_sweep.records import STANDARD_GRAVITY

#: Two storeys whose stiffness is falling while they yield.
TOWER = ps.Building(
    "tower", [120.0, 90.0], [6e3, 4.5e3], 0.05, [4.0, 3.0], yield_strengths=[150.0, 100.0], hardening=0.03, p_delta=True
)
#: Lateral distance of the leaning column (m), of no weight in the results; its axial stiffness E A (kN).
ASIDE, AXIAL = 10.0, 1e9


def opensees(ops: Any, building: ps.Building, record: ps.Record, dt: float) -> np.ndarray:
    """Run a building, with its weights on a leaning column if it has P-Delta; returns the largest storey drifts (m)."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 2)
    n, tags = building.n_storeys, range(1, building.n_storeys + 1)
    alpha, beta = map(float, building.rayleigh)
    assert building.yield_strengths is not None
    for i, z in enumerate((0.0, *building.elevations)):
        ops.node(i, 0.0, 0.0)
        ops.fix(i, int(i == 0), 1)
        ops.node(100 + i, ASIDE, float(z))
        ops.fix(100 + i, 0, int(i == 0))
        ops.equalDOF(i, 100 + i, 1)
    for i in tags:
        ops.mass(i, building.masses[i - 1], 0.0)
        given = float(building.yield_strengths[i - 1]), building.storey_stiffnesses[i - 1], building.hardening
        ops.uniaxialMaterial("Steel01", i, *given)
        ops.element("zeroLength", i, i - 1, i, "-mat", i, "-dir", 1)
        ops.uniaxialMaterial("Viscous", 200 + i, beta * building.lateral_stiffnesses[i - 1], 1.0)
        ops.element("zeroLength", 200 + i, i - 1, i, "-mat", 200 + i, "-dir", 1)
    ops.uniaxialMaterial("Elastic", 100, AXIAL)
    for i in tags:
        ops.element("corotTruss", 100 + i, 99 + i, 100 + i, 1.0, 100)
    _solver(ops)
    if building.p_delta:
        ops.timeSeries("Linear", 1)
        ops.pattern("Plain", 1, 1)
        for i in tags:
            ops.load(100 + i, 0.0, -building.masses[i - 1] * STANDARD_GRAVITY)
        ops.integrator("LoadControl", 0.1)
        ops.analysis("Static")
        ops.analyze(10)
        ops.loadConst("-time", 0.0)
        ops.wipeAnalysis()
        _solver(ops)
    ops.timeSeries("Path", 2, "-dt", record.dt, "-values", *map(float, record.acceleration))
    ops.pattern("UniformExcitation", 2, 1, "-accel", 2)
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    ops.rayleigh(alpha, 0.0, 0.0, 0.0)
    return largest_drifts(ops, tags, record, dt).reshape(n, -1)[:, 0]


def _solver(ops: Any) -> None:
    ops.system("UmfPack")
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.test("NormDispIncr", 1e-11, 50)
    ops.algorithm("Newton")


def main() -> None:
    """Print drifts (mm) of the engine and of OpenSees."""
    import openseespy.opensees as ops

    record = ps.find_record("el_centro")
    print("| drifts (mm) | engine | OpenSees | largest difference |")
    for name, building in (("without P-Delta", replace(TOWER, p_delta=False)), ("with P-Delta", TOWER)):
        scene = ps.Scene([building])
        mine = ps.simulate(scene, record, law="none", dt=5e-4, rest=0.0).drift_max.values[0]
        other = opensees(ops, building, record, 5e-4)
        numbers = [", ".join(f"{1e3 * drift:.3f}" for drift in each) for each in (mine, other)]
        print(f"| {name} | {' | '.join(numbers)} | {np.abs(mine / other - 1.0).max():.1e} |")


if __name__ == "__main__":
    main()

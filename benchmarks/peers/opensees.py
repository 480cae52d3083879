"""OpenSees through OpenSeesPy: Newmark's average acceleration with its own gap and impact materials."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import pounding_sweep as ps
from benchmarks.peers import Peer, Run
from benchmarks.work import Peaks, Work
from pounding_sweep.model.laws import damping_number
from pounding_sweep.records import Record

#: Convergence of Newton's method, as a norm of displacement increments (m), and its most iterations.
INCREMENT, ITERATIONS = 1e-12, 50
#: Material of each contact law.
MATERIALS = {"linear": "ElasticPPGap", "hertz_damped": "Hertzdamp", "nonlinear_viscoelastic": "JankowskiImpact"}


def _material(work: Work, contact: int, gap: float) -> tuple[Any, ...]:
    """Arguments of a contact's material: pressing is negative in OpenSees, and so are gaps."""
    name, law = MATERIALS[work.law], ps.get_law(work.law)
    if name == "ElasticPPGap":
        return name, work.stiffness, -1e20, -gap  # it never yields
    number = float(damping_number(law, work.restitution))
    if name == "Hertzdamp":
        return name, work.stiffness, number, -gap, 1.5
    return name, work.stiffness, number, float(work.row.reduced[contact]), -gap, 1.5


def _build(ops: Any, work: Work, gap: float, dt: float, folder: Path) -> None:
    """Describe one scenario: a spring to the floor below for each floor, a gap element for each contact."""
    row = work.row
    n, contacts = len(row.mass), len(row.left)
    start_row(ops)
    for i in range(n):
        ops.node(i + 1, 0.0)
        ops.mass(i + 1, float(row.mass[i]))
    for i in range(n):
        ops.uniaxialMaterial("Elastic", i + 1, float(row.stiffness[i]))
        below = 1000 if row.bottom[i] else i
        # without -doRayleigh 1 a zeroLength element drops stiffness-proportional damping and says nothing
        ops.element("zeroLength", i + 1, below, i + 1, "-mat", i + 1, "-dir", 1, "-doRayleigh", 1)
    for j in range(contacts):
        material, element = 100 + j, 100 + j
        name, *values = _material(work, j, gap)
        ops.uniaxialMaterial(name, material, *values)
        # the left floor that comes nearer shortens the element
        ends = int(row.left[j]) + 1, int(row.right[j]) + 1
        ops.element("zeroLength", element, *ends, "-mat", material, "-dir", 1)
    for building, (first, last) in enumerate(zip(np.flatnonzero(row.bottom), np.flatnonzero(row.top), strict=True)):
        elements = range(int(first) + 1, int(last) + 2)
        damping = float(row.alpha[first]), float(row.beta[first])
        ops.region(building + 1, "-ele", *elements, "-rayleigh", *damping, 0.0, 0.0)  # and of the nodes they join
    contact = ("-ele", *range(100, 100 + contacts), "material", 1, "stress")
    ops.recorder("EnvelopeElement", "-file", str(folder / "force"), "-precision", 16, *contact)
    ops.recorder("Element", "-file", str(folder / "stress"), *contact)
    floors = ("-node", *range(1, n + 1), "-dof", 1, "disp")
    ops.recorder("EnvelopeNode", "-file", str(folder / "floors"), "-precision", 16, *floors)
    shake(ops, work.record)


def start_row(ops: Any) -> None:
    """Begin the model of a row along one axis; node 1000 is the ground."""
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.node(1000, 0.0)
    ops.fix(1000, 1)


def shake(ops: Any, record: Record, constraints: str = "Plain", *algorithm: str) -> None:
    """Have a row shaken by a record, by Newmark's average acceleration; Newton's method where no other is named."""
    ops.timeSeries("Path", 1, "-dt", record.dt, "-values", *map(float, record.acceleration))
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints(constraints)
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormDispIncr", INCREMENT, ITERATIONS)
    ops.algorithm(*(algorithm or ["Newton"]))
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def largest_drifts(ops: Any, elements: Iterable[int], record: Record, dt: float) -> np.ndarray:
    """Run what was described, in steps of about `dt` (s); returns the largest deformations (m) of elements."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "drift"
        ops.recorder("EnvelopeElement", "-file", str(file), "-precision", 16, "-ele", *elements, "deformation")
        steps = round(record.dt / dt)
        failed = ops.analyze((record.n_points - 1) * steps, record.dt / steps)
        ops.wipe()  # closes the recorder's file
        if failed:
            raise RuntimeError(f"OpenSees did not converge at dt = {dt:g} s")
        return np.asarray(np.loadtxt(file)[-1])


def displacements(ops: Any, nodes: Sequence[int], record: Record, dt: float, every: int) -> np.ndarray:
    """Run what was described; returns displacements (m) every so many steps of `dt` (s), shape (instants, nodes)."""
    result = [[0.0] * len(nodes)]
    for _ in range(round((record.n_points - 1) * record.dt / (dt * every))):
        if ops.analyze(every, dt):
            raise RuntimeError(f"OpenSees did not converge at dt = {dt:g} s")
        result.append([ops.nodeDisp(node, 1) for node in nodes])
    return np.array(result)


def floors_of(one: xr.Dataset, scene: ps.Scene, times: np.ndarray) -> np.ndarray:
    """Displacements (m) of all floors of a simulation at some of its instants (s), shape (instants, floors)."""
    motion = one.displacement.transpose("time", "building", "storey").sel(time=times, method="nearest", tolerance=1e-9)
    return np.hstack([motion.values[:, b, : item.n_storeys] for b, item in enumerate(scene.buildings)])


def _prepare(work: Work, dt: float) -> Run:
    import openseespy.opensees as ops

    ops.logFile("/dev/null", "-noEcho")  # some materials print every impact
    steps = max(1, round(work.record.dt / dt))
    count, h = (work.record.n_points - 1) * steps, work.record.dt / steps

    def one(gap: float) -> Peaks:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            _build(ops, work, gap, h, folder)
            failed = ops.analyze(count, h)
            ops.wipe()  # closes the recorders' files
            if failed:
                raise RuntimeError(f"OpenSees did not converge at dt = {h:g} s, gap = {gap:g} m")
            force = np.loadtxt(folder / "force", ndmin=2)
            closed = np.loadtxt(folder / "stress", ndmin=2) < 0.0
            lowest, highest, _ = np.loadtxt(folder / "floors", ndmin=2)
        onsets = closed[0] + (closed[1:] & ~closed[:-1]).sum(axis=0)
        return Peaks(force[-1:], onsets[None].astype(float), highest[None], lowest[None])

    return lambda gaps: Peaks.stack([one(float(gap)) for gap in gaps])


PEERS = (
    Peer(
        key="opensees",
        title="OpenSees Newmark",
        package="openseespy",
        module="openseespy.opensees",
        knob="dt",
        settings=(2e-3, 1e-3, 5e-4, 2e-4, 1e-4),
        short=(1e-3,),
        prepare=_prepare,
        laws=tuple(MATERIALS),
    ),
)

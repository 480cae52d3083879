"""One source in all its forms: Python on arrays, compiled for registers of any width, in loops, in single precision."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from against_reference import motion
from kernels_used import FOUNDED, FRAMED, LINKED, SMOOTH, kernels, simulated
from kinds import KINDS
from llvmlite import ir
from scenes import EVERY, pair

import pounding_sweep as ps
from pounding_sweep import lanes
from pounding_sweep.engine import compile, row_kernel
from pounding_sweep.engine.compile import get_kernel
from pounding_sweep.engine.kernel import emit, width
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel import spec
from pounding_sweep.kernel.flight_tables import Tables
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import REDUCERS, Status

EL_CENTRO = ps.find_record("el_centro")
SHORT, BRIEF = (ps.Record("cut", EL_CENTRO.dt, EL_CENTRO.acceleration[a:b]) for a, b in ((90, 113), (94, 108)))
WALL = ps.Scene([ps.Wall(), ps.Building("a", [30.0], [2e4])], gaps=[0.002])
YIELDS = ps.Scene(
    [ps.Building("a", [30.0], [2e4], yield_strengths=[40.0], hardening=0.1), ps.Building("b", [20.0], [2e4])], [0.002]
)
PADS = replace(pair(), bumpers=[ps.Bumper("a-b", "rubber_bumper", 3e8, 0.5, 0.001, storeys=[1])])
#: Kernels that other tests of the default run have too, and some of their own, of every output.
SHARED = [
    ("newmark", "kelvin_voigt", False, pair()),
    ("exact", "kelvin_voigt", True, pair()),
    ("rk4", "kelvin_voigt", True, FRAMED),
    ("rk4", "kelvin_voigt", True, LINKED),
    ("rk4", "kelvin_voigt", True, FOUNDED),
    ("rk4", "linear", True, SMOOTH),
    ("newmark", "linear", True, SMOOTH),
]
OWN = [
    ("rk4", "hertz_damped", True, WALL),
    ("newmark", "hysteretic", True, WALL),
    ("newmark", "stereomechanical", True, WALL),
    ("central_difference", "nonlinear_viscoelastic", True, WALL),
    ("rk4", "kelvin_voigt", True, YIELDS),
    ("newmark", "none", True, YIELDS),
    ("rk4", "kelvin_voigt", False, WALL),
    ("rk4", "kelvin_voigt", True, PADS),
    *(
        pytest.param(*case, marks=pytest.mark.slow)
        for case in [
            ("newmark", "hertz", False, WALL),
            ("newmark", "kelvin_voigt", True, FRAMED),
            ("newmark", "stereomechanical", True, LINKED),
            ("newmark", "stereomechanical", True, FOUNDED),
            ("newmark", "hysteretic", True, PADS),
            ("rk4", "linear", False, FRAMED),
        ]
    ),
]


@pytest.mark.parametrize(("method", "law", "locate", "scene"), [*SHARED, *OWN])
def test_a_kernel_is_what_its_source_says(method, law, locate, scene, monkeypatch):
    shared = (method, law, locate, scene) in SHARED
    reducers = simulated(method, law, located=locate, scene=scene).reducers if shared else frozenset(REDUCERS)
    kernel = RowKernel(scene, LAWS[law], Numerics(method, 1e-2, locate=locate), reducers, history=True)
    assert not shared or kernel.shape in kernels()
    one = {
        "scale": np.ones(1),
        "gaps": np.full((1, 1), 0.002),
        "stiffness": np.full(1, 2e5 if LAWS[law].exponent == 1.0 else 2e6),
        "restitution": np.full(1, 0.6),
    }
    record, found = SHORT if scene in (WALL, FRAMED, YIELDS) else BRIEF, []
    for disabled in (False, True):
        monkeypatch.setenv(compile.TWIN_VARIABLE, str(int(disabled)))
        get_kernel.cache_clear()
        steps = (record.n_points - 1) * kernel.numerics.steps(record) + 1
        history = np.zeros((steps, 100))
        found.append({**kernel.run(record, **one, history=history), "history": history})
    get_kernel.cache_clear()
    compiled, twin = found
    assert law == "none" or compiled["count"].sum() > (scene is not SMOOTH)
    assert scene not in (YIELDS, SMOOTH) or compiled["travel"].sum() > 0
    for name, want in compiled.items():
        np.testing.assert_allclose(twin[name], want, rtol=0, atol=1e-9 * np.abs(want).max() + 1e-12, err_msg=name)


def results(law, method, precision="float64", storeys=(2, 3, 2), walls=False, varied=False):
    buildings = [
        ps.Building(f"b{i}", [20.0 + 5.0 * i] * n, stiffnesses=[30e3 + 4e3 * i] * n, damping_ratio=0.04)
        for i, n in enumerate(storeys)
    ]
    row = ps.Scene(
        [ps.Wall("left"), *buildings, ps.Wall("right")] if walls else buildings,
        gaps=[0.005] * (len(buildings) - 1 + 2 * walls),
    )
    t = np.arange(200) * 0.02
    record = ps.Record("sweep", dt=0.02, acceleration=6.0 * np.sin(2.0 * np.pi * (0.5 + t) * t))
    reducers = frozenset(
        {"displacement", "drift", "acceleration", "closing", "energy", "force", "count", "work", "impulse", "transfer"}
    )
    found = RowKernel(row, ps.get_law(law), Numerics(method, 5e-3, precision=precision), reducers, varied=varied)
    factors = np.linspace(0.8, 1.2, 16)[:, None] * np.ones(len(buildings))
    variants = Variants(row, factors, factors, np.full(16, 0.02)) if varied else None
    scale = np.linspace(0.5, 2.0, 16)
    gaps = np.full((16, len(row.pair_names)), 0.005) * scale[::-1, None]
    return found.run(
        record, scale=scale, gaps=gaps, stiffness=1e5 * scale, restitution=np.full(16, 0.6), variants=variants
    )


def another_machine(monkeypatch, name):
    """Keep kernels that are compiled from now on apart."""
    surroundings = compile._surroundings() + name
    monkeypatch.setattr(compile, "_surroundings", lambda: surroundings)
    forget_kernels()


def forget_kernels():
    """Let this process compile and fill anew."""
    get_kernel.cache_clear()
    compile._COMPILED.clear()
    row_kernel._layout.cache_clear()
    row_kernel._MEMORY.__dict__.clear()


MACHINES = {
    "AVX2": ("haswell", "+avx2,+fma,+avx,+bmi,+bmi2,+popcnt,+lzcnt,+sse4.2"),
    "no vector instructions beyond SSE2": ("x86-64", "+sse2"),
}
#: Prints all results of two kernels, bit by bit.
RUN = """
from test_kernel_forms import results
for case in (("hertz_damped", "rk4", "float64"), ("linear", "newmark", "float64"), ("linear", "exact", "float32")):
    for name, values in sorted(results(*case).items()):
        print(name, values.tobytes().hex())
"""


def _printed(machine, folder):
    environment = dict(
        os.environ, POUNDING_SWEEP_CACHE=str(folder), PYTHONPATH=os.pathsep.join([os.path.dirname(__file__), *sys.path])
    )
    environment.update(zip(("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"), machine, strict=False))
    done = subprocess.run(
        [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_bits_are_those_of_any_machine(tmp_path):
    here = _printed((), tmp_path)
    assert "fmax" in here
    for name, machine in MACHINES.items():
        assert _printed(machine, tmp_path) == here, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "method", "precision"),
    [
        ("hertz_damped", "rk4", "float64"),
        ("linear", "newmark", "float32"),
        ("linear", "exact", "float64"),
        ("linear", "exact", "float32"),
        ("hertz_damped", "exact", "float32"),
        ("stereomechanical", "exact", "float64"),
    ],
)
def test_bits_are_those_of_registers_of_another_width(law, method, precision, monkeypatch):
    here, before = results(law, method, precision), width(precision)
    wide = not lanes.has_wide_registers()
    monkeypatch.setattr(lanes, "has_wide_registers", lambda: wide)
    another_machine(monkeypatch, "registers of another width")
    assert width(precision) != before
    there = results(law, method, precision)
    forget_kernels()
    assert here["count"].sum() > 100
    for name, values in here.items():
        np.testing.assert_array_equal(there[name], values, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "varied"), [("linear", False), ("stereomechanical", False), ("kelvin_voigt", True)])
@pytest.mark.parametrize("method", ["rk4", "newmark", "exact"])
def test_a_row_gone_through_at_run_time_moves_as_one_straight_line_does(law, varied, method, monkeypatch):
    scene = {"storeys": (2, 3, 2, 1), "walls": True, "varied": varied}
    straight = results(law, method, **scene)
    monkeypatch.setattr(spec, "FUSED_DOF", 0)
    another_machine(monkeypatch, "rows in loops")
    looped = results(law, method, **scene)
    forget_kernels()
    assert straight["count"].sum() > 100
    for name, values in straight.items():
        size = max(np.nanmax(np.abs(values)), 1e-9)
        np.testing.assert_allclose(looped[name], values, rtol=0, atol=1e-7 * size, err_msg=name)


def llvm(kernel):
    """All that is compiled of a kernel as LLVM's text, before any optimisation."""
    texts = []
    for piece in kernel.shape.pieces:
        module = ir.Module()
        function = ir.Function(module, ir.FunctionType(ir.VoidType(), [ir.IntType(64)]), "run")
        emit(piece, ir.IRBuilder(function.append_basic_block()), *function.args)
        texts.append(str(module))
    return "".join(texts)


@pytest.mark.parametrize("method", SCHEMES)
def test_lanes_compute_nothing_in_double(method, monkeypatch):
    """A single double in the arithmetic would halve the lanes of every vector it meets; tables are made once a call."""
    monkeypatch.setattr(Tables, "fill", lambda self, rows: None)
    scene = ps.Scene([ps.Building("a", [100.0], [1e5]), ps.Building("b", [50.0], [2e5])], gaps=[0.005])
    numerics = Numerics(method, 1e-3, precision="float32")
    lines = llvm(RowKernel(scene, LAWS["hertz_damped"], numerics, frozenset(REDUCERS))).splitlines()
    lanes = r"<\d+ x double>"
    doubles = [x for x in lines if re.search(rf"= (fadd|fsub|fmul|fdiv) {lanes}|call {lanes}", x)]
    # the only ones: times of events, which are counted in double
    assert {x.split(" = ")[1].split()[0] for x in doubles} <= {"fadd", "fmul"}
    assert len(doubles) <= 4
    assert sum(f"<{width('float32')} x float>" in x for x in lines) > 1000


@pytest.mark.parametrize(
    ("name", "method"), [("a long row that yields", "rk4"), ("linked towers", "exact"), ("long and bumped", "newmark")]
)
def test_rows_gone_through_at_run_time_are_traced(name, method):
    """They are run by night."""
    kernel = RowKernel(KINDS[name].scene, LAWS["kelvin_voigt"], Numerics(method, 1e-3), frozenset(REDUCERS))
    assert not kernel.shape.fused
    assert "fmul" in llvm(kernel)


def test_a_sweep_in_single_precision():
    sweep = ps.Sweep(
        pair(),
        motion(126, 1.5),
        "hertz_damped",
        gaps=[0.004, 0.006],
        method="exact",
        precision="float32",
        audit=0.0,
        outputs=EVERY,
        damping_ratios=[0.02, 0.05],
    )
    cube = sweep.run()
    for ratio in (0.02, 0.05):
        buildings = [replace(b, damping_ratio=ratio) for b in pair().buildings]
        scene = ps.Scene(buildings, pair().gaps, pair().contact)
        for gap in (0.004, 0.006):
            record = motion(126, 1.5)
            settings = {"method": "rk4", "audit": 0.0, "outputs": EVERY}
            double = ps.Sweep(scene, record, "hertz_damped", gaps=[gap, 1.0, 1.1, 1.2], **settings).run()
            here = cube.sel(gap=gap, damping_ratio=ratio).squeeze(drop=True)
            for name in ("displacement_max", "storey_shear_max", "impact_force_max", "impulse", "energy_input"):
                want = double[name].sel(gap=gap).squeeze(drop=True).values
                np.testing.assert_allclose(here[name], want, rtol=0, atol=1e-3 * np.nanmax(np.abs(want)), err_msg=name)
            assert np.array_equal(here.impact_count, double.impact_count.sel(gap=gap).squeeze(drop=True))
    assert (cube.status == Status.OK).all()
    assert float(cube.impact_force_max.max()) > 0
    assert cube.attrs["precision"] == "float32"

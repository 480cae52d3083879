"""Single precision: the same kernel with every number narrowed, and nothing of it in double."""

from __future__ import annotations

import ast
import re
import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from scenes import EVERY, pair
from test_kernels import motion, row_kernel, run_lanes, stiffness_of

import pounding_sweep as ps
from pounding_sweep.engine.kernel import ROW_NAME, kernel_text
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.precision import TOLERANCES, narrow
from pounding_sweep.kernel.spec import LANES, input_slots
from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import Status, output_slots


def literals(text):
    inside = [n for f in ast.parse(text).body if isinstance(f, ast.FunctionDef) for n in ast.walk(f)]
    return [n.value for n in inside if isinstance(n, ast.Constant) and type(n.value) is float]


def test_no_double_literal_is_left():
    kernel = row_kernel("pair", "hertz_damped", "rk4", 1e-3)
    double = kernel_text(kernel.shape)
    single = kernel_text(replace(kernel.shape, precision="float32"))
    assert literals(double.main)
    assert literals(double.row)
    assert not literals(single.main)
    assert not literals(single.row)


def test_numbers_beyond_single_precision_stay_finite_and_not_zero():
    space = {"np": np}
    exec(narrow("import math\n\nA = 1e300\nB = -1e-300\nC = 0.0\nD = 0.5\nN = 3\n"), space)
    assert np.isfinite(space["A"])
    assert space["A"] > 1e37
    assert -1e-36 < space["B"] < 0
    assert (space["C"], space["D"], space["N"]) == (0.0, 0.5, 3)
    assert type(space["D"]) is np.float32
    assert type(space["N"]) is int


def test_both_precisions_name_the_same_tolerances():
    assert TOLERANCES["float32"].keys() == TOLERANCES["float64"].keys()


@pytest.mark.slow
@pytest.mark.parametrize(  # whose contacts and flights are all there is
    "method", ["newmark", "exact"]
)
def test_compiled_code_computes_nothing_in_double(method, monkeypatch):
    """A single double in the arithmetic would halve the lanes of every vector it meets."""
    scene = ps.Scene([ps.Building("a", [100.0], [1e5]), ps.Building("b", [50.0], [2e5])], gaps=[0.005])
    numerics = Numerics(method, 1e-3, precision="float32")
    kernel = RowKernel(scene, LAWS["hertz_damped"], numerics, frozenset({"displacement", "force", "energy", "work"}))
    text = kernel_text(kernel.shape)
    row, main = types.ModuleType(ROW_NAME), types.ModuleType("float32_main")
    monkeypatch.setitem(sys.modules, ROW_NAME, row)
    exec(compile(text.row, ROW_NAME, "exec"), row.__dict__)
    entry = text.main.replace("@njit(**OPTIONS)\ndef run(", "@njit(**ENTRY)\ndef run(")
    exec(compile(entry, "float32_main", "exec"), main.__dict__)
    lanes, results = (np.zeros((1, slots(kernel.shape).size * LANES)) for slots in (input_slots, output_slots))
    main.run(np.sin(np.arange(9.0)), 0.01, 2, 2, kernel.constants, lanes, results, np.zeros((1, 1)))
    seen = set()
    for name, function in main.__dict__.items():
        for signature in getattr(function, "overloads", ()):
            if name not in ("run", "begin", "finish"):  # these read and write the callers' arrays, which are double
                lines = function.inspect_llvm(signature).splitlines()
                doubles = [x for x in lines if re.search(r"= (fadd|fsub|fmul|fdiv).* double|fma\.\w*f64\(", x)]
                # the only one: the time of an event, which is counted in double
                assert len(doubles) <= (name == "apply_events"), (name, doubles)
                seen.add(name)
    assert {"flight", "trial", "turns", "contact_pass"} <= seen


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "law"),
    [
        *(("rk4", law) for law in ("nonlinear_viscoelastic", "stereomechanical")),
        ("newmark", "hertz_damped"),
    ],
)
def test_single_precision_is_close_to_double(law, method):
    record = motion(126, 1.5)
    arguments = ([1.0, 0.7], [[0.006], [0.004]], [stiffness_of(law, "pair") or 0.0] * 2, [0.6, 0.6])
    double = row_kernel("pair", law, method, 1e-3)
    single = replace(double, numerics=replace(double.numerics, precision="float32"))
    fine, coarse = (run_lanes(kernel, record, *arguments) for kernel in (double, single))
    assert fine["count"].sum() > 0
    assert np.array_equal(fine["count"], coarse["count"])
    assert np.array_equal(coarse["flags"], np.zeros((2, 1)))
    # displacements of 0.1 m are known to 1e-8 m, within which a force like d**(1/4) rises to percents of its peak
    bound = 3e-2 if law == "nonlinear_viscoelastic" else 2e-4
    for name in ("umax", "umin", "drift", "fmax", "impulse", "vmax", "acc"):
        error = np.abs(fine[name] - coarse[name]).max() / max(np.abs(fine[name]).max(), 1e-300)
        assert error < bound, name
        assert error > 1e-9 or law == "stereomechanical", name  # it was not run in double


def test_a_sweep_in_single_precision():
    sweep = ps.Sweep(
        pair(),
        motion(126, 1.5),
        "hertz_damped",
        gaps=[0.004, 0.006],
        method="exact",
        precision="float32",
        outputs=EVERY,
        damping_ratios=[0.02, 0.05],
    )
    cube = sweep.run()
    for ratio in (0.02, 0.05):
        buildings = [replace(b, damping_ratio=ratio) for b in pair().buildings]
        scene = ps.Scene(buildings, pair().gaps, pair().contact)
        for gap in (0.004, 0.006):
            record = motion(126, 1.5)
            double = ps.Sweep(scene, record, "hertz_damped", gaps=[gap, 1.0, 1.1, 1.2], dt=1e-3, outputs=EVERY).run()
            here = cube.sel(gap=gap, damping_ratio=ratio).squeeze(drop=True)
            for name in ("displacement_max", "storey_shear_max", "impact_force_max", "impulse", "energy_input"):
                want = double[name].sel(gap=gap).squeeze(drop=True).values
                np.testing.assert_allclose(here[name], want, rtol=0, atol=1e-3 * np.nanmax(np.abs(want)), err_msg=name)
            assert np.array_equal(here.impact_count, double.impact_count.sel(gap=gap).squeeze(drop=True))
    assert (cube.status == Status.OK).all()
    assert float(cube.impact_force_max.max()) > 0
    assert cube.attrs["precision"] == "float32"

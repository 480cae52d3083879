"""Single precision: the same kernel with every number narrowed, and nothing of it in double."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from against_reference import motion
from kinds import KINDS
from llvmlite import ir
from scenes import EVERY, pair

import pounding_sweep as ps
from pounding_sweep.engine.kernel import emit, width
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.flight_tables import Tables
from pounding_sweep.model.laws import LAWS
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import REDUCERS, Status


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

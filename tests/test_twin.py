"""The kernels' own source, run as plain Python on NumPy arrays, against what numba makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernels_used import FOUNDED, FRAMED, LINKED, kernels, simulated
from numba import config
from scenes import pair

import pounding_sweep as ps
from pounding_sweep.engine.cache import get_kernel
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import REDUCERS

EL_CENTRO = ps.find_record("el_centro")
SHORT = ps.Record("short", EL_CENTRO.dt, EL_CENTRO.acceleration[90:113])
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
    found = []
    for disabled in (False, True):
        monkeypatch.setattr(config, "DISABLE_JIT", disabled)
        get_kernel.cache_clear()
        steps = (len(SHORT.acceleration) - 1) * kernel.numerics.steps(SHORT) + 1
        history = np.zeros((steps, 100))
        found.append({**kernel.run(SHORT, **one, history=history), "history": history})
    get_kernel.cache_clear()
    compiled, twin = found
    assert compiled["count"].sum() > 1 if law != "none" else compiled["travel"].sum() > 0
    assert scene is not YIELDS or compiled["travel"].sum() > 0
    for name, want in compiled.items():
        size = np.abs(want).max()
        np.testing.assert_allclose(twin[name], want, rtol=0, atol=1e-9 * size + 1e-12, err_msg=name)

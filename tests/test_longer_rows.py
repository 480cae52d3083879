"""Rows compiled floor by floor in loops, as longer ones are, against the same rows in one straight line."""

from __future__ import annotations

import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep.engine import cache
from pounding_sweep.engine.cache import get_kernel
from pounding_sweep.kernel import spec as shape
from pounding_sweep.outputs.variables import VARIABLES, Status

OUTPUTS = [name for name in VARIABLES if name not in ("status", "energy_residual", "steps_per_contact")]
#: A wall; three buildings alike, two pairs that meet alike; a lower building, whose pair is another kind.
ROW = ps.Scene(
    [
        ps.Wall(),
        ps.Building("a", [120.0, 90.0], [1.5e5, 1.2e5]),
        ps.Building("b", [80.0, 110.0], [2.4e5, 2.0e5]),
        ps.Building("c", [100.0, 100.0], [1.1e5, 1.3e5]),
        ps.Building("low", [140.0], [9.0e4]),
    ],
    gaps=[0.003, 0.004, 0.005, 0.004],
    contact=ps.ContactProperties(linear_stiffness=8e5, restitution=0.6),
)
EL_CENTRO = ps.find_record("el_centro")
#: Slow to compile; `test_kernels` holds a row in loops against the twin.
pytestmark = pytest.mark.release
SHORT = ps.Record("short", EL_CENTRO.dt, EL_CENTRO.acceleration[60:160])
VARIED = {"period_factors": {"b": [0.8, 1.2]}, "damping_ratios": [0.02, 0.08]}


def both(monkeypatch, **settings):
    found, own = [], cache._surroundings()
    for most in (shape.FUSED_DOF, 0):
        monkeypatch.setattr(shape, "FUSED_DOF", most)
        monkeypatch.setattr(cache, "_surroundings", lambda most=most: f"{own} rows to {most} floors")
        get_kernel.cache_clear()
        found.append(
            ps.Sweep(ROW, SHORT, "kelvin_voigt", outputs=OUTPUTS, audit=0.0, **{"dt": 1e-3, **settings}).run(
                scheduler="synchronous"
            )
        )
    get_kernel.cache_clear()
    return found


def test_unlocated_forces_are_those_of_the_motion():
    """Behind a wall, the first floor belongs to two contacts."""
    one = ps.simulate(ROW, SHORT, law="kelvin_voigt", method="rk4", dt=1e-3, locate=False)
    u, v = (one[name].isel(storey=0) for name in ("displacement", "velocity"))
    log_e = np.log(0.6)
    share = -log_e / np.hypot(np.pi, log_e)
    for pair, (left, right) in enumerate((("a", "b"), ("b", "c")), start=1):
        masses = [building.masses[0] for building in ROW.buildings if building.name in (left, right)]
        damper = 2.0 * share * np.sqrt(8e5 / sum(1.0 / m for m in masses))
        d = u.sel(building=left) - u.sel(building=right) - ROW.gaps[pair]
        rate = v.sel(building=left) - v.sel(building=right)
        force = np.maximum(8e5 * d + damper * rate, 0.0).where(d > 0.0, 0.0)
        assert float(force.max()) > 0.0
        found = one.contact_force.isel(storey=0).sel(pair=f"{left}-{right}")
        np.testing.assert_allclose(found, force, rtol=0, atol=1e-9 * float(force.max()))


@pytest.mark.parametrize(
    "settings",
    [
        {"method": "rk4"},
        {"method": "exact"},
        {"method": "newmark", "dt": 2e-4, **VARIED},
    ],
    ids=lambda settings: (
        " ".join(f"{name}={value}" for name, value in settings.items() if name not in VARIED)
        + (" varied" if "damping_ratios" in settings else "")
    ),
)
def test_loops_over_floors_give_the_numbers_of_a_straight_line(settings, monkeypatch):
    line, loops = both(monkeypatch, **settings)
    assert (line.status == Status.OK).all()
    assert (line.impact_count.sum(["pair", "storey"]) > 3).all()
    assert (line.impact_force_max.max("storey") > 0).all()  # every pair meets
    for name in line.data_vars:
        want, got = line[name].values, loops[name].values
        size = np.abs(want[np.isfinite(want)]).max(initial=0.0) if want.dtype.kind == "f" else 1.0
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-9 * size, err_msg=str(name))

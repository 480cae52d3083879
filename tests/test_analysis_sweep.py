"""Comparisons of a real sweep, against other runs of the same engine."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import AXES, motions, row

from pounding_sweep import Record, Sweep
from pounding_sweep.analysis import (
    amplification,
    compare_laws,
    impact_statistics,
    incremental_curves,
    response_spectrum,
)

NOMINAL = np.linspace(0.1, 1.0, 19).round(3).tolist()


@pytest.fixture(scope="module")
def cube():
    """Make the cube of three laws at many restitutions, by the published damping formulas."""
    settings = AXES | {"restitutions": NOMINAL, "gaps": [0.002, 0.5], "stiffness_factors": 1.0}
    return Sweep(row(), motions(), **settings).run(workers=1)


def test_equal_realised_restitution_is_what_a_sweep_on_that_basis_gives(cube):
    """Interpolated values are those of runs whose damping realises the restitution exactly."""
    wanted = [0.5, 0.7, 0.9]
    settings = AXES | {"laws": ["kelvin_voigt"], "restitutions": wanted, "gaps": [0.002], "stiffness_factors": 1.0}
    exact = Sweep(row(), motions(), **settings, restitution_basis="realised").run(workers=1)
    here = {"law": ["kelvin_voigt"], "gap": [0.002], "restitution": wanted}
    found = compare_laws(cube, "kelvin_voigt").sel(basis="realised", **here)
    for name in ("impact_force_max", "displacement_max", "displacement_min"):
        error = abs(found[f"{name}_compared"] / exact[name] - 1.0).max()
        nominal = abs(cube[name].sel(here) / exact[name] - 1.0).max()
        assert float(error) < 0.004
        assert float(nominal) > 0.015  # at equal nominal restitution they are others


def test_a_gap_that_is_never_closed_amplifies_nothing(cube):
    ratios = amplification(cube)
    open_gap = ratios.sel(gap=0.5)
    assert (open_gap.touches == 0.0).all()
    np.testing.assert_array_equal(open_gap.displacement_peak_ratio, 1.0)
    assert (ratios.displacement_peak_ratio.sel(gap=0.002) != 1.0).any()
    share = impact_statistics(cube, ["record", "restitution"]).pair_touching_share
    np.testing.assert_array_equal(share.sel(gap=0.5), 0.0)
    assert (share.sel(gap=0.002) > 0.0).all()


def test_response_without_pounding_is_proportional_to_its_spectral_acceleration():
    """Of a one-storey building, displacement over Sa is the same for every record: (T / 2 pi)^2."""
    scene = row()
    records = [Record(r.name, r.dt, np.append(r.acceleration, np.zeros(200))) for r in motions()]  # to rest
    settings = {key: AXES[key] for key in ("dt", "outputs")}
    still = Sweep(scene, records, "none", scales=[0.5, 1.0, 2.0], **settings).run(workers=1)
    period = float(scene.buildings[0].periods[0])
    sa = response_spectrum(records, [period], 0.05).pseudo_acceleration.squeeze("period")
    curves = incremental_curves(still, ["displacement_max", "displacement_min"], intensity=sa)
    peak = np.maximum(curves.displacement_max, -curves.displacement_min).sel(building="a", storey=1)
    slope = (peak / curves.intensity).values
    np.testing.assert_allclose(slope, (period / (2.0 * np.pi)) ** 2, rtol=2e-3)

"""Scaling to a spectral acceleration at a period: stripes of suites, and what cubes know of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from scenes import OUTPUTS, motions, pair

import pounding_sweep as ps
from pounding_sweep.analysis import required_gap, response_spectrum, scaled_to_sa
from pounding_sweep.analysis.comparisons import MOTION_DIMS
from pounding_sweep.analysis.rebuild import intensity_of
from pounding_sweep.base.errors import InputError, PoundingSweepError, RecordError
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.spec.axes import DIMENSIONS, Case


def sweep(**more):
    given = {"sas": [2.0, 5.0], "sa_period": 0.6, "gaps": [0.002], "dt": 0.005, "outputs": OUTPUTS}
    return ps.Sweep(pair(), motions(), "linear", **given | more)


@pytest.mark.parametrize("period", [0.05, 0.6, 3.0])
def test_every_record_has_the_spectral_acceleration_asked_for(period):
    spec = sweep(sa_period=period).spec
    axis, values = spec.needed_axis("scale")
    for record in spec.records:
        for value in values:
            scaled = record.scaled(spec.scale(axis, value, record))
            found = response_spectrum(scaled, [period])["pseudo_acceleration"].item()
            assert found == pytest.approx(value, rel=1e-12)


@pytest.mark.usefixtures("stub_engine")
def test_a_cube_has_the_axis_and_the_factors(tmp_path):
    job = sweep()
    job.run(tmp_path / "a.nc", scheduler="synchronous").close()
    with ps.open_cube(tmp_path / "a.nc") as cube:
        assert cube["sa"].values.tolist() == [2.0, 5.0]
        assert cube["sa"].attrs["units"] == "m s-2"
        assert float(cube.attrs["sa_period"]) == 0.6
        assert cube["scale"].dims == ("record", "sa")
        want = [[v / response_spectrum(r, [0.6])["pseudo_acceleration"].item() for v in (2.0, 5.0)] for r in motions()]
        np.testing.assert_allclose(cube["scale"].values, want, rtol=1e-12)
    grown = sweep(sas=[2.0, 5.0, 8.0]).run(tmp_path / "b.nc", scheduler="synchronous", extend=tmp_path / "a.nc")
    assert json.loads(grown.attrs["extended_from"])["scenarios_taken"] >= 4
    grown.close()
    sweep(sa_period=0.7).run(tmp_path / "c.nc", scheduler="synchronous").close()
    with pytest.raises(InputError, match="study: sa_period is 0"):
        merge_cubes([tmp_path / "a.nc", tmp_path / "c.nc"], tmp_path / "d.nc")


@pytest.mark.usefixtures("stub_engine")
def test_it_is_the_intensity_of_comparisons():
    assert ("record", *DIMENSIONS["scale"]) == MOTION_DIMS
    cube = sweep().run(workers=1)
    own, pga = intensity_of(cube), intensity_of(cube, "pga")
    measured = intensity_of(cube, "sa(0.60)", records=motions())  # another spelling: from the motions
    xr.testing.assert_allclose(own, measured.transpose(*own.dims), rtol=1e-12)
    assert own.attrs == measured.attrs | {"long_name": own.attrs["long_name"]}
    assert float(pga.std("record").min()) > 0.0 == float(own.std("record").max())
    need = required_gap(cube, motions())
    assert need.sizes["sa"] == 2
    ratio = need["exact"].isel(sa=1) / need["exact"].isel(sa=0)
    assert float(ratio.min()) > 0.0


def test_listed_cases_take_it_too():
    spec = ps.Sweep(pair(), motions()[0], cases=[Case("linear", sa=4.0), Case("linear", scale=2.0)], sa_period=1.0).spec
    found = response_spectrum(motions()[0], [1.0])["pseudo_acceleration"].item()
    assert [spec.case_value(case, "scale") for case in spec.cases] == pytest.approx([4.0 / found, 2.0])


def test_one_record_is_scaled(tmp_path):
    """In Python, by name and from a file, to 5 m/s2 at 0.4 s."""
    file = tmp_path / "motion.csv"
    record = ps.find_record("el_centro")
    points = zip(record.time, record.acceleration, strict=True)
    file.write_text("time (s),acc (m/s2)\n" + "".join(f"{t:.6g},{float(a)!r}\n" for t, a in points), encoding="utf-8")
    given = [{"record": "el_centro", "sa": 5.0, "sa_period": 0.4}, {"path": str(file), "sa": 5.0, "sa_period": 0.4}]
    given.append(scaled_to_sa(ps.find_record("el_centro"), 5.0, period=0.4).renamed("third"))
    records = ps.Sweep("mate2015", given, "linear", dt=0.01, force_unstable=True).spec.records
    assert [each.name for each in records] == ["el_centro", "motion", "third"]
    for each in records:
        assert response_spectrum(each, [0.4])["pseudo_acceleration"].item() == pytest.approx(5.0, rel=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"sa": 5.0}, "sa_period: is missing; give The period"),
        ({"sa_period": 0.4}, "sa: is missing; give A spectral acceleration"),
        ({"sa": 5.0, "sa_period": 0.4, "pga": 2.0}, "sa and pga exclude each other"),
        ({"sa": 5.0, "sa_period": 0.4, "scale": 2.0}, "sa and scale exclude each other"),
        ({"sa": -5.0, "sa_period": 0.4}, "spectral acceleration to scale to"),
        ({"sa": 5.0, "sa_period": 1e-9}, r"can't be scaled .* at 1e-09 s; give a period of 0\.000"),
        ({"sa": 5.0, "sa_period": "x"}, "must be a valid number"),
    ],
)
def test_a_record_that_can_not_be_scaled_so(given, said):
    with pytest.raises(PoundingSweepError, match=said):
        ps.Sweep("mate2015", [{"record": "el_centro", **given}], "linear")


def test_no_motion_has_no_scale():
    still = ps.Record("still", 0.01, np.zeros(5))
    with pytest.raises(RecordError, match="zero throughout"):
        scaled_to_sa(still, 1.0, 0.5)

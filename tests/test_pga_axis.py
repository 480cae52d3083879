"""The axis of peak ground accelerations: every record is scaled to each."""

import json

import numpy as np
from scenes import motions, row

from pounding_sweep import Sweep
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.run.simulate import scenario_of
from pounding_sweep.spec.axes import Case
from pounding_sweep.spec.build import build_spec
from pounding_sweep.spec.spec import to_json
from pounding_sweep.spec.toml import load_spec

PGAS = [1.5, 4.0]


def build(**changes):
    return build_spec(**{"scene": row(), "records": motions(), "laws": ["linear", "none"], **changes})


def test_every_record_has_every_peak():
    spec = build(pgas=PGAS)
    assert spec.axes["pga"] == (1.5, 4.0)
    assert "scale" not in spec.axes
    plan = make_plan(spec)
    table = plan.unique[plan.inverse]
    peaks = table.scale * np.array([record.pga for record in spec.records])[table.record]
    shape = [len(values) for values in spec.axes.values()]
    np.testing.assert_allclose(peaks.reshape(shape), np.broadcast_to(PGAS, shape), rtol=1e-15)
    assert scenario_of(spec)["pga"] == 1.5


def test_a_sweep_without_it_is_silent_of_it():
    assert "pga" not in json.loads(to_json(build(scales=[2.0])))
    assert json.loads(to_json(build(pgas=PGAS)))["pgas"] == PGAS


def test_files_and_cases_have_it_too(tmp_path):
    head = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\n'
    (tmp_path / "axis.toml").write_text(f'{head}laws = "linear"\npgas = {{ start = 1.0, stop = 3.0, count = 3 }}\n')
    assert load_spec(tmp_path / "axis.toml").pgas == (1.0, 2.0, 3.0)
    (tmp_path / "cases.toml").write_text(f'{head}[[sweep.cases]]\nlaw = "none"\npga = 2.0\n')
    spec = load_spec(tmp_path / "cases.toml")
    assert spec.cases == (Case("none", record="el_centro", pga=2.0),)
    assert make_plan(spec).unique.scale.tolist() == [2.0 / spec.records[0].pga]


def test_a_cube_says_the_factor_on_each_record():
    cube = Sweep(row(), motions(), "none", pgas=PGAS, outputs=["displacement_max"], audit=0.0).run()
    assert cube["pga"].attrs["units"] == "m s-2"
    assert cube["scale"].dims == ("record", "pga")
    np.testing.assert_allclose(cube["scale"] * cube["record_pga"], np.broadcast_to(PGAS, (cube.sizes["record"], 2)))

"""Fragility for OpenQuake and demands for Pelicun: read back by their own packages where these are, else by hand.

They are looked for in this Python, or in that of ``POUNDING_SWEEP_TOOLS_PYTHON``: their requirements exclude some of
ours.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from scenes import call, hand_cube, low_and_high, sweep_attribute
from scipy import stats

from pounding_sweep.analysis import export_nrml, export_pelicun, fragility
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.output.netcdf import write_cube

TOOLS = os.environ.get("POUNDING_SWEEP_TOOLS_PYTHON", sys.executable)
G = 9.81
SCALES = np.linspace(0.2, 4.0, 12).tolist()
NAME = "{http://openquake.org/xmlns/nrml/0.5}"
STATES = {"slight": ("drift", 0.004), "severe": ("drift", 0.008)}


def ask(code, package):
    """Run code in the Python that has the tools; skip where it has not that one."""
    done = subprocess.run([TOOLS, "-c", code], capture_output=True, text=True, check=False)
    if done.returncode and (f"No module named '{package}" in done.stderr or "ImportError" in done.stderr):
        pytest.skip(f"{package} is not installed in {TOOLS}")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def cube():
    """Records of random strength at rising scales: floors touch, drift and accelerate the more the stronger."""
    shape = (2, 8, len(SCALES))
    strength = np.array(SCALES) * np.random.default_rng(0).lognormal(0.0, 0.8, (1, 8, 1)) * np.ones(shape)
    base = strength[..., None, None]
    by_law = base * np.array([1.0, 2.0]).reshape(2, 1, 1, 1, 1)
    fill = {"impact_force_max": np.where(by_law > 2.0, 100.0 * base, 0.0)}
    fill |= {"drift_max": 0.004 * by_law, "acceleration_max": 3.0 * by_law}
    status = np.zeros(shape)
    status[1, 2, 3] = 1
    axes = {"law": ["linear", "hertz"], "record": [f"r{i}" for i in range(8)], "scale": SCALES}
    return hand_cube(axes, fill, status=status)


def functions(path):
    root = ElementTree.parse(path).getroot()
    assert root.tag == f"{NAME}nrml"
    return root.find(f"{NAME}fragilityModel"), {each.get("id"): each for each in root.iter(f"{NAME}fragilityFunction")}


def numbers(element, *names):
    return [float(element.get(name)) for name in names]


def test_nrml_by_hand(cube, tmp_path):
    assert export_nrml(cube, tmp_path / "f.xml", STATES) == {}
    model, written = functions(tmp_path / "f.xml")
    assert model.find(f"{NAME}limitStates").text == "slight severe"
    assert set(written) == {f"{b}_{law}" for b in "ab" for law in ("linear", "hertz")}
    fitted = fragility(cube, "drift", 0.008, confidence=None).sel(building="a", law="hertz")
    params = written["a_hertz"].findall(f"{NAME}params")
    assert [each.get("ls") for each in params] == ["slight", "severe"]
    exact = stats.lognorm(float(fitted["dispersion"]), scale=float(fitted["median"]) / G)
    assert numbers(params[1], "mean", "stddev") == pytest.approx([exact.mean(), exact.std()], rel=1e-6)
    imls = written["a_hertz"].find(f"{NAME}imls")
    pga = np.outer(cube["record_pga"], SCALES) / G
    assert imls.get("imt") == "PGA"
    assert numbers(imls, "minIML", "maxIML") == pytest.approx([pga.min(), pga.max()])


def test_nrml_of_a_part_of_the_row(cube, tmp_path):
    """A building or storey that was selected; functions that the law does not change are written once."""
    alike = cube.assign(drift_max=cube["drift_max"].where(cube["law"] == "linear", 0.0).sum("law").clip(min=1e-9))
    alike["drift_max"] = alike["drift_max"].expand_dims(law=cube["law"]).assign_attrs(cube["drift_max"].attrs)
    alike["status"] = 0 * cube["status"]
    export_nrml(alike.sel(building="a"), tmp_path / "a.xml", STATES)
    export_nrml(cube.sel(building="a", law="linear"), tmp_path / "b.xml", STATES)
    once, one = (functions(tmp_path / f"{name}.xml")[1] for name in "ab")
    assert [*once] == [*one] == ["a"]
    assert ElementTree.tostring(once["a"]) == ElementTree.tostring(one["a"])
    export_nrml(cube.sel(pair="a-b"), tmp_path / "p.xml", {"touch": ("touch", None)})
    assert [*functions(tmp_path / "p.xml")[1]] == ["a-b_linear", "a-b_hertz"]


def test_nrml_by_openquake(cube, tmp_path):
    """Its own probabilities at intensities between, against ours."""
    export_nrml(cube, tmp_path / "f.xml", STATES)
    ours = fragility(cube, "drift", 0.008, confidence=None, levels=[0.5, 1.5, 4.0]).sel(building="b", law="linear")
    code = f"""
import json, numpy
from openquake.hazardlib import nrml
from openquake.risklib import read_nrml
model = nrml.to_python({str(tmp_path / "f.xml")!r})
own = model["PGA", "b_linear"]
own = own.build(model.limitStates, 1, 1) if hasattr(own, "build") else own
gmvs = numpy.array([0.5, 1.5, 4.0]) / {G}
print(json.dumps([model.limitStates, own[1](gmvs).tolist()]))
"""
    states, theirs = ask(code, "openquake")
    assert states == ["slight", "severe"]
    assert theirs == pytest.approx(ours["probability"].values.tolist(), abs=1e-6)


def test_functions_without_fit_are_named(cube, tmp_path):
    states = {"slight": ("drift", 0.004), "never": ("drift", 10.0)}
    with pytest.raises(InputError, match=r"no fragility has a fit .*a_linear: never never happened"):
        export_nrml(cube, tmp_path / "f.xml", states)
    assert not (tmp_path / "f.xml").exists()
    some = {"slight": ("drift", 0.004), "severe": ("drift", 0.5 * float(cube["drift_max"].max()) * 1.01)}
    assert list(export_nrml(cube, tmp_path / "f.xml", some)) == ["a_linear", "b_linear"]
    assert set(functions(tmp_path / "f.xml")[1]) == {"a_hertz", "b_hertz"}


@pytest.mark.parametrize(
    ("states", "says"),
    [
        ({}, "no limit states"),
        ({"a b": ("touch", None)}, "limit state 'a b' is no name"),
        ({"a": ("touch", None), "b": ("drift", 0.1)}, "these are of both; write two files"),
        ({"a": ("fall", None)}, "unknown event 'fall'"),
        ({"a": ("drift", None)}, "needs a level"),
    ],
)
def test_limit_states_that_will_not_do(cube, tmp_path, states, says):
    with pytest.raises(InputError, match=says):
        export_nrml(cube, tmp_path / "f.xml", states)


def test_nrml_of_a_spectral_acceleration(cube, tmp_path):
    """Records scaled to it: all in stripes, of which the cube itself tells the intensity."""
    scales = xr.ones_like(cube["record_pga"]) * cube["scale"].rename(scale="sa").drop_vars("sa")
    about = {"sa_period": 0.5, **sweep_attribute(low_and_high(), "el_centro", laws="none")}
    stripes = cube.rename(scale="sa").assign_coords(scale=scales).assign_attrs(about)
    export_nrml(stripes, tmp_path / "f.xml", STATES)
    written = functions(tmp_path / "f.xml")[1]["a_hertz"]
    imls = written.find(f"{NAME}imls")
    assert imls.get("imt") == "SA(0.5)"
    assert numbers(imls, "minIML", "maxIML") == pytest.approx([SCALES[0] / G, SCALES[-1] / G])
    fitted = fragility(stripes, "drift", 0.004, confidence=None, intensity="sa(0.5)").sel(building="a", law="hertz")
    exact = stats.lognorm(float(fitted["dispersion"]), scale=float(fitted["median"]) / G)
    params = written.find(f"{NAME}params")
    assert numbers(params, "mean", "stddev") == pytest.approx([exact.mean(), exact.std()], rel=1e-8)
    with pytest.raises(InputError, match="OpenQuake has no name for 'sa', a mean over buildings"):
        export_nrml(stripes, tmp_path / "g.xml", STATES, intensity="sa")


def read(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_demands_by_hand(cube, tmp_path):
    part = cube.sel(law="hertz")
    n = export_pelicun(part, tmp_path / "d.csv", "a")
    header, units, *rows = read(tmp_path / "d.csv")
    assert header == ["", "1-PID-1-1", "1-PID-2-1", "1-PFA-0-1", "1-PFA-1-1", "1-PFA-2-1"]
    assert units == ["Units", "rad", "rad", "g", "g", "g"]
    assert n == len(rows) == 8 * 12 - 1  # without the one that diverged
    export_pelicun(part.sel(building="a"), tmp_path / "one.csv", "a")
    assert read(tmp_path / "one.csv") == [header, units, *rows]
    table, ok = np.array(rows, float), (part["status"] == 0).values
    assert table[:, 0].tolist() == list(range(n))
    heights = np.diff(part["floor_elevation"].sel(building="a").values, prepend=0.0)
    for storey in (1, 2):
        floor = part.sel(building="a", storey=storey)
        assert table[:, storey] == pytest.approx(floor["drift_max"].values[ok] / heights[storey - 1])
        assert table[:, 3 + storey] == pytest.approx(floor["acceleration_max"].values[ok] / G)
    assert table[:, 3] == pytest.approx((part["record_pga"] * part["scale"]).values[ok] / G)


def test_demands_by_pelicun(cube, tmp_path):
    export_pelicun(cube.sel(law="linear"), tmp_path / "d.csv", "a")
    code = f"""
import json
from pelicun.assessment import Assessment
own = Assessment({{"PrintLog": False, "Seed": 1}})
own.demand.load_sample({str(tmp_path / "d.csv")!r})
names = [list(map(str, name)) for name in own.demand.sample.columns]
print(json.dumps([names, own.demand.sample.iloc[5].tolist(), len(own.demand.sample)]))
"""
    names, row, n = ask(code, "pelicun")
    header, _, *rows = read(tmp_path / "d.csv")
    assert n == len(rows)
    assert sorted("-".join(["1", *name]) for name in names) == sorted(header[1:])
    for name, value in zip(names, row, strict=True):
        written = float(rows[5][header.index("-".join(["1", *name]))])
        unit = 1.0 if name[0] == "PID" else 9.80665  # its base unit of acceleration is m/s2, by its own g
        assert value == pytest.approx(written * unit, rel=1e-4)


@pytest.mark.parametrize(
    ("part", "building", "says"),
    [
        (lambda cube: cube, "a", r"several values of law would be mixed; choose one of each \(--at law=\.\.\.\)"),
        (lambda cube: cube, "c", "unknown building 'c'; valid: a, b"),
        (lambda cube: cube.sel(law="linear", storey=2), "a", "of all storeys, and this cube has .2.; leave storey out"),
        (lambda cube: cube.sel(law="linear", storey=[2]), "a", "of all storeys, and this cube has .2.; leave storey"),
        (lambda cube: cube[["impact_force_max", "status"]].sel(law="linear"), "a", r"needs 'drift_max' or"),
    ],
)
def test_demands_that_can_not_be_written(cube, tmp_path, part, building, says):
    with pytest.raises(InputError, match=says):
        export_pelicun(part(cube), tmp_path / "d.csv", building)


def test_commands(cube, tmp_path):
    path, xml, demands = str(write_cube(cube, tmp_path / "c.nc")), str(tmp_path / "f.xml"), str(tmp_path / "d.csv")

    def run(*arguments, code=0):
        return " ".join(call("export", path, *arguments, code=code).output.split())

    assert run("-o", xml, "--limit-state", "slight=drift:0.004", "--limit-state", "severe=drift:0.008") == xml
    assert len(functions(xml)[1]) == 4
    run("-o", xml, code=2)  # it is there
    assert len(functions(xml)[1]) == 4
    with pytest.raises(OutputError, match="exists"):
        export_nrml(cube, xml, STATES)
    run("-o", xml, "--overwrite", "--at", "law=hertz")
    assert {*functions(xml)[1]} <= {"a-b", "b-wall"}
    run("-o", demands, "--pelicun", "a", "--at", "law=hertz")
    for more, says in (
        (["-o", demands, "--limit-state", "a=touch"], "give -o FILE.xml"),
        (["-o", xml, "--limit-state", "a=drift:x"], "'x' is no number; give one"),
        (["-o", xml, "--table"], "--table is for tables"),
    ):
        assert says in run(*more, "--overwrite", code=2)

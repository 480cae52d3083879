"""A table of bad sweeps, as Python arguments and as files; `report` lists every message for them."""

from __future__ import annotations

import functools
import itertools
import os
import sys
import tempfile
import textwrap
import warnings
from pathlib import Path
from unittest import mock

import numpy as np

from pounding_sweep.base.errors import SweepError
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.scene import Building, ContactProperties, Scene, Wall
from pounding_sweep.outputs.variables import VARIABLES
from pounding_sweep.records import Record
from pounding_sweep.spec import tables
from pounding_sweep.spec.axes import Case, Range
from pounding_sweep.spec.build import build_spec
from pounding_sweep.spec.toml import load_spec

GOLDEN = Path(__file__).parent / "golden" / "bad_sweeps.txt"
PULSE = Record("pulse", dt=0.01, acceleration=[0.0, 1.0, -1.0, 0.0])
NAMES = {
    "Building": Building, "Case": Case, "ContactProperties": ContactProperties, "PULSE": PULSE, "Range": Range,
    "Record": Record, "Scene": Scene, "Wall": Wall, "count": itertools.count, "inf": float("inf"),
    "nan": float("nan"), "np": np, "bare": Scene([Building("a", [1.0], [1.0]), Building("b", [1.0], [1.0])], [0.01]),
    "yielding": Scene(
        [Building("a", [1.0], [1.0], yield_strengths=[0.1]), Building("b", [1.0], [1.0])],
        [0.01],
        ContactProperties(linear_stiffness=1.0),
    ),
    "half": Scene(
        [Building("a", [1.0], [1.0]), Building("b", [1.0], [1.0])],
        [0.01],
        ContactProperties(linear_stiffness=1.0, restitution=0.0),
    ),
}  # fmt: skip
#: Axis -> a valid value.
AXES = {
    "gaps": "0.01",
    "stiffnesses": "1e6",
    "stiffness_factors": "1.5",
    "restitutions": "0.5",
    "scales": "2.0",
    "damping_ratios": "0.04",
    "period_factors": "1.2",
    "mass_factors": "1.2",
}


def _axis(name: str, values: str) -> str:
    return f"laws='kelvin_voigt', {name}={{'left': {values}}}" if name.endswith("_factors") and name[0] in "pm" else (
        f"laws='kelvin_voigt', {name}={values}"
    )  # fmt: skip


#: Arguments in place of those of a valid sweep.
ARGUMENTS = [
    "gap=[0.01], colour='red', gaps=[-1.0]",
    *(_axis(name, values.format(good)) for name, good in AXES.items() for values in (
        "[nan, inf, -inf, 'x', True, None, [1.0], 10**400, 1j, b'x']", "[{0}, {0}]", "[{0}, 0.0, -0.0, -1.0, 1e9]",
        "[]", "'0.1'",
    )),
    *(f"laws='kelvin_voigt', gaps={values}" for values in (
        "np.array([])", "object", "Range(0.01, 1.0, 0)", "Range(nan, 'x', 2.5, 'lin')", "Range(0.0, 1.0, True)",
        "Range(0.0, 1.0, 1)", "Range(-1.0, 1.0, 3, 'log')", "Range(0.01, 0.01, 2)", "Range(0.01, 2.0, 10**12)",
        "[-7.0] * 1000", "{}", "range(10**30)",
    )),
    "gaps=count()",
    "gaps={1: 2}, scene={'preset': 'mate', 3: 4}",
    "gaps={'start': 0.1, 'stop': 0.2}, records={'pulse': 'sine'}",
    "gaps=range(10**12)",
    "laws='mate2015', gaps=Range(0, 1, 1200), restitutions=Range(0.1, 1, 1200), scales=Range(1, 2, 1200)",
    "gaps=np.linspace(0.001, 0.1, 20_000), period_factors={'left': Range(0.5, 2.0, 1_000_000)}",
    "gaps=Range(0.5, 0.9, 10**6), scales=Range(0.5, 0.9, 10**6)",
    "period_factors=3",
    "laws=['nonsense'] * 30, records=[1] * 30",
    "laws='nonsense', gaps=-1.0, period_factors={'x': [1.0], 'left': [0.0]}, damping_ratios=[2.0], scales='y'",
    "gaps=Range(0.0, 1.0, 10_000), period_factors={'left': Range(0.5, 2.0, 200_001)}",
    "laws=None, cases=[{'law': 'linear'}], mass_factors={'left': 1.0}, damping_ratios=0.1",
    "period_factors={'lft': 1.2, 'left': None}, mass_factors={7: 1.0}",
    "period_factors={'left': [1e-4, 1e4]}",
    "strength_factors={'left': 0.5}, hardenings={'left': 0.1}",
    "scene=yielding, laws='linear', strength_factors={'a': [0.5, 0.0, 'x', inf]}, hardenings={'a': [0.1, 1.0, -0.1]}",
    "scene=yielding, laws='linear', hardenings={'b': [0.1], 'c': 0.2}",
    "scene=yielding, laws='linear', method='exact', locate=False",
    "scene=yielding, laws='none', ductilities=[2, 0.5, 'x'], strength_factors={'a': 0.5}",
    "scene='mate2015', laws='none', ductilities=2",
    "scene=yielding, laws=None, cases=[Case('none', hardenings={'a': 1.0, 'b': 0.1}, strength_factors=3)]",
    "restitutions=[0.0, 1.0, 1.5], laws=['linear', 'kelvin_voigt', 'gonthier', 'hertz_damped', 'modified_kelvin']",
    "restitutions=[0.0, 0.01], laws='all', restitution_basis='realised'",
    "restitutions=[-1.0]",
    "scene=bare, laws='none', stiffnesses=[1.0], stiffness_factors=[1.0]",
    "scene=half, laws=['linear', 'kelvin_voigt', 'modified_kelvin']",
    "scene=bare, laws=['linear', 'hertz', 'hertz_damped']",
    "laws=['linear', 'hertz', 'kelvin_voigt', 'none'], stiffnesses=[1e6]",
    *(f"laws={text}" for text in (
        "['linear', 'herz', 'linear']", "'mate2016'", "[]", "None", "3", "[3]", "['mate2015', 'hertz']", "{}", "b'x'",
    )),
    *(f"scene={text}" for text in ("'mate'", "None", "3", "PULSE")),
    *(f"records={text}" for text in (
        "[]", "3", "None", "['nowhere/x.csv', 'el_centri', PULSE, Record('pulse', 1.0, [1.0]), 3, None]", "'arleta'",
        "'x.csv'",
    )),
    "records=['nowhere/x.csv', 'arleta'], skip_missing_records=True",
    "records=[PULSE, 'arleta'], skip_missing_records=True, laws=None, cases=[Case('none', record='arleta')]",
    *(f"method={text}" for text in ("'rk5'", "3", "['rk4']")),
    *(f"dt={text}" for text in ("0.0", "-1e-3", "nan", "'1e-3'", "True", "1e-13", "5e-324", "[1]", "10**400")),
    *(f"accuracy={text}" for text in (
        "0.1", "nan", "'x'", "1e-3, dt=1e-3", "1e-3, dt='x'", "1e-3, locate=False", "1e-3, beta=0.3",
        "1e-3, beta=0.3, method='rk4'",
    )),
    *(f"audit={text}" for text in ("1.5", "-1", "nan", "None", "'x'", "True")),
    *(f"precision={text}" for text in ("'float16'", "32")),
    *(f"restitution_basis={text}" for text in ("'real'", "None", "3")),
    *(f"locate={text}" for text in (
        "'yes'", "1", "None", "False, method='exact'", "False, laws='all'", "False, laws='stereomechanical'",
    )),
    "force_unstable=1",
    "beta=0.6, gamma=0.4, method='newmark'",
    "beta='x', gamma=nan, method='newmark'",
    "beta=0.3, gamma=0.6",
    "beta=0.3, method='exact'",
    *(f"title={text}" for text in ("3", "None", "'two\\nlines'", "'\\x1b[2J'", "'x' * 2000")),
    *(f"outputs={text}" for text in (
        "['impuls', 'impulse', 'impulse', 3]", "[]", "3", "'impuls'", "[[]]", "['all']",
    )),
    "records=['nowhere'], laws=['nolaw'], gaps=[-1.0, 0.1], restitutions=[2.0], dt=-1, method='euler', outputs=['x']",
    *(f"laws=None, cases=[{text}]" for text in (
        "{'law': 'herz'}", "{}", "{'law': 'linear', 'gpa': 1.0}", "{'law': 'linear', 'gap': -1.0}",
        "{'law': 'linear', 'gap': [0.1, nan]}", "{'law': 'linear', 'gap': [0.1]}", "{'law': 'linear', 'gap': 'x'}",
        "{'law': 'linear', 'gap': object}",
        "{'law': 'linear', 'stiffness': 0.0}, {'law': 'linear', 'stiffness_factor': -1.0, 'gap': True}",
        "{'law': 'linear', 'stiffness': 1.0, 'stiffness_factor': 1.0}", "{'law': 'gonthier', 'restitution': 0.0}",
        "{'law': 'linear', 'restitution': 7.0, 'scale': inf}, {'law': 'none', 'scale': 'x', 'damping_ratio': 1.0}",
        "{'law': 'linear', 'record': 'puls'}", "3", "None", "'linear'",
        "Case('linear', period_factors={'left': 0.0, 'lft': 2.0}, mass_factors={'left': True})",
        "Case('linear', period_factors=3, mass_factors={'left': None})", "Case(object)", "Case(None)",
        "Case('linear'), Case('none'), Case('linear', stiffness_factor=1)",
    )),
    "laws=None, cases=[Case('linear'), Case('gonthier')], scene=bare",
    "laws=None, cases=[Case('gonthier')], scene=half",
    "laws=None, cases=[Case('none', record='x')], records=['nowhere/x.csv']",
    "laws=None, cases=[Case('linear')], records=[PULSE, 'el_centro']",
    "laws=None, cases=[]",
    "laws=None, cases=3",
    "laws=None, cases=Case('none')",
    "cases=[Case('linear')], gaps=[0.1], scales=[], period_factors={}",
    *(f"design={text}" for text in (
        "3", "{}", "{'kind': 'lhs', 'samples': 0, 'seed': -1, 'inputs': 3}",
        "{'kind': 'halton', 'samples': 4, 'inputs': {}}", "{'kind': 'sobol', 'samples': 6, 'seeds': 1, 'inputs': {}}",
        "{'kind': 'halton', 'samples': 2.0, 'seed': True, 'inputs': {'gap': 3}}",
        "{'kind': 'saltelli', 'samples': 2**40, 'inputs': {'gap': {'distribution': 'uniform', 'low': 0, 'high': 1}}}",
    )),
    *(f"design={{'kind': 'halton', 'samples': 16, 'inputs': {text}}}" for text in (
        "{'gpa': 3, 'gaps': 3, 'record': {'distribution': 'uniform'}, 'building': {'lf': 3, 'left': {'x': 1}}}",
        "{'gap': {'distribution': 'cauchy'}, 'scale': {'low': 1}, 'restitution': {'distribution': 'normal', 'mu': 3}}",
        "{'gap': {'distribution': 'uniform', 'low': 0.1}, 'scale': {'distribution': 'normal', 'mean': 1.0, 'std': -1}}",
        "{'gap': {'distribution': 'uniform', 'low': 0.1, 'high': nan, 'mean': 'x'}}",
        "{'gap': {'distribution': 'uniform', 'low': 0.1, 'high': 0.1, 'mean': 3.0}}",
        "{'gap': {'distribution': 'log_uniform', 'low': 0.0, 'high': 0.1}}",
        "{'gap': {'distribution': 'lognormal', 'median': 0.0, 'dispersion': 0.5, 'low': -1.0}}",
        "{'gap': {'distribution': 'lognormal', 'median': 0.01, 'dispersion': 0.1, 'low': 0.1, 'high': 0.2}}",
        "{'gap': {'distribution': 'normal', 'mean': 0.01, 'std': 0.01}}",
        "{'restitution': {'distribution': 'uniform', 'low': 0.5, 'high': 1.5}}",
        "{'period_factors': {'left': {'distribution': 'normal', 'mean': 1.0, 'std': 1.0}, 'lft': 3}}",
    )),
    *("design={'kind': 'halton', 'samples': 4, "
      f"'inputs': {{{name!r}: {{'distribution': 'uniform', 'low': 0.5, 'high': 0.9}}}}}}, {more}" for name, more in (
        ("gap", "gaps=0.1"), ("scale", "pgas=1.0"), ("pga", "scales=1.0"), ("damping_ratio", "damping_ratios=0.1"),
        ("stiffness", "laws=['linear', 'hertz']"), ("stiffness_factor", "scene=bare"), ("gap", "cases=[Case('none')]"),
        ("gap", "scales=Range(0.5, 0.9, 10**6), restitutions=Range(0.1, 0.2, 10**6)"),
        ("restitution", "laws='gonthier', scene=bare"),
    )),
]  # fmt: skip

GOOD = """\
title = "a sweep"

[scene]
gaps = [0.01]

[[scene.row]]
name = "left"
masses = [10.0, 8.0]
stiffnesses = [4e3, 3e3]
damping_ratio = [0.05, 0.06]
storey_heights = [3.0, 3.5]

[[scene.row]]
wall = true
name = "moat wall"

[scene.contact]
linear_stiffness = 2e6
hertz_stiffness = 1.88e7
restitution = 0.6

[sweep]
records = [
    { record = "el_centro" },
    { path = "x.csv", units = "g", dt = 0.01, name = "x", scale = 2.0 },
    { path = "x.csv", units = "g", dt = 0.01, name = "y", pga = 3 },
    { synthetic = 1, duration = 2.0, pga = 3.0 },
    { pulse = "half_sine", amplitude = 4.0, period = 0.5, dt = 0.01 },
    { record = "el_centro", pga = 2.0, name = "el_centro_2" },
]
laws = ["linear", "hertz_damped"]
gaps = { start = 0.002, stop = 0.006, count = 3 }
stiffness_factors = { start = 0.1, stop = 10.0, count = 3, spacing = "log" }
restitutions = [
    0.4,  # low
    0.6,
]
scales = [1, 2]

[solver]
method = "newmark"
dt = 2e-3
locate = false
beta = 0.3
gamma = 0.6
force_unstable = true

[output]
variables = ["impulse", "drift_max"]
"""
BAD = """\
titel = "a sweep"

[scene]
gaps = [0.01, -0.02]

[[scene.row]]
name = "left"
masses = [10.0, -8.0, "x"]
stiffnesses = [
    4e3,
    0.0,
    3e3,
]
damping = 0.05

[[scene.row]]
name = "right"
masses = [1.0, 2.0]
stiffnesses = [1.0]

[scene.contact]
linear_stiffness = -2e6
hertz = { radii = [1.0], poisson = 0.2 }

[sweep]
records = [
    "el_centro",
    "nowhere.AT2",
    { path = "x.csv", unit = "g", dt = 0.01 },
    { path = "x.csv", units = "furlong", dt = 0.01 },
    { synthetic = -1 },
    { pulse = "squiggle", amplitude = 1.0, period = 0.5, dt = 0.01 },
    { pulse = "sine" },
    { sine = 3 },
    7,
]
laws = [
    "linear",
    "herz",
]
gaps = [0.01, 0.02,
        nan, -1.0]
stiffness_factors = { start = 1.0, stop = 2.0, cuont = 3 }
restitutions = [1.5]
scale = [1.0]

[solver]
method = "rk5"
dt = "1e-3"
locate = 1

[output]
variables = ["displacement_mx"]
"""
SMALL = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\nlaws = ["linear"]\n'
_CASES = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\n'
#: A row whose floors are not level.
_STAGGERED = """
[scene]
gaps = [0.01]
[[scene.row]]
name = "a"
masses = [1.0]
stiffnesses = [9.0]
[[scene.row]]
name = "b"
masses = [1.0]
stiffnesses = [9.0]
storey_heights = [4.0]
[scene.contact]
hertz_stiffness = 1e6
[sweep]
records = ["el_centro"]
"""
#: Edits of GOOD: what is replaced, and by what.
EDITS = [
    *(("gaps = [0.01]", text) for text in (
        "gaps = [0.01, 0.02]", "gaps = 0.01", "", 'preset = "mate2015"', "gaps = ['x']", "gaps = [true]",
        'preset = 3\ngaps = [0.01]', "gasp = [0.01]", "contact = 3\ngaps = [0.01]", "dt = 3\ngaps = [0.01]",
    )),
    *(("gaps = [0.01]", f"gaps = [0.01]\n{text}") for text in (
        "tolerance = -1e-3", "tolerance = 'x'", "allow_unmet = 3", "storeys = 3", "storeys = {left = [1]}",
        "storeys = {'left-moat wall' = 1}", "storeys = {'left-moat wall' = []}", "storeys = {'left-moat wall' = ['x']}",
        "storeys = {'left-moat wall' = [2, 7]}", "storeys = {'left-moat wall' = [1]}",
    )),
    *(("gaps = [0.01]", f"gaps = [0.01]\ncontacts = {text}") for text in ("3", "'columns'", "'floors and columns'")),
    *(("storey_heights = [3.0, 3.5]", f"column_stiffnesses = {text}") for text in ("[1e4]", "[1e4, 0.0]", "1e4")),
    *(("storey_heights = [3.0, 3.5]", f"slab_depths = {text}") for text in (
        "0.3", "[0.3]", "[0.3, 'x']", "[-0.3, inf]", "[0.3, 3.0]", "[0.0, 0.3]",
    )),
    *(("wall = true", text) for text in ("wall = false", "", "wall = true\nwidth = 3")),
    *(('"moat wall"', text) for text in ('""', '"left"', "3", '"a\\nb"')),
    *(('"left"', text) for text in ('" "', "3")),
    ('name = "left"\n', ""),
    *(("[0.05, 0.06]", text) for text in ("[0.05, 0.9]", '"5 %"', "1.5", "[0.1]", "[]", "true", "['x', 0.1]")),
    *(("[10.0, 8.0]", text) for text in (
        "[]", "10.0", "[10.0, inf]", "[10.0, true]", "[1e308, 1e-308]", "[10.0, [1]]", "[1e300, 1e300]",
    )),
    *(("storey_heights = [3.0, 3.5]", f"storey_heights = {text}") for text in ("[3.0]", "3.0", "[3.0, -1]")),
    *(("storey_heights = [3.0, 3.5]", text) for text in (
        "yield_strengths = [3.0]", "yield_strengths = [3.0, -1]", "yield_strengths = [nan, 'x']", "hardening = 0.1",
        "yield_strengths = [3.0, inf]\nhardening = 1.0", "yield_strengths = [3.0, inf]\nhardening = 'x'",
        "yield_strengths = [3.0, inf]\nhardening = [0.1]", "yield_strengths = [3.0, inf]\nhardening = [0.1, 'x', 1]",
        "damping_stiffness = 'tangent'", "yield_strengths = [3.0, inf]\ndamping_stiffness = 'tan'",
        "yield_strengths = [-3.0, 1]\nhardening = -0.1", "yield_strengths = [3.0, 1]",
        "yield_strengths = [3.0, 1]\nbouc_wen = { n = 0.5 }", "bouc_wen = { n = 2 }", "bouc_wen = 3",
        "yield_strengths = [3.0, 1]\nbouc_wen = { n = 'x', beta = 2, gama = 1 }",
        "yield_strengths = [3.0, 1]\nbouc_wen = { gamma = 1 }\np_delta = 1",
        "p_delta = 'yes'", "p_delta = true\nstorey_heights = [1e-3, 3.5]",
        "p_delta = true\nyield_strengths = [3.0, 1]\ndamping_stiffness = 'tangent'",
    )),
    *(("storey_heights = [3.0, 3.5]", f"dashpots = {text}") for text in (
        "3.0", "[3.0]", "[3.0, -1.0]", "[3.0, inf]", "['x', true]", "[3.0, 0.0]",
    )),
    *(("storey_heights = [3.0, 3.5]", f"foundation = {text}") for text in (
        "3.0", "{}", "{ mass = 0, inertia = 1, sway_stiffness = 2, rocking_stiffness = 3 }",
        "{ mass = 1, inertia = 0.0, sway_stiffness = 2, rocking_stiffness = 3 }",
        "{ mass = 'x', inertia = 1, sway_stiffness = inf, rocking_stiffness = -3, colour = 2 }",
        "{ mass = 1, inertia = 1, sway_stiffness = inf, rocking_stiffness = 3 }",
        "{ mass = 1, inertia = 1, sway_stiffness = 2, rocking_stiffness = 3, rocking_damping = -1 }",
        "{ mass = 1, inertia = 1, sway_stiffness = 2, rocking_stiffness = 3 }\np_delta = true",
    )),
    ("gaps = [0.01]", "gaps = [0.01]\nlinks = [{pair = 'left-moat wall', storeys = [1], stiffness = 3.0}]"),
    *(("restitution = 0.6", text) for text in (
        "restitution = 6", "hertz = 3", "restitution = 0.6\nhertz = {radii = [1, 2]}", "restitution = 'x'",
        "restitution = nan", "restituton = 0.6",
    )),
    *(("hertz_stiffness = 1.88e7", text) for text in (
        "hertz = {mass_1 = 2}", "hertz = {radii=[1, 2], mass_1 = 2}", "", "hertz = {radii=[1, -2]}",
        "hertz = {radii=['x', 2]}", "hertz = {mass_1 = 2, mass_2 = 3, poisson_ratio = 2.0}",
        "hertz = {mass_1 = 2, mass_2 = 3, density = 1e-320}", "hertz_stiffness = 0",
    )),
    *(('laws = ["linear", "hertz_damped"]', text) for text in ("", "laws = 3", "laws = ['nobody', 3]", "laws = []")),
    ("spacing", "spacin"),
    *(('"log"', text) for text in ('"cubic"', "3")),
    ("stiffness_factors =", "stiffnesses ="),
    *(("count = 3 }", text) for text in (
        "count = 0 }", "count = 1000000000000 }", "count = 2.5 }", "}", "count = 3, step = 1 }",
    )),
    *(("scales = [1, 2]", text) for text in (
        "scales = []", "dt = 1e-3", "scales = 'x'", "building = 3", "building.left = 3", "building.lft.mass_factor = 2",
        "building.left.mas_factor = 2", "building.left.mass_factor = [1, 1, 0]", "building.left.mass_factor = []",
        "building.left.period_factor = { start = 1, stop = 2, cuont = 3 }", "damping_ratios = [0.5, 1.5]", "colour = 1",
        "cases = []", "cases = [{law = 'none'}]", "restitution_basis = 3", "restitution_basis = 'real'",
    )),
    ("    0.6,\n]", "    0.4,\n]"),
    ('name = "y", pga = 3', 'name = "x", pga = 3'),
    *(("scale = 2.0", text) for text in ("scale = 2.0, pga = 1.0", "scale = 'x'", "scale = nan")),
    *(('record = "el_centro", pga', text) for text in (
        'record = "el_centro", scale = 2, pga', 'record = "el_centri", pga', 'record = 3, pga',
        'record = "el_centro", path = "x.csv", pga', 'record = "arleta", pga',
    )),
    *(("synthetic = 1, duration = 2.0", text) for text in (
        "synthetic = 1.5, duration = 2.0", "synthetic = 1, duration = -2.0", "synthetic = 1, duration = 2.0, riise = 1",
    )),
    *(("beta = 0.3", text) for text in ("beta = 0.7", "beta = 'x'")),
    *(("dt = 2e-3", text) for text in ("dt = 0", "dt = 'x'", "accuracy = 1", "dt = 2e-3\naccuracy = 1e-3")),
    *(("locate = false", text) for text in ("restitutions = []", "locate = 'no'", "audit = 'x'", "audit = 2")),
    *(('method = "newmark"', text) for text in ("method = 'exact'", "method = 3", "precision = 16")),
    *(('title = "a sweep"', text) for text in (
        'variables = "all"', "title = 3", "title = 'a\\u0007'", 'title = "a\\u0007"', "gaps = 1",
    )),
    ("[solver]", "[solvr]"),
    *(('["impulse", "drift_max"]', text) for text in ("[]", "3", "['impuls']", '"defalt"')),
]  # fmt: skip
FILES = [
    BAD,
    "# nothing\n",
    "[scene]\n[sweep]\n",
    "scene = 3\nsweep = 4\nsolver = 5\noutput = 6\ntitle = 7\n",
    "scene.row = 3\nsweep = []\n",
    "scene.row = [3]\nsweep.records = 3\n",
    f"output = 3\n{SMALL}",
    f"{SMALL}cases = 3\n",
    f"{SMALL}[[sweep.cases]]\nlaw = 'none'\n",
    f"{_CASES}cases = [3, {{}}, {{law = 'none', building = 3}}]\n",
    f"{_CASES}[[sweep.cases]]\nlaw = 'herz'\ngap = [0.1, -2]\nscal = 2\nperiod_factors = {{left = 2}}\n"
    "[[sweep.cases]]\nlaw = 'none'\n[sweep.cases.building.lft]\nmass_factor = 2\n[sweep.cases.building.left]\n"
    "period_factor = 0\nmas_factor = 3\n[sweep.cases.building.right]\nmass_factor = [1]\n",
    f"{_CASES}[[sweep.cases]]\nlaw = 'none'\nbuilding.left = 3\n[[sweep.cases]]\nlaw = 3\nrecord = 3\ngap = 'x'\n",
    f"{SMALL}building.left.period_factor = [\n  1.0,\n  -1.0,\n]\nbuilding.left.colour = 'red'\n"
    'building."tower 1".mass_factor = 2\nbuilding.right.mass_factor = { start = 1.0, stop = 2.0 }\n',
    "a = [1,\n2\nb = 3\n",
    "title = \n",
    "[scene]\n[scene]\n",
    '[scene]\nx = "abc',
    "x = " + "1" * 5000,
    "x = " + "[" * 100000,
    f"x{'.x' * 50} = 1",
    f"x = {'[' * 30}{']' * 30}",
    f"{SMALL}gaps = {'[' * 15}{']' * 15}",
    f"title = '{'x' * 3000}'\n{SMALL}",
    f"{'k' * 3000} = 1\n{SMALL}",
    f"title = 0x{'f' * 9000}\n{SMALL}",
    SMALL.replace('"el_centro"', '{ path = "~nobody-of-this-name/x.AT2" }'),
    SMALL.replace('"el_centro"', "3, [], {}, true"),
    SMALL.replace('["el_centro"]', "[]"),
    f"{SMALL}[[sweep.gaps]]\nstart = 1\n",
    f"{SMALL}[design]\nkind = 'sobol'\nsamples = 5\n[design.inputs]\ngap = {{ distribution = 'uniform', low = 1 }}\n"
    "building.left.mass_factor = { distribution = 'normal', mean = 1.0, std = 0.0 }\nperiod_factors = 3\n",
    f"{SMALL}design = 3\n",
    f"design = 3\n{SMALL}",
    f"{SMALL}[design]\nkind = 'halton'\nsamples = 64\n[design.inputs]\ngap.distribution = 'normal'\n"
    "gap.mean = 0.01\ngap.std = 0.01\nrecord.distribution = 'uniform'\n",
    f"{_STAGGERED}laws = 'hertz'\n",
    *(
        SMALL.replace('"mate2015"\n', f'"mate2015"\n{links}\n')
        for links in (
            "links = 3",
            "links = [3, {}]",
            "links = [{pair = 'left-right', storeys = [1], stiffness = 3.0}]",
            "links = [{pair = 'left-middle', storeys = [1, 4], stiffness = 3.0}, {pair = 'x', storeys = 1}]",
            "links = [{pair = 'left-middle', storeys = [1, [2, 0]], damping = -3.0}, {pair = 'x', storeys = [1, 'y']}]",
            "links = [{pair = 'left-middle', storeys = [[1, 2, 3]], damping = 3.0, colour = 2}]",
            "links = [{pair = 'left-middle', storeys = [1]}, {pair = 'middle-right', storeys = [0], damping = 1.0}]",
            "[[scene.links]]\npair = 'left-middle'\nstoreys = [1]\ndamping = inf\nstiffness = 'x'",
            "[[scene.links]]\npair = 'left-middle'\nstoreys = [1]\ndamping = 3\n"
            "[[scene.links]]\npair = 'left-middle'\nstoreys = [2, [1, 3]]\ndamping = 3",
            "[[scene.links]]\npair = 'left-middle'\nstoreys = [1]\ndamping = 1e5\n[solver]\nmethod = 'exact'\n"
            "precision = 'float32'",
        )
    ),
    *(
        SMALL.replace('"mate2015"\n', f'"mate2015"\n{bumpers}\n')
        for bumpers in (
            "bumpers = 3",
            "bumpers = [3, {}]",
            "bumpers = [{pair = 'left-right', law = 'linear', stiffness = 3.0}]",
            "bumpers = [{pair = 'left-middle', law = 'nobody'}, {pair = 'x', law = 'none'}, {pair = 'x', law = 3}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = -3.0}, {pair = 'x', law = 'hertz'}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = 3.0, restitution = 0.5, colour = 2}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = 3.0, restitution = 0.5}]",
            "bumpers = [{pair = 'left-middle', law = 'kelvin_voigt', stiffness = 3.0, restitution = 1.5}]",
            "bumpers = [{pair = 'left-middle', law = 'kelvin_voigt', stiffness = 3.0}]",
            "bumpers = [{pair = 'left-middle', law = 'rubber_bumper', stiffness = 3.0, restitution = 0.5}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = 3.0, thickness = -0.1}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = 3.0, thickness = 0.5}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = 3.0, storeys = [4]}]",
            "bumpers = [{pair = 'left-middle', law = 'linear', stiffness = 3.0, storeys = ['x']}]",
            "bumpers = [{pair = 'left-middle', law = 'gone.py:pad', stiffness = 3.0}]",
            "[[scene.bumpers]]\npair = 'left-middle'\nlaw = 'linear'\nstiffness = 3.0\n"
            "[[scene.bumpers]]\npair = 'left-middle'\nlaw = 'linear'\nstiffness = 3.0\nstoreys = [2]",
            "[[scene.bumpers]]\npair = 'left-middle'\nlaw = 'hysteretic'\nstiffness = 3.0\nrestitution = 0.5\n"
            "[solver]\nlocate = false",
        )
    ),
    '[scene]\npreset = "mate2015"\n[[scene.bumpers]]\npair = "left-middle"\nlaw = "hysteretic"\nstiffness = 3.0\n'
    'restitution = 0.1\n[sweep]\nrecords = ["el_centro"]\nlaws = ["linear"]\nrestitution_basis = "realised"\n',
    SMALL.replace("linear", "stereomechanical").replace(
        "[sweep]", "[[scene.bumpers]]\npair = 'left-middle'\nlaw = 'linear'\nstiffness = 3.0\n[sweep]"
    ),
    *(
        _STAGGERED.replace("[scene]", '[scene]\ncontacts = "floors and columns"') + law
        for law in ("laws = ['linear', 'hertz']\nstiffness_factors = 1.0\n", "[[sweep.cases]]\nlaw = 'hertz'\n")
    ),
]


def _told(make) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            make()
        except SweepError as error:
            return textwrap.indent("\n".join(error.problems), "    ")
    return "    accepted"


def report(folder: Path) -> str:
    """Return every input with what is said of it; records are read once."""
    with mock.patch.object(tables, "find_record", functools.cache(tables.find_record)):
        return _report(folder)


def _report(folder: Path) -> str:
    usual = {"scene": "mate2015", "records": PULSE, "laws": "linear"}
    said = []
    for text in ARGUMENTS:
        change = eval(f"dict({text})", NAMES)  # the table above, nothing else
        said.append(f"{text}\n{_told(lambda change=change: build_spec(**(usual | change)))}")
    (folder / "x.csv").write_text("0.1\n0.2\n-0.3\n")
    edited = []
    for old, new in EDITS:
        assert GOOD.count(old) >= 1, old
        edited.append((f"{old!r} -> {new!r}", GOOD.replace(old, new, 1)))
    for name, text in [*edited, *((f"file {i}", text) for i, text in enumerate(FILES))]:
        path = folder / "s.toml"
        path.write_text(text)
        said.append(
            f"{name}\n{_told(lambda path=path: load_spec(path))}".replace(f"{path}:", "").replace(f"{folder}/", "")
        )
    text = "\n".join(said) + "\n"
    for what, names in (("outputs", sorted(VARIABLES)), ("laws", sorted(LAWS)), ("laws", list(LAWS))):
        text = text.replace(", ".join(names), f"ALL {what}")  # they grow, and no message changes by that
    return text


if __name__ == "__main__":
    os.environ.pop("POUNDING_SWEEP_RECORDS", None)
    with tempfile.TemporaryDirectory() as where:
        text = report(Path(where))
    (Path(sys.argv[1]) if sys.argv[1:] else GOLDEN).write_text(text)

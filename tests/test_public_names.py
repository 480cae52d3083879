"""What users and outside checks call: names, arguments, commands and variables, none of which may go."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from stub_engine import ENVIRONMENT
from test_analysis_cubes import hand_cube, random_fill

import pounding_sweep
import pounding_sweep as ps
from pounding_sweep import analysis, figures
from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.base.errors import InputError, PoundingSweepError
from pounding_sweep.cli.app import app
from pounding_sweep.figures import FIGURES
from pounding_sweep.variables.registry import STATUS, VARIABLES

#: Arguments of public callables as they are given: in order, with their defaults; those after * by name only.
CALLS = {
    "Building": "(name, masses, stiffnesses=None, damping_ratio=0.05, storey_heights=None)",
    "Wall": "(name='wall')",
    "ContactProperties": "(linear_stiffness=None, hertz_stiffness=None, restitution=None)",
    "Scene": "(row, gaps=())",
    "Infill": "(stiffnesses, yield_strengths, hardening=0.0, hysteresis=None)",
    "Foundation": "(mass, inertia, sway_stiffness, rocking_stiffness, sway_damping=0.0, rocking_damping=0.0)",
    "Link": "(pair, storeys, stiffness=0.0, damping=0.0)",
    "Bumper": "(pair, law, stiffness=None, restitution=None, thickness=None, storeys=())",
    "base_isolated": "(building, base_mass, period, damping_ratio, strength=0.0, yield_drift=0.01, *, height=1.5)",
    "get_preset": "(name)",
    "get_law": "(key)",
    "hertz_stiffness": "(mass_1=None, mass_2=None, *, young_modulus=25000000.0, poisson_ratio=0.2, density=2.5, "
    "radii=None)",
    "Record": "(name, dt, acceleration, source='', scale=1.0)",
    "read_record": "(path, *, name=None, dt=None, units=None, scale=1.0, pga=None)",
    "find_record": "(name, folders=None)",
    "list_records": "(folders=None)",
    "pulse_record": "(shape, *, amplitude, period, dt, duration=None, name=None)",
    "synthetic_record": "(seed, *, duration=20.0, dt=0.01, pga=3.0, name=None)",
    "Range": "(start, stop, count, spacing='linear')",
    "backbone_from_pushover": "(path, *, drift=None, shear=None, units=None, law='bilinear', target_drift=None)",
    "cyclic_test": "(building, drifts, storey=1)",
    "simulate": "(scene, record, *, law=None, gaps=None, stiffness=None, restitution=None, method=None, dt=None, "
    "locate=True, initial_velocity=None, precision=None, accuracy=None, output_step=None)",
    "Sweep": "(scene, records, laws=None, *, gaps=None, stiffnesses=None, stiffness_factors=None, restitutions=None, "
    "scales=None, period_factors=None, mass_factors=None, damping_ratios=None)",
    "Sweep.plan": "(self)",
    "Sweep.run": "(self, out=None, *, scheduler='threads', workers=None, overwrite=False, progress=None, extend=None)",
    "load_sweep": "(path, *, skip_missing_records=False, folders=None)",
    "open_cube": "(path)",
    "report": "(cube, path, *, title=None, folders=None)",
    "view": "(cube, out=None, *, at=None, names=None)",
    "tradeoff": "(sweep, *, steps=(0.005, 0.0025, 0.001, 0.0005, 0.00025))",
}

#: Commands, each with the arguments and options that it must have.
COMMANDS = {
    "run": "sweep -o --output --scheduler --workers --accuracy --records --skip-missing-records --overwrite --extend",
    "plan": "sweep --workers --accuracy --records --json",
    "info": "cube --json",
    "plot": "cube kind -o --output --at --x --y --value --contours --turn --names --event --level --start --end --dpi "
    "--list",
    "view": "cube -o --output --at --var",
    "export": "cube -o --output --var --at --overwrite",
    "merge": "cubes -o --output --tolerance --overwrite",
    "compare": "cube --what -o --output --reference --event --level --records --json",
    "report": "cube -o --output --at --title --event --level --hazard --cd --ie --q --r --records",
    "simulate": "sweep -o --output --law --gap --stiffness --stiffness-factor --restitution --record --scale --case "
    "--at --output-step",
    "storey": "sweep name -o --output --storey --target --start",
    "animate": "sweep -o --output --start --end --frames --speed",
    "tradeoff": "sweep -o --output --steps --all --scenarios --seed --plot --workers --json",
    "extremes": "sweep --scenes --seed --law --family --precision --map --plot --workers --json",
    "paper": "cubes -o --output --records --json",
    "laws": "--restitution --e --json",
    "records": "--records --json",
    "doctor": "--no-check --json",
}

_FLOOR, _TOUCH = ("building", "storey"), ("pair", "storey")
#: Variables of a cube with their dimensions inside a scenario.
DIMENSIONS = {
    **dict.fromkeys(("displacement_max", "displacement_min", "drift_max"), _FLOOR),
    **dict.fromkeys(("storey_shear_max", "acceleration_max"), _FLOOR),
    **dict.fromkeys(("impact_force_max", "impact_count", "penetration_max", "impulse"), _TOUCH),
    **dict.fromkeys(("first_impact_time", "approach_speed_max"), _TOUCH),
    **dict.fromkeys(("energy_input", "energy_damping", "energy_transfer_max", "energy_transfer_min"), ("building",)),
    "contact_work": ("pair",),
    **dict.fromkeys(("status", "energy_residual", "steps_per_contact", "origin", "run", "unsettled_output"), ()),
}

#: ``flag_meanings`` of the variable ``status``, by value.
MEANINGS = (
    "ok diverged under_resolved_contact newton_not_converged beyond_stability_limit not_run under_resolved_motion "
    "unsettled collapsed"
)


def test_names():
    known = {name.partition(".")[0] for name in CALLS} | {
        "LAWS",
        "Law",
        "PoundingSweepError",
        "__version__",
        "analysis",
        "figures",
    }
    assert known <= set(ps.__all__) == set(dir(ps))
    assert all(hasattr(ps, name) for name in ps.__all__)


@pytest.mark.parametrize("name", CALLS)
def test_arguments(name):
    space = {}
    exec(f"def wanted{CALLS[name]}: pass", space)
    found = ps
    for part in name.split("."):
        found = getattr(found, part)
    wanted, has = (inspect.signature(each).parameters for each in (space["wanted"], found))
    for place, (key, argument) in enumerate(wanted.items()):
        assert key in has
        assert has[key].default == argument.default
        if argument.kind is argument.POSITIONAL_OR_KEYWORD:
            assert list(has)[place] == key
            assert has[key].kind is argument.kind


def test_the_calls_of_the_documentation():
    left = ps.Building("left", [173.331] * 2, stiffnesses=[555.55e3] * 2, damping_ratio=0.05, storey_heights=[3.0] * 2)
    scene = ps.Scene([left, ps.Building("right", [100.0], [4e5]), ps.Wall()], gaps=[0.01, 0.01])
    pulse = ps.Record("pulse", dt=0.01, acceleration=[0.0, 1.0, 0.0])
    solver = {"method": "rk4", "dt": 1e-3, "locate": True, "outputs": ["displacement_max", "impact_count"]}
    values = {"gaps": [0.005, 0.01], "stiffnesses": [2e6], "restitutions": [0.4, 0.6], "scales": [1.0, 2.0]}
    sweep = ps.Sweep(scene, records=[pulse, "el_centro"], laws=["linear", "kelvin_voigt"], **values, **solver)
    assert list(sweep.spec.axes) == ["law", "gap", "stiffness", "restitution", "record", "scale"]
    factors = ps.Sweep("mate2015", pulse, ["linear", "hertz"], stiffness_factors=[1.0, 2.0])
    assert "stiffness_factor" in factors.spec.axes
    more = {"cases": None, "beta": None, "gamma": None, "force_unstable": False, "title": "", "precision": None}
    ps.Sweep("mate2015", pulse, "linear", **more, restitution_basis="published", accuracy=1e-2, audit=0.0, folders=[])


def test_commands():
    commands = typer.main.get_command(app).commands
    for name, wanted in COMMANDS.items():
        assert set(wanted.split()) <= {word for parameter in commands[name].params for word in parameter.opts}
    assert "plot" in commands["records"].commands


def test_variables_and_statuses():
    assert {name: VARIABLES[name].dims for name in DIMENSIONS} == DIMENSIONS
    assert " ".join(status.label for status in STATUS) == MEANINGS
    assert [int(status) for status in STATUS] == list(range(len(STATUS)))


PULSE = ps.pulse_record("sine", amplitude=3.0, period=0.5, dt=0.01)
ONE = ps.Scene([ps.Building("a", [100.0], 1e5)])
PUBLIC = {
    name: function
    for package, home in ((ps, ps._HOME), (analysis, analysis._HOME))
    for name in home
    if inspect.isroutine(function := getattr(package, name)) or (inspect.isclass(function) and name == "Record")
}


@pytest.mark.parametrize("name", sorted({*PUBLIC} - {"attribute"}))
def test_an_unknown_or_missing_argument_is_an_error_of_the_package(name):
    parameters = inspect.signature(PUBLIC[name]).parameters.values()
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):  # else they are those of a building
        with pytest.raises(PoundingSweepError, match="'zzz'"):
            PUBLIC[name](zzz=1)
    required = [p for p in parameters if p.default is p.empty]
    if required:
        with pytest.raises(PoundingSweepError, match=f"missing.*{required[0].name}|{required[0].name}: is missing"):
            PUBLIC[name]()


def test_an_argument_of_nearly_the_right_name_is_named():
    with pytest.raises(InputError, match="simulate: unknown argument 'gap'; did you mean 'gaps'"):
        ps.simulate("mate2015", PULSE, law="linear", gap=0.01)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: ps.open_cube(3), "open_cube: path is 3; it must be a str or PathLike"),
        (lambda: ps.load_sweep(None), "load_sweep: path is None"),
        (lambda: ps.find_record(3), "a record's name is a text, not 3"),
        (lambda: ps.Sweep(records=3), "Sweep: missing a required argument: 'scene'; it takes scene, records, laws"),
        (lambda: ps.Sweep(ONE, PULSE, "none", gap=1.0), "unknown key 'gap'; did you mean 'gaps'"),
        (lambda: ps.Sweep(ONE, 3, "none"), "records: must be one or several"),
        (lambda: ps.Sweep(ONE, np.array(0.5), "none"), "records: must be one or several"),
        (
            lambda: ps.Sweep(ONE, PULSE, "none", period_factors=[1]),
            "period_factors: .* a table by name of the building",
        ),
        (lambda: ps.pulse_record(["sine"], amplitude=3.0, period=0.5, dt=0.01), "unknown"),
        (lambda: ps.simulate(ONE, PULSE, law="none", output_step="x", dt=0.01), "output_step is 'x'"),
        (lambda: analysis.response_spectrum(PULSE, "x"), "periods of the spectrum .*: 'x'; give a number"),
        (lambda: analysis.scaled_to_sa("x", 1.0, 1.0), "record is 'x'; it must be a Record"),
        (lambda: analysis.Hazard(1.0, 2.0), "a hazard of 1 intensities and 1 rates"),
        (lambda: ps.list_records(3), "folders is 3; give a path, or a list of paths"),
        (lambda: ps.Building("a", np.array(1.0), 1e5), "must be a list"),
        (lambda: ps.Scene([ps.Building("a", [1.0], 1.0)], storeys=[1]), "storeys"),
    ],
)
def test_a_wrong_kind_is_an_error_of_the_package(call, said):
    with pytest.raises(PoundingSweepError, match=said):
        call()


def test_comparisons_take_one_number_one_name_and_per_cent():
    cube = hand_cube({"law": ["linear"], "record": ["r", "s", "t"]}, random_fill(1, "drift_max", "impact_count"))
    some = analysis.fractiles(cube, outputs=["drift_max"], quantiles=[0.5])
    for quantiles in (0.5, "50%", np.float64(0.5), ["50 %"]):
        assert analysis.fractiles(cube, outputs="drift_max", quantiles=quantiles).identical(some)
    with pytest.raises(InputError, match="quantiles: 'half'; give a number in"):
        analysis.fractiles(cube, quantiles="half")


def test_functions_have_the_names_of_comparisons():
    for key, comparison in COMPARISONS.items():
        assert comparison.make is getattr(analysis, key.replace("-", "_"))
    assert not {"impact_statistics", "energy_budget", "compare_laws", "incremental_curves"} & {*dir(analysis)}


QUICKSTART = Path(__file__).parents[1] / "sweeps" / "quickstart.toml"


@pytest.mark.parametrize("package", [pounding_sweep, analysis, figures])
def test_every_name_of_a_package_is_there(package):
    assert dir(package)
    for name in dir(package):
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match=rf"module '{package.__name__}' has no attribute 'nothing'"):
        package.nothing


@pytest.mark.parametrize("registry", [COMPARISONS, FIGURES], ids=["comparisons", "figures"])
def test_every_entry_of_a_registry_has_its_key(registry):
    assert len(registry) == len(list(registry)) > 5
    for key, entry in registry.items():
        assert entry.key == key
    with pytest.raises(KeyError):
        registry["nothing"]


def test_nothing_heavy_is_loaded_before_it_is_used():
    """Packages are reached, keys known and command lines made without numpy; records, descriptions without more."""
    code = """
import sys, pounding_sweep as ps
ps.analysis.COMPARISONS; ps.figures.plot
import pounding_sweep.cli
assert "laws" in ps.analysis.COMPARISONS
print({"numpy", "xarray", "matplotlib", "numba"} & set(sys.modules))
import pounding_sweep.variables.registry, pounding_sweep.output.dataset, pounding_sweep.output.describe
import pounding_sweep.output.netcdf, pounding_sweep.records, pounding_sweep.resume
print({"numba", "dask", "matplotlib", "scipy", "xarray", "netCDF4", "filelock", "psutil"} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["set()"] * 2
    assert figures.force_gap is FIGURES["force-gap"].draw


@pytest.mark.parametrize("command", [["plan"], ["run", "--quiet", "--output=out.nc"]], ids=lambda command: command[0])
def test_a_sweep_is_run_without_xarray_and_numba(command, tmp_path):
    """They take longer to load than the quickstart to run."""
    name, *options = command
    module = "pounding_sweep" if name == "plan" else "stub_engine"
    command = [sys.executable, "-X", "importtime", "-m", module, name, QUICKSTART, *options]
    environment = os.environ | ENVIRONMENT | {"POUNDING_SWEEP_CACHE": str(tmp_path)}  # kernels that it has are timed
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "numpy" in loaded
    assert not {"xarray", "pandas", "dask", "numba"} & loaded

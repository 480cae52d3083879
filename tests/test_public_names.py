"""Names, arguments, commands and variables that users and outside checks call: more may come, none of these may go."""

from __future__ import annotations

import inspect

import pytest
import typer

import pounding_sweep as ps
from pounding_sweep.cli.app import app
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

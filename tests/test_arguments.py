"""What Python takes: what commands take, and errors of the package for what it does not."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from test_analysis_cubes import hand_cube, random_fill

import pounding_sweep as ps
from pounding_sweep import analysis
from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.base.errors import InputError, PoundingSweepError

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

"""Datasets that figures are drawn from, made by hand: nothing is integrated for them; and what figures show of them.

``python tests/figure_data.py`` writes the latter anew (tests/golden/figures.json): look at the figures first.
"""

from __future__ import annotations

import json
import zlib
from functools import cache, partial, wraps
from pathlib import Path

import numpy as np
import xarray as xr
from scenes import CubeAxis, assemble

from pounding_sweep.accuracy.tradeoff import KIND, KIND_ATTRIBUTE
from pounding_sweep.analysis import response_spectrum
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import ContactProperties, Scene, Wall
from pounding_sweep.output.labels import design_coordinates
from pounding_sweep.records import pulse_record, records_dataset
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import json_data, to_json
from pounding_sweep.run.cyclic import cyclic_test, fema_461
from pounding_sweep.variables.registry import VARIABLES, inner_shape

LAWS = ("linear", "kelvin_voigt", "none")


def made_once(make):
    """Have each dataset put together once; who asks gets a copy of it."""
    kept = cache(make)
    return wraps(make)(lambda *args, **more: kept(*args, **more).copy(deep=True))


def scene(left_wall=False, right_wall=False, names=("w1", "a", "b", "w2")):
    """Two buildings of three and two storeys, walls beside them where asked for."""
    row = [Building(names[1], [200.0] * 3, [2e5] * 3), Building(names[2], [100.0] * 2, [1.5e5] * 2)]
    row = [*([Wall(names[0])] if left_wall else []), *row, *([Wall(names[3])] if right_wall else [])]
    contact = ContactProperties(linear_stiffness=1e6, hertz_stiffness=1e7, restitution=0.6)
    return Scene(row, gaps=[0.01 * (i + 1) for i in range(len(row) - 1)], contact=contact)


@made_once
def cube(seed=0, *, right_wall=False, **sizes):
    """A cube of every output, its values random and above zero; axes of the sizes given, or of one value."""
    row = scene(right_wall=right_wall)
    n = {"law": 3, "gap": 4, "stiffness_factor": 1, "restitution": 2, "record": 1, "scale": 1} | sizes
    axes = [
        CubeAxis("law", list(LAWS[: n["law"]])),
        CubeAxis("gap", [0.002 * (i + 1) for i in range(n["gap"])], "m", "gap of every pair"),
        CubeAxis("stiffness_factor", [2.0**i for i in range(n["stiffness_factor"])], "1"),
        CubeAxis("restitution", [round(0.4 + 0.2 * i, 1) for i in range(n["restitution"])], "1"),
        CubeAxis("record", [f"r{i + 1}" for i in range(n["record"])]),
        CubeAxis("scale", [0.5 * (i + 1) for i in range(n["scale"])], "1", "factor on the record"),
    ]
    shape = tuple(axis.size for axis in axes)
    arrays = {}
    for name, variable in VARIABLES.items():
        rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        values = rng.uniform(0.1, 1.0, (*shape, *inner_shape(name, row)))
        arrays[name] = np.ceil(9.0 * values).astype(np.int32) if variable.dtype == "i4" else values
    arrays["status"] = np.zeros(shape, np.int8)
    for name in ("displacement_max", "displacement_min", "drift_max", "penetration_max", "closing_max"):
        arrays[name] = 0.02 * arrays[name]
    arrays["displacement_min"] = -arrays["displacement_min"]
    realised = np.array([[1.0 if law == "linear" else e for e in axes[3].values] for law in axes[0].values])
    extra = {
        "record_pga": (("record",), np.linspace(1.0, 3.0, n["record"]), {"units": "m s-2"}),
        "restitution_realised": (("law", "restitution"), realised, {"units": "1"}),
        "fundamental_period": (("building",), np.array([b.periods[0] for b in row.buildings]), {"units": "s"}),
        "first_damping_ratio": (("building",), np.array([b.damping_ratio for b in row.buildings]), {"units": "1"}),
    }
    records = [pulse_record("sine", amplitude=1.0, period=0.5, dt=0.02, name=name) for name in axes[4].values]
    spec = build_spec(scene=row, records=records, laws=axes[0].values, gaps=axes[1].values, scales=axes[5].values)
    return assemble(row, axes, arrays, {"title": "by hand", "sweep": to_json(spec)}, extra)


@made_once
def design(samples=8, **more):
    """A cube of a Saltelli design of two inputs under two laws, its values those of a formula of the inputs."""
    inputs = {
        "gap": {"distribution": "uniform", "low": 0.002, "high": 0.02},
        "scale": {"distribution": "uniform", "low": 0.5, "high": 1.5},
    }
    settings = {"design": {"kind": "saltelli", "samples": samples, "inputs": inputs}, "laws": LAWS[:2]} | more
    record = pulse_record("sine", amplitude=1.0, period=0.5, dt=0.02, name="r1")
    spec = build_spec(scene=scene(), records=record, **settings)
    row, cases = scene(), spec.cases
    gap, scale = (np.array([getattr(case, name) for case in cases])[:, None, None] for name in ("gap", "scale"))
    arrays = {"status": np.zeros(len(cases), np.int8), "steps_per_contact": np.full(len(cases), 9.0)}
    for name, values in (("impact_force_max", 1e3 * scale * (1.0 - 20.0 * gap)), ("drift_max", 0.01 * scale)):
        arrays[name] = np.broadcast_to(values, (len(cases), *inner_shape(name, row))).copy()
        arrays[name][:, -1, 2] = np.nan  # a storey that the lower building has not
    extra = {name: (("case",), [getattr(case, name) for case in cases], {}) for name in ("law", "record")}
    extra |= design_coordinates(spec)
    axes = [CubeAxis("case", np.arange(1, len(cases) + 1), "1", "listed scenario")]
    return assemble(row, axes, arrays, {"title": "by hand", "sweep": to_json(spec)}, extra)


@made_once
def histories(left_wall=False, right_wall=False, touch=True, **more):
    """Histories of two seconds: floors that sway against each other, and forces where they overlap."""
    row = scene(left_wall, right_wall, **more)
    time = np.linspace(0.0, 2.0, 401)
    sway = np.array([[0.6, 0.8, 1.0], [-0.7, -1.0, np.nan]]) * (0.02 if touch else 0.004)
    phase = np.sin(2.0 * np.pi * 2.0 * time) * np.exp(-0.5 * time)
    displacement = phase[:, None, None] * sway
    first = 1 if left_wall else 0
    closing = np.full((len(time), len(row.pair_names), 3), np.nan)
    for contact in row.contacts:
        ends = [(contact.pair - first, 1.0), (contact.pair + 1 - first, -1.0)]
        total = sum(s * displacement[:, b, contact.storey - 1] for b, s in ends if 0 <= b < 2)
        closing[:, contact.pair, contact.storey - 1] = total - row.gaps[contact.pair]
    drift = np.diff(displacement, axis=2, prepend=0.0)
    plastic = np.maximum.accumulate(np.nan_to_num(np.abs(drift) - 0.01), axis=0).clip(min=0.0)
    floors, pairs = ("time", "building", "storey"), ("time", "pair", "storey")
    arrays = {
        "displacement": (floors, displacement, {"units": "m"}),
        "velocity": (floors, np.gradient(displacement, time, axis=0), {"units": "m s-1"}),
        "acceleration": (floors, -160.0 * displacement, {"units": "m s-2"}),
        "storey_drift": (floors, drift, {"units": "m"}),
        "plastic_drift": (floors, np.where(np.isnan(drift), np.nan, plastic), {"units": "m"}),
        "storey_shear": (floors, 1e4 * (drift - 0.9 * plastic), {"units": "kN"}),
        "ground_acceleration": (("time",), np.cos(9.0 * time), {"units": "m s-2"}),
        "contact_force": (pairs, 1e6 * np.maximum(closing, 0.0), {"units": "kN"}),
        "penetration": (pairs, np.maximum(closing, 0.0), {"units": "m"}),
    }
    about = {"title": "by hand", "scene": json.dumps(json_data(row))}
    base = assemble(row, [], {"status": np.int8(0), "steps_per_contact": np.float64(9.0)}, about)
    coords = {"time": ("time", time, {"units": "s"}), "pair_gap": ("pair", list(row.gaps), {"units": "m"})}
    return base.assign_coords(coords).assign(arrays)


def trade():
    """Errors that fall with the step and costs that rise."""
    steps = np.array([5e-3, 2e-3, 1e-3])
    coords = {
        "output": ["impact_force_max", "displacement_max"],
        "population": ["all", "steady"],
        "statistic": ["median", "worst"],
        "setting": [f"{scheme}, {1e3 * step:g} ms" for scheme in ("newmark", "rk4") for step in steps],
    }
    names, shape = list(coords), [len(values) for values in coords.values()]
    step = np.tile(steps, 2)
    data = {
        "error": (names, np.broadcast_to((step / 5e-3) ** 2 * 1e-2, shape)),
        "resolution": (names[:3], np.full(shape[:3], 1e-7)),
        "cost": (names[3:], 1e-3 / step),
        "pareto": (names, np.ones(shape, np.int8)),
        "step": (names[3:], step),
    }
    about = {KIND_ATTRIBUTE: KIND, "sample_scenarios": 9, "sensitive_scenarios": 1, "own_setting": "rk4, 1 ms"}
    return xr.Dataset(data, coords, about)


def stability_map():
    """Errors that grow with step and stiffness; the worst corner is refused."""
    error = np.array([[[1e-6, 1e-5, 1e-4], [1e-4, 1e-3, np.nan]]])
    status = np.array([[[0, 0, 0], [0, 2, 4]]], np.int8)
    dims = ("scheme", "stiffness", "dt")
    coords = {"scheme": ["rk4"], "stiffness": ("stiffness", [1e5, 1e6], {"units": "kN m-1"}), "dt": [1e-3, 2e-3, 4e-3]}
    return xr.Dataset({"peak_force_error": (dims, error), "status": (dims, status)}, coords)


def spectra(count=2):
    """Histories and response spectra of pulses, for both figures of records."""
    records = [pulse_record("sine", amplitude=1.0 + i, period=0.5, dt=0.02, name=f"pulse {i}") for i in range(count)]
    return xr.merge([records_dataset(records), response_spectrum(records, [0.1, 0.5, 1.0], 0.05)])


def cyclic_loops():
    """Loops of a storey under a standard protocol."""
    building = Building("a", [100.0], [4e4], yield_strengths=[200.0], hysteresis={"law": "flag", "beta": 0.8})
    return cyclic_test(building, fema_461(0.03))


def pushover_curve():
    """A curve beside its backbone."""
    drift = np.linspace(0.0, 0.05, 51)
    corners = {"corner_drift": ("corner", [0.0, 0.01, 0.05]), "corner_shear": ("corner", [0.0, 100.0, 120.0])}
    return xr.Dataset({"drift": ("point", drift), "shear": ("point", 120.0 * np.tanh(drift / 0.01)), **corners})


def many_laws(**sizes):
    """A cube of more laws, that answer as the first."""
    first = cube(**sizes)
    more = [first.isel(law=[0]).assign_coords(law=[law]) for law in ("hertz", "hertz_damped")]
    return xr.concat([first, *more], "law", combine_attrs="override")


def of_periods(record=1, periods=5):
    """A cube along the period of building a, with what follows from it, and along the gap."""
    factors = np.geomspace(0.5, 2.0, periods)
    made = cube(record=record, stiffness_factor=periods, restitution=1).rename(stiffness_factor="period_factor_a")
    ratio = {"units": "1", "long_name": "period ratio T1/T2 of a and b"}  # falls where the factor rises
    coords = {"period_factor_a": factors, "period_ratio_a_b": ("period_factor_a", 1.7 / factors, ratio)}
    return made.assign_coords(coords)


def suite():
    """A cube of six records under four scales, of which some touch."""
    made = cube(record=6, scale=4, law=1).isel(gap=[0], restitution=[0], storey=[0])
    made = made.assign_coords(record_pga=("record", np.ones(6)))  # scales 0.5 to 2
    closes_at = xr.DataArray([0.4, 0.6, 0.9, 1.2, 1.4, 1.7], dims="record")
    return made.assign(impact_count=(made["impact_count"] > 0) & (made["scale"] > closes_at))


def reported():
    """Histories between whose instants peaks are higher."""
    one = histories()
    top, low = 1.1 * one.displacement.max("time"), 1.05 * one.displacement.min("time")
    peaks = {"impact_force_max": 1.2 * one.contact_force.max("time"), "displacement_max": top, "displacement_min": low}
    return one.assign(peaks)


MAKERS = {
    "cube": partial(cube, right_wall=True, record=4, scale=5),
    "design": partial(design, 64),
    "histories": histories,
    "trade": trade,
    "map": stability_map,
    "pushover": pushover_curve,
    "spectra": spectra,
    "test": cyclic_loops,
}
#: Further figures whose numbers are compared: figure, dataset, options.
CASES = {
    "amplification along storeys": ("amplification", lambda: cube(gap=1, restitution=1), {}),
    "closing beside walls": ("closing", partial(histories, True, True), {"end": 1.0}),
    "fragility of a suite": ("fragility", suite, {}),
    "incremental in both directions": (
        "incremental",
        lambda: cube(record=2, scale=3).assign_coords(scale=[-1.0, 1.0, 2.0]),
        {},
    ),
    "incremental of one record": ("incremental", partial(cube, scale=4), {}),
    "histories with peaks": ("histories", reported, {}),
    "law-comparison along the gap": ("law-comparison", cube, {"x": "gap"}),
    "map of an amplification": ("map", of_periods, {"value": "drift_max_ratio", "x": "gap"}),
    "map of status": ("map", of_periods, {"value": "status"}),
    "profiles of many laws": ("profiles", many_laws, {}),
    "response-spectra of many": ("response-spectra", partial(spectra, 10), {}),
    "sensitivity of drifts": ("sensitivity", partial(design, 64), {"value": "drift_max"}),
}
GOLDEN = Path(__file__).parent / "golden" / "figures.json"


def summary(figure):
    """What a figure shows: per panel its texts, and means of the coordinates of its lines, cells and bars."""

    def means(*parts):
        return [float(f"{np.nanmean(part):.5g}") for part in parts if np.isfinite(np.asarray(part, float)).any()]

    panels = []
    for ax in figure.axes:
        lines = [means(*line.get_data()) for line in ax.lines]
        cells = [means(item.get_array()) for item in ax.collections if item.get_array() is not None]
        areas = [means(*path.vertices.T) for item in ax.collections for path in item.get_paths()[:9]]
        bars = [means([bar.get_y()], [bar.get_height()]) for bar in ax.patches]
        marks = [means(*np.transpose(item.get_offsets())) for item in ax.collections if len(item.get_offsets()) > 1]
        legend = ax.get_legend_handles_labels()[1]
        numbers = sorted(filter(None, (*lines, *cells, *areas, *bars, *marks)))
        panels.append([ax.get_title(), ax.get_xlabel(), ax.get_ylabel(), legend, numbers])
    return {"title": figure.get_suptitle(), "caption": [*getattr(figure, "caption", [])], "panels": panels}


def cases(figures):
    """Every figure, drawn of its source, and `CASES`: figure, dataset, options."""
    return {key: (key, MAKERS[kind.source], {}) for key, kind in figures.items()} | CASES


if __name__ == "__main__":
    from pounding_sweep.figures import FIGURES

    drawn = {name: FIGURES[key].draw(make(), **more) for name, (key, make, more) in cases(FIGURES).items()}
    lines = [f"{json.dumps(name)}: {json.dumps(summary(figure))}" for name, figure in drawn.items()]
    GOLDEN.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")

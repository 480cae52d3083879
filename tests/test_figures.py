"""Figures: every one of the registry drawn, what their lines show, the row in motion, and the commands for them."""

from __future__ import annotations

import io
import re

import figure_data as made
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from PIL import Image
from typer.testing import CliRunner

import pounding_sweep as ps
from pounding_sweep.analysis import COMPARISONS, amplification, response_spectrum, sensitivity
from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.cli.app import app
from pounding_sweep.figures import CONTACT, FIGURES, NO_CONTACT, SOURCES, plot, require
from pounding_sweep.figures.animation import PERIODS, WATCHED, _Picture, animate
from pounding_sweep.figures.gallery.row import Stage, _round_down, strongest
from pounding_sweep.figures.shown import heading, middle, shows_values
from pounding_sweep.figures.sides import logarithmic
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.output.select import select
from pounding_sweep.outputs.variables import INNER_DIMS, Status
from pounding_sweep.plan.scenarios import case_variants
from pounding_sweep.records import records_dataset
from pounding_sweep.run.one_scenario import scenario_of, simulate_one, simulate_shown
from pounding_sweep.run.simulate import peaks_shown
from pounding_sweep.spec.axes import Case
from pounding_sweep.spec.build import build_spec

#: Words of labels that have no unit.
NO_UNIT = re.compile(r"impacts|error|probability|restitution|ratio|factor|share|pounding over|storey|law|input")


def spectra():
    """Histories and response spectra of two pulses, for both figures of records."""
    records = [ps.pulse_record("sine", amplitude=a, period=0.5, dt=0.02, name=f"pulse {a:g}") for a in (1.0, 2.0)]
    return xr.merge([records_dataset(records), response_spectrum(records, [0.1, 0.5, 1.0], 0.05)])


def _numbers(ticks):
    """Whether tick labels are numbers, which need a name, and not names themselves, or none."""
    texts = [tick.get_text() for tick in ticks if tick.get_text()]
    return bool(texts) and all(re.match(r"[−-]?[\d.]|\$", text) for text in texts)


MAKERS = {
    "cube": lambda: made.cube(record=4, scale=5),
    "design": made.design,
    "histories": made.histories,
    "trade": made.trade,
    "map": made.stability_map,
    "spectra": spectra,
}


# -- the registry ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", FIGURES)
def test_every_figure_is_drawn_with_labelled_axes(key):
    kind = FIGURES[key]
    assert kind.source in SOURCES
    figure = kind.draw(MAKERS[kind.source]())
    shown = [ax for ax in figure.axes if ax.get_visible()]
    assert shows_values(figure)
    labels = [text for ax in shown for text in (ax.get_xlabel(), ax.get_ylabel()) if text]
    assert any(ax.get_xlabel() or not _numbers(ax.get_xticklabels()) for ax in shown)
    assert any(ax.get_ylabel() for ax in shown)
    for label in labels:
        assert re.search(r"\([^()]+\)", label) or NO_UNIT.search(label), label


@pytest.mark.slow
@pytest.mark.parametrize("key", FIGURES)
def test_every_figure_finds_its_layout_and_is_saved(key, tmp_path):
    FIGURES[key].draw(MAKERS[FIGURES[key].source]()).savefig(tmp_path / "figure.png", dpi=20)
    with Image.open(tmp_path / "figure.png") as picture:
        assert min(picture.size) > 20


@pytest.mark.parametrize("key", FIGURES)
def test_a_dataset_that_lacks_something_is_refused_in_words(key):
    kind = FIGURES[key]
    with pytest.raises(InputError, match=re.escape(SOURCES[kind.source])) as error:
        require(xr.Dataset(), key)
    for need in {*kind.needs, *kind.several} - {CONTACT, *(need for need in kind.needs if need.startswith(NO_CONTACT))}:
        assert need.split("|")[0] in str(error.value)


def test_one_of_several_names_is_enough():
    cube = made.cube()
    assert FIGURES["profiles"].lacks(cube.drop_vars(["displacement_max", "drift_max", "acceleration_max"])) == ()
    none = cube.drop_vars([n for n in cube.data_vars if n not in ("status", "impact_count")])
    assert FIGURES["profiles"].lacks(none)[0].startswith("displacement_max or ")


def test_comparisons_need_something_to_compare():
    for key, sizes, words in (
        ("law-comparison", {"law": 3}, "several laws with contact"),
        ("incremental", {"scale": 3}, "several scales or PGAs or spectral accelerations"),
        ("fragility", {"record": 3}, "several records or scales or PGAs or spectral accelerations"),
        ("fragility", {"scale": 3}, "several records or scales or PGAs or spectral accelerations"),
    ):
        assert FIGURES[key].lacks(made.cube(**sizes)) == ()
        assert words in FIGURES[key].lacks(made.cube(**dict.fromkeys(sizes, 1)))
    contact = made.cube().sel(law=["linear", "none"])  # no pounding is no law to compare with
    assert FIGURES["law-comparison"].lacks(contact) == ("several laws with contact",)


def parts_by_contact():
    """A cube of laws with contact alone, and one of the runs without pounding; and what each of them has not."""
    whole = made.cube(scale=2, restitution=1, gap=2)
    none = (whole["law"] == "none").values
    return (whole.isel(law=~none), NO_CONTACT), (whole.isel(law=none), CONTACT)


@pytest.mark.slow
@pytest.mark.parametrize(
    "key", [key for key, kind in FIGURES.items() if kind.source == "cube" and key != "required-gap"]
)
def test_what_laws_do_not_lack_can_be_drawn(key):
    for cube, _ in parts_by_contact():
        if not FIGURES[key].lacks(cube):
            assert shows_values(FIGURES[key].draw(cube))


def test_laws_that_a_figure_needs():
    """Of laws with contact, and of the runs without pounding."""
    whole = made.cube(scale=2, restitution=1, gap=2)
    none = (whole["law"] == "none").values
    for cube, needs in parts_by_contact():
        assert any(needs in lacking for lacking in FIGURES["amplification"].lacks(cube))
    assert shows_values(FIGURES["law-comparison"].draw(whole.isel(law=~none)))
    assert shows_values(FIGURES["profiles"].draw(whole.isel(law=none)))
    assert FIGURES["amplification"].lacks(amplification(whole)) == ()
    assert CONTACT in FIGURES["fragility"].lacks(whole.isel(law=none))
    drawn = FIGURES["incremental"].draw(whole.sel(law=["none"]))
    assert "drift" in drawn.axes[0].get_ylabel() + str(drawn.get_supylabel())


@pytest.mark.parametrize(
    "key",
    [
        key if key == "required-gap" else pytest.param(key, marks=pytest.mark.slow)
        for key, item in COMPARISONS.items()
        if item.figure
    ],
)
def test_figures_of_comparisons_take_a_cube_or_what_was_made_of_it(key):
    design = FIGURES[COMPARISONS[key].figure].source == "design"
    cube = made.design() if design else made.cube(right_wall=True, record=3, scale=3)
    result = COMPARISONS[key].make(cube)
    one, other = (FIGURES[COMPARISONS[key].figure].draw(given) for given in (cube, result))
    assert shows_values(other)
    for ax, same in zip(one.axes, other.axes, strict=True):
        assert ax.get_title() == same.get_title()
        for line, its in zip(ax.lines, same.lines, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), its.get_ydata())
    if key == "required-gap":
        bars = [patch.get_height() for patch in other.axes[0].patches]
        np.testing.assert_allclose(sorted(bars), np.sort(1e3 * result.exact.sel(pair="a-b", scale=1.0)))


@pytest.mark.parametrize(("scales", "sizes"), [([-2.0, -1.0, 1.0, 2.0], [2, 2]), ([-1.0, 1.0, 2.0], [1, 2])])
def test_both_directions_of_a_record_are_lines_of_their_own(scales, sizes):
    cube = made.cube(record=2, scale=len(scales)).assign_coords(scale=scales)
    lines = FIGURES["incremental"].draw(cube).axes[0].lines
    grey = [line for line in lines if line.get_color() == "0.7"]
    assert sorted(len(line.get_xdata()) for line in grey) == sorted(2 * sizes)
    assert all(line.get_marker() == "." for line in grey if len(line.get_xdata()) == 1)
    assert [line.get_label() for line in lines].count("record") == 1


@pytest.mark.parametrize("suffix", ["svg", pytest.param("pdf", marks=pytest.mark.slow)])  # PNG: see below
def test_files_of_every_kind(suffix, tmp_path):
    path = plot(made.cube(), "force-gap", tmp_path / f"x.{suffix}")
    start = {"svg": b"<?xml", "pdf": b"%PDF"}[suffix]
    assert path.read_bytes().startswith(start)


def test_what_cannot_be_written_is_said(tmp_path):
    with pytest.raises(OutputError, match=r"ending in \.png"):
        plot(made.cube(), "force-gap", tmp_path / "x.xyz")
    with pytest.raises(InputError, match="did you mean 'profiles'"):
        plot(made.cube(), "profile", tmp_path / "x.png")


# -- what lines show ---------------------------------------------------------------------------------------------------


def test_force_gap_shows_the_largest_of_all_storeys():
    cube = made.cube(restitution=3)
    figure = FIGURES["force-gap"].draw(cube.isel(gap=[2, 0, 3, 1]))
    force, count = figure.axes
    for ax, name in ((force, "impact_force_max"), (count, "impact_count")):
        assert [line.get_label() for line in ax.lines] == [LAWS["linear"].title, LAWS["kelvin_voigt"].title]
        for line, law in zip(ax.lines, cube.law.values, strict=False):
            want = [np.nanmax(cube[name].sel(law=law, gap=gap, restitution=0.6).values) for gap in cube.gap.values]
            np.testing.assert_allclose(line.get_xdata(), cube.gap.values * 1e3)
            np.testing.assert_allclose(line.get_ydata(), want)


@pytest.mark.parametrize(
    "key",
    [
        key if key in ("force-gap", "profiles", "fragility") else pytest.param(key, marks=pytest.mark.slow)
        for key, kind in FIGURES.items()
        if kind.source == "cube"
    ],
)
def test_panels_show_all_of_their_lines(key):
    """Panels share axes, and the values of the last one are the largest."""
    cube = made.cube(right_wall=True, gap=2, restitution=1, record=2, scale=3)
    for dim in ("pair", "building"):
        growing = xr.DataArray(10.0 ** np.arange(cube.sizes[dim]), dims=dim)
        cube = cube.assign({name: v * growing for name, v in cube.data_vars.items() if dim in v.dims})
    seen = 0
    for ax in FIGURES[key].draw(cube).axes:
        for line in (line for line in ax.lines if line.get_transform() is ax.transData):
            for values, (low, high) in ((line.get_xdata(), ax.get_xlim()), (line.get_ydata(), ax.get_ylim())):
                there = np.asarray(values, float)[np.isfinite(values)]
                seen += there.size
                assert ((low <= there) & (there <= high)).all(), (ax.get_title(), line.get_label())
    assert seen or key in ("energy-budget", "map")  # of bars, of cells


def test_sensitivity_shows_indices_and_intervals():
    """Of drifts the scale decides alone: it stands at the top, with an index of 1; a panel for each law."""
    cube = made.design(64)
    figure = FIGURES["sensitivity"].draw(cube, value="drift_max")
    axes = np.reshape(figure.axes, (2, 2))
    assert [ax.get_title() for ax in axes[:, 0]] == [
        f"building a; storey 3\n{LAWS[law].title}" for law in made.LAWS[:2]
    ]
    assert [ax.get_title().split("\n")[0] for ax in axes[0]] == ["building a; storey 3", "building b; storey 2"]
    assert [tick.get_text() for tick in axes[0, 0].get_yticklabels()] == ["gap", "scale"]
    result = sensitivity(cube)
    for ax, group in ((axes[0, 1], 0), (axes[1, 1], 1)):
        own = result.isel(group=group).sel(building="b", storey=2)
        for line, bars, name in zip(ax.lines, ax.collections, ("drift_max_first", "drift_max_total"), strict=False):
            np.testing.assert_array_equal(line.get_xdata(), own[name])
            ends = [path.vertices[:, 0] for path in bars.get_paths()]
            np.testing.assert_array_equal(ends, own[f"{name}_interval"].transpose("input", "bound"))
    assert axes[0, 0].lines[1].get_xdata() == pytest.approx([0.0, 1.0], abs=0.1)
    low, high = axes[0, 0].get_xlim()
    assert (
        low < float(result["drift_max_first_interval"].min()) < float(result["drift_max_total_interval"].max()) < high
    )
    force = FIGURES["sensitivity"].draw(select(cube, {"law": "linear"}))
    assert [ax.get_title() for ax in force.axes] == ["pair a-b; storey 2"]
    with pytest.raises(InputError, match='needs a design of kind "saltelli"'):
        FIGURES["sensitivity"].draw(made.cube())


def test_fragility_shows_trials_that_the_first_pair_has_not():
    cube = made.cube(right_wall=True, record=4, scale=5)
    weak = (cube["pair"] != "a-b") | (cube["scale"] < 1.0)
    cube = cube.assign(impact_count=cube["impact_count"].where(weak))
    first, second = FIGURES["fragility"].draw(cube).axes
    farthest = [max(np.max(line.get_xdata(), initial=0.0) for line in ax.lines) for ax in (first, second)]
    assert farthest[0] < farthest[1] < second.get_xlim()[1]


def test_the_map_shows_medians_over_records_and_where_nothing_touches():
    cube = made.cube(record=3, stiffness_factor=3).sel(law=["none", "linear"], gap=[0.004, 0.002, 0.008])
    touches = (cube["gap"] > 0.002).astype(float)
    cube = cube.assign(impact_force_max=cube["impact_force_max"] * touches)
    (ax, _) = FIGURES["map"].draw(cube).axes
    free, peaks = (np.ma.filled(mesh.get_array(), np.nan) for mesh in ax.collections)
    want = cube["impact_force_max"].sel(law="linear", pair="a-b", restitution=0.4).max("storey").median("record")
    want = want.squeeze().sortby("gap").transpose("stiffness_factor", "gap").values
    np.testing.assert_allclose(peaks, np.where(want > 0.0, want, np.nan))
    np.testing.assert_array_equal(np.isfinite(free), want == 0.0)
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["2", "4", "8"]
    assert [tick.get_text() for tick in ax.get_yticklabels()] == ["1", "2", "4"]
    assert ax.get_yscale() == "log"  # 1, 2, 4
    assert ax.get_title() == "Linear spring\npair a-b"
    (lacking,) = FIGURES["map"].lacks(cube.isel(gap=[0], restitution=0))
    assert lacking.startswith("two axes of several numbers")


def test_the_map_tells_no_contact_from_contact_under_few_records():
    cube = made.cube(record=3, stiffness_factor=3).sel(law=["linear"])
    cube = cube.assign(impact_force_max=cube["impact_force_max"].where(cube["record"] == cube["record"][0], 0.0))
    cube = cube.assign(impact_force_max=cube["impact_force_max"].where(cube["gap"] > 0.002, 0.0))
    figure = FIGURES["map"].draw(cube)
    free, peaks = (np.ma.filled(mesh.get_array(), np.nan) for mesh in figure.axes[0].collections)
    assert np.isnan(peaks).all()  # the median over records is 0 everywhere
    assert (free[:, 0] == 1.8).all()  # nothing touches under any record
    assert free[:, 1:] == pytest.approx(0.9 - 1 / 3)
    assert {text.get_text() for text in figure.axes[0].texts} == {"33%"}
    assert "light grey: the share of records that touch" in figure.get_suptitle().replace("\n", " ")


@pytest.mark.parametrize("value", ["status", "steps_per_contact"])
def test_the_map_of_what_a_scenario_has_one_value_of_has_one_column(value):
    cube = made.cube(record=3, stiffness_factor=3).sel(law=["linear"])
    scenario = cube["impact_force_max"].isel(pair=0, storey=0, drop=True)
    codes = xr.where(cube["gap"] > 0.002, int(Status.DIVERGED), int(Status.OK)).broadcast_like(scenario)
    cube = cube.assign(status=codes.astype("int8"), steps_per_contact=scenario)
    ax, bar = FIGURES["map"].draw(cube, value=value).axes
    if value == "status":
        assert [tick.get_text() for tick in bar.get_yticklabels()] == ["ok", "diverged"]
        np.testing.assert_array_equal(ax.collections[1].get_array()[0], [0, 1, 1, 1])


def test_force_gap_of_one_gap_and_of_a_scalar_law():
    cube = made.cube(gap=1, restitution=1).sel(law="linear")
    (force, _) = FIGURES["force-gap"].draw(cube).axes
    assert [line.get_label() for line in force.lines] == ["Linear spring"]
    assert force.lines[0].get_ydata() == pytest.approx([float(cube.impact_force_max.max())])


def test_profiles_show_floors_and_storeys():
    cube = made.cube(gap=1, restitution=1)
    axes = np.array(FIGURES["profiles"].draw(cube).axes).reshape(4, 2)
    flat = cube.squeeze()
    for column, (building, floors) in enumerate((("a", 3), ("b", 2))):
        here = flat.sel(building=building, law="kelvin_voigt").isel(storey=slice(floors))
        displacement = axes[0, column].lines[2]
        np.testing.assert_allclose(displacement.get_xdata(), [0.0, *(1e3 * here.displacement_max.values)])
        np.testing.assert_allclose(displacement.get_ydata(), [0.0, *here.floor_elevation.values])
        drift = axes[1, column].lines[1]
        np.testing.assert_allclose(drift.get_xdata(), np.repeat(1e3 * here.drift_max.values, 3))
        np.testing.assert_allclose(drift.get_ydata()[drift.get_markevery()], [1.5, 4.5, 7.5][:floors])
        acceleration = axes[3, column].lines[1]
        np.testing.assert_allclose(acceleration.get_xdata(), here.acceleration_max.values)


def test_histories_show_floors_and_forces():
    one = made.histories()
    ground, top, force = FIGURES["histories"].draw(one).axes
    np.testing.assert_allclose(ground.lines[0].get_ydata(), one.ground_acceleration)
    np.testing.assert_allclose(top.lines[1].get_ydata(), 1e3 * one.displacement.sel(building="b", storey=2))
    assert [line.get_label() for line in force.lines] == ["storey 1", "storey 2"]
    np.testing.assert_allclose(force.lines[1].get_ydata(), one.contact_force.sel(pair="a-b", storey=2))
    apart = FIGURES["histories"].draw(made.histories(touch=False)).axes[2]
    assert not apart.lines
    assert apart.texts[0].get_text() == "no contact"


def test_histories_mark_the_peaks_that_are_reported():
    """Between the instants of histories a peak may be higher than they show."""
    one = made.histories()
    force = 1.2 * one.contact_force.max("time")
    top, low = 1.1 * one.displacement.max("time"), 1.05 * one.displacement.min("time")
    one = one.assign(impact_force_max=force, displacement_max=top, displacement_min=low)
    _, floors, contact = FIGURES["histories"].draw(one).axes
    marks = [(line.get_xdata()[0], line.get_ydata()[0]) for line in contact.lines if line.get_marker() == "o"]
    at = [float(one.contact_force.sel(pair="a-b", storey=s).idxmax("time")) for s in (1, 2)]
    np.testing.assert_allclose(marks, list(zip(at, force.sel(pair="a-b").values[:2], strict=True)))
    assert max(height for _, height in marks) < contact.get_ylim()[1]
    heights = sorted(float(line.get_ydata()[0]) for line in floors.lines if line.get_marker() == "o")
    ends = [1e3 * values.sel(building=b, storey=s).item() for b, s in (("a", 3), ("b", 2)) for values in (top, low)]
    np.testing.assert_allclose(heights, sorted(ends))
    later = FIGURES["histories"].draw(one, start=1.0, end=1.5)  # after the peaks
    assert not [line for ax in later.axes for line in ax.lines if line.get_marker() == "o"]
    assert later.axes[-1].get_xlim() == (1.0, 1.5)


def test_floors_touch_where_their_relative_displacement_reaches_the_gap():
    one = made.histories(left_wall=True)
    wall, pair = FIGURES["closing"].draw(one, end=1.0).axes
    part = one.sel(time=slice(0.0, 1.0))
    np.testing.assert_allclose(wall.lines[2].get_ydata(), -1e3 * part.displacement.sel(building="a", storey=3))
    relative = part.displacement.sel(building="a", storey=2) - part.displacement.sel(building="b", storey=2)
    np.testing.assert_allclose(pair.lines[1].get_ydata(), 1e3 * relative)
    for ax, name in ((wall, "w1-a"), (pair, "a-b")):
        gap = next(line for line in ax.lines if line.get_label() == "gap").get_ydata()[0]
        assert gap == pytest.approx(1e3 * float(one.pair_gap.sel(pair=name)))
        highest = max(np.max(line.get_ydata()) for line in ax.lines)
        touched = bool((part.contact_force.sel(pair=name) > 0).any())
        assert (highest > gap) == touched
        marks = sorted(t for line in ax.lines if line.get_marker() == "o" for t in line.get_xdata())
        deep = part.penetration.sel(pair=name).fillna(0.0).transpose("time", "storey").values > 0.0
        assert marks == sorted(np.repeat(part.time.values[1:, None], deep.shape[1], axis=1)[deep[1:] & ~deep[:-1]])


def test_loops_of_a_contact_hold_what_it_took():
    """Of a law that gives back all, loops have no area; of one that keeps half of its force, half of the work."""
    one = made.histories()
    elastic = FIGURES["force-penetration"].draw(one).axes[0]
    for line in elastic.lines:
        depth, force = (values[np.isfinite(values)] for values in line.get_data())
        np.testing.assert_allclose(force, 1e3 * depth)
        assert depth.min() == 0.0  # each loop begins and ends open
    opening = one.penetration.differentiate("time") < 0
    lossy = one.assign(contact_force=one.contact_force.where(~opening, 0.5 * one.contact_force))
    top = FIGURES["force-penetration"].draw(lossy).axes[0].lines[1]
    depth, force = (np.nan_to_num(values) for values in top.get_data())
    work = np.trapezoid(force, 1e-3 * depth)
    put_in = sum(np.maximum(np.diff(0.5e6 * one.penetration.sel(storey=2).values[:, 0] ** 2), 0.0))
    assert work == pytest.approx(0.5 * put_in, rel=0.05)
    assert FIGURES["force-penetration"].draw(made.histories(touch=False)).axes[0].texts[0].get_text() == "no contact"


def test_phase_plots_tell_contact_from_flight():
    one = made.histories()
    a, b = FIGURES["phase"].draw(one).axes
    for ax, building, storey in ((a, "a", 3), (b, "b", 2)):
        apart, near = ax.lines
        here = one.sel(building=building, storey=storey)
        np.testing.assert_allclose(apart.get_xdata(), 1e3 * here.displacement)
        np.testing.assert_allclose(apart.get_ydata(), here.velocity)
        touching = (one.contact_force.sel(pair="a-b") > 0).any("storey").values
        np.testing.assert_array_equal(np.isfinite(near.get_xdata()), touching)


@pytest.mark.parametrize("key", ["histories", "closing", "force-penetration", "phase"])
def test_a_part_of_the_record_is_drawn(key):
    one = made.histories()
    figure = FIGURES[key].draw(one, start=0.2, end=0.6)
    assert shows_values(figure)
    for start, end in ((3.0, None), (0.5, 0.4), (None, -1.0), (0.5, 0.5)):
        with pytest.raises(InputError, match=r"fewer than two instants.*they run from 0 s to 2 s"):
            FIGURES[key].draw(one, start=start, end=end)


@pytest.mark.parametrize(
    "key",
    [
        "force-gap",
        *(
            pytest.param(key, marks=pytest.mark.slow)
            for key in ("amplification", "law-comparison", "incremental", "required-gap")
        ),
    ],
)
def test_legends_stand_inside_their_figures(key):
    """Of one pair or building, with long names of laws."""
    cube = made.cube(scale=3).assign_coords(law=["nonlinear_viscoelastic", "modified_kelvin_voigt", "none"])
    figure = FIGURES[key].draw(cube.sel(building=["a"]) if key == "amplification" else cube)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    inside, whole = legend.get_window_extent(), figure.bbox
    assert whole.x0 <= inside.x0 <= inside.x1 <= whole.x1
    assert whole.y0 <= inside.y0 <= inside.y1 <= whole.y1


def test_energies_end_below_the_frame():
    figure = FIGURES["energy-budget"].draw(made.cube())
    for ax in figure.axes[:-1]:
        low, high = ax.get_ylim()
        tops = [bar.get_y() + max(bar.get_height(), 0.0) for bar in ax.patches]
        bottoms = [bar.get_y() + min(bar.get_height(), 0.0) for bar in ax.patches]
        assert max(tops) < high
        assert min(bottoms) > low


def test_the_middle_of_the_other_axes():
    cube = made.cube(restitution=3, record=3, scale=2)
    found, shown = middle(cube, ("law", "gap"))
    xr.testing.assert_identical(found, cube.isel(stiffness_factor=0, restitution=1, record=1, scale=0))
    assert shown == "restitution 0.6 (one of 3); record r2 (one of 3); scale 0.5 (one of 2)"
    chosen = cube.isel(gap=2, scale=1, storey=1).squeeze("stiffness_factor")
    told = "gap 6 mm; stiffness factor 1; restitution 0.6 (one of 3); record r2 (one of 3); scale 1; storey 2"
    assert middle(chosen, ("law",))[1] == told


def test_listed_cases_are_drawn_one_by_one():
    cube = made.cube(law=1, gap=1, restitution=1).squeeze(drop=True)
    cases = xr.concat([cube, cube], "case").assign_coords(case=[1, 2], law=("case", ["linear", "hertz"]))
    with pytest.raises(InputError, match="--at case=N"):
        FIGURES["profiles"].draw(cases)
    figure = FIGURES["profiles"].draw(select(cases, {"case": 2}))
    assert {line.get_label() for line in figure.axes[2].lines} == {"Hertz"}
    assert figure.get_suptitle() == "case 2"


# -- axes that are chosen ----------------------------------------------------------------------------------------------


def of_periods(record=1, periods=5):
    """A cube along the period of building a, with what follows from it, and along the gap."""
    cube = made.cube(record=record, stiffness_factor=periods, restitution=1)
    cube = cube.rename(stiffness_factor="period_factor_a").assign_coords(
        period_factor_a=np.geomspace(0.5, 2.0, periods)
    )
    ratio = {"units": "1", "long_name": "period ratio T1/T2 of a and b"}
    follows = 1.7 / cube["period_factor_a"].values[::-1]
    return cube.assign_coords(
        period_ratio_a_b=("period_factor_a", follows[::-1], ratio)
    )  # falls where the factor rises


def test_a_map_over_period_ratio_and_gap():
    cube = of_periods()
    ax, below, _ = FIGURES["map"].draw(cube).axes
    assert below.get_xlabel() == "period ratio T1/T2 of a and b (-)"
    assert ax.get_ylabel() == "gap (mm)"
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "linear")
    want = cube["impact_force_max"].isel(law=0).max("storey").squeeze().transpose("gap", "period_factor_a")
    np.testing.assert_allclose(ax.collections[-1].get_array(), want.values[:, ::-1])
    swapped = FIGURES["map"].draw(cube.sel(law=["linear"]), x="gap", y="period_factor_a").axes[0]
    assert swapped.get_xlabel() == "gap (mm)"
    np.testing.assert_allclose(swapped.collections[-1].get_array(), want.values.T)


def test_a_map_of_an_amplification():
    cube = of_periods()
    touches = (cube["gap"] > 0.002) & (cube["law"] != "none")
    cube["impact_count"] = cube["impact_count"].where(touches, 0)
    figure = FIGURES["map"].draw(cube, value="drift_max_ratio", x="gap", contours=True)
    drift = cube["drift_max"]
    ratio = (drift.sel(law="linear") / drift.sel(law="none")).max("storey").squeeze()
    want = ratio.sel(building="b").sortby("period_ratio_a_b").transpose("period_factor_a", "gap").values
    meshes = [each for each in figure.axes[1].collections if isinstance(each, QuadMesh)]
    grey, drawn = (np.ma.filled(mesh.get_array(), np.nan) for mesh in meshes)
    np.testing.assert_allclose(drawn[:, 1:], want[:, 1:])
    assert np.isnan(drawn[:, 0]).all()
    assert (np.isfinite(grey) == np.isnan(drawn)).all()
    low, high = meshes[1].norm.vmin, meshes[1].norm.vmax
    assert low * high == pytest.approx(1.0)  # no change has the colour in the middle
    assert figure.axes[0].get_title() == "Linear spring\nbuilding a"
    assert figure.axes[-1].get_ylabel() == "amplification of the largest interstorey drift (-)"


@pytest.mark.parametrize(
    "key", ["force-gap", *(pytest.param(key, marks=pytest.mark.slow) for key in ("amplification", "law-comparison"))]
)
def test_any_axis_of_numbers_may_be_drawn_along(key):
    cube = of_periods(record=2)
    for x, label, scale in (
        ("period_ratio", "period ratio T1/T2 of a and b (-)", "log"),
        ("gap", "gap (mm)", "linear"),
    ):
        (ax, *others) = FIGURES[key].draw(cube, x=x).axes
        assert [each.get_xscale() for each in (ax, *others)] == [scale] * (1 + len(others))
        assert label in [each.get_xlabel() for each in (ax, *others)]
        values = ax.lines[-1].get_xdata()
        assert len(values) == {"gap": 4}.get(x, 5)
        assert (np.diff(values) > 0).all()


def test_axes_that_cannot_be_drawn_along():
    cube = of_periods()
    for key, options, text in (
        ("map", {"x": "gpa"}, "did you mean 'gap'"),
        ("map", {"x": "gap", "y": "gap"}, "are the same, gap"),
        ("map", {"x": "record"}, "unknown axis to draw along 'record'; valid: gap, period_factor_a, period_ratio_a_b"),
        ("map", {"value": "impact_forces"}, "did you mean 'impact_force_max'"),
        ("force-gap", {"value": "drift_max"}, "valid: impact_count, impact_force_max"),
        ("amplification", {"value": "impulse_ratio"}, "unknown value to draw"),
        ("profiles", {"value": "impulse"}, "unknown value to draw"),
    ):
        with pytest.raises(InputError, match=text):
            FIGURES[key].draw(cube, **options)
    both = cube.assign_coords(period_ratio_a_b=(("period_factor_a", "gap"), np.ones((5, 4))))
    with pytest.raises(InputError, match="varies with period_factor_a and gap; choose one value of all but one"):
        FIGURES["map"].draw(both, x="period_ratio_a_b", y="gap")
    with pytest.raises(InputError, match=r"'force-gap' takes no y; map do"):
        plot(cube, "force-gap", "x.png", y="gap")


def test_when_an_axis_is_logarithmic():
    for values, log in (
        ([1.0, 2.0, 4.0], True),
        ([0.1, 0.3, 1.0, 3.0, 10.0], True),
        ([0.4, 0.5, 0.6, 0.8], False),  # a narrow range
        ([2.0, 4.0, 6.0, 8.0], False),
        ([0.0, 1.0, 2.0, 4.0], False),
        ([1.0, 10.0], False),
    ):
        assert logarithmic(np.array(values)) == log


def test_axes_of_a_figure_of_ones_own():
    cube = of_periods().sel(law=["linear", "none"])
    for key, options in (
        ("map", {}),
        ("map", {"value": "storey_shear_max_ratio"}),
        ("force-gap", {"value": "impact_force_max"}),
        ("amplification", {"value": "drift_max_ratio"}),
    ):
        own = Figure()
        ax = own.subplots(1, 2)[1]
        one = cube.sel(building="b") if options.get("value", "").endswith("ratio") else cube
        assert FIGURES[key].draw(one, ax=ax, **options) is own
        assert shows_values(own)
        assert not own.get_suptitle()
        assert "gap" in ax.get_title() + ax.get_ylabel() + ax.get_xlabel()
    ax = Figure().subplots()
    assert FIGURES["row"].draw(made.histories(), ax=ax) is ax.figure
    assert "displacements and gaps drawn" in ax.get_title()
    for key in ("closing", "force-penetration"):
        ax = Figure().subplots()
        assert FIGURES[key].draw(made.histories(), ax=ax) is ax.figure
        assert shows_values(ax.figure)
    with pytest.raises(InputError, match="2 x 1 panels, and axes for one are given"):
        FIGURES["force-gap"].draw(cube, ax=ax)


def test_notebooks_show_figures():
    picture = FIGURES["row"].draw(made.histories())._repr_png_()
    with Image.open(io.BytesIO(picture)) as found:
        assert found.format == "PNG"
        assert min(found.size) > 200


def test_a_part_of_the_row_that_was_selected():
    """By xarray itself, which takes the dimension away: titles of panels, or else of the figure, tell it."""
    cube = made.cube(right_wall=True, restitution=1)
    figure = FIGURES["force-gap"].draw(cube.sel(pair="a-b", storey=2))
    assert figure.axes[0].get_title() == "pair a-b"
    want = cube["impact_force_max"].sel(pair="a-b", storey=2, law="linear").squeeze()
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), want)
    assert FIGURES["profiles"].draw(cube.sel(building="b")).axes[0].get_title() == "building b"


def test_of_many_laws_each_has_its_panels():
    cube = made.cube()
    more = [cube.isel(law=[0]).assign_coords(law=[law]) for law in ("hertz", "hertz_damped")]
    cube = xr.concat([cube, *more], "law", combine_attrs="override").isel(gap=0, restitution=0, storey=slice(0, 2))
    axes = np.array(FIGURES["profiles"].draw(cube, value="storey_shear_max").axes).reshape(4, 2)
    for row, law in zip(axes, ("linear", "kelvin_voigt", "hertz", "hertz_damped"), strict=True):
        *others, still, own = row[1].lines
        assert len(others) == 3
        for line, its in ((own, law), (still, "none")):
            want = cube["storey_shear_max"].sel(building="b", law=its).squeeze().values
            np.testing.assert_allclose(line.get_xdata(), np.repeat(want, 3))
    assert axes[-1, 0].get_xlabel() == "storey shear (kN)"


# -- the row -----------------------------------------------------------------------------------------------------------

ENDS = [(False, False), (True, False), (False, True), (True, True)]


def walls(one):
    row = stored_scene(one).row
    return isinstance(row[0], ps.Wall), isinstance(row[-1], ps.Wall)


@pytest.mark.parametrize("ends", ENDS)
def test_walls_are_found(ends):
    assert walls(made.histories(*ends)) == ends
    names = ("wall-west", "wall", "wall-b", "wall-wall")  # whose pairs' names begin and end alike
    assert walls(made.histories(*ends, names=names)) == ends


def test_a_row_that_is_not_told_is_asked_for():
    one = made.histories()
    for changed in ({}, {"scene": "["}, {"scene": '{"row": []}'}, {"scene": '{"row": [1], "gaps": [], "contact": {}}'}):
        with pytest.raises(InputError, match=r"does not carry its row of buildings.*simulate the scenario again"):
            walls(one.drop_attrs().assign_attrs(changed))


@pytest.mark.parametrize("ends", ENDS)
def test_floors_overlap_in_the_drawing_as_far_as_they_penetrate(ends):
    """Faces of neighbours are as far apart as gap and displacements make them, times the factor."""
    one = made.histories(*ends)
    stage = Stage(one)
    ax = stage.figure()[1]
    stage.draw(ax)
    row = made.scene(*ends)
    first = 1 if ends[0] else 0
    for number in (0, 7, 25, 60, 400):
        stage.show(number, np.zeros(one.penetration.shape[1:] if "penetration" in one else (len(row.gaps), 3)))
        floors = [frame[2].get_xdata().reshape(-1, 3) for frame in stage._frames]
        for contact in row.contacts:
            i, s = contact.pair - first, contact.storey - 1
            left = floors[i][s, 1] if i >= 0 else stage.wall_faces[0]
            right = floors[i + 1][s, 0] if i + 1 < 2 else stage.wall_faces[1]
            u = [one.displacement.values[number, j, s] if 0 <= j < 2 else 0.0 for j in (i, i + 1)]
            penetration = u[0] - u[1] - row.gaps[contact.pair]
            assert left - right == pytest.approx(stage.factor * penetration, abs=1e-12)


def test_a_single_building_has_no_contacts_to_draw(tmp_path):
    alone = made.histories().isel(building=[0]).drop_dims("pair")
    figure = FIGURES["row"].draw(alone)
    assert "force" not in figure.get_suptitle()
    assert len(FIGURES["histories"].draw(alone).axes) == 2
    with Image.open(animate(alone, tmp_path / "row.gif", frames=2)) as gif:
        assert gif.n_frames == 2


@given(st.floats(1e-6, 1e6))
def test_the_factor_is_a_round_number_below(value):
    found = _round_down(value)
    assert found <= value * (1 + 1e-9) < 2.5 * found * (1 + 1e-6)
    assert f"{found:e}"[0] in "125"
    assert float(f"{found:.0e}") == pytest.approx(found)


def test_the_strongest_impact():
    one = made.histories()
    total = one.contact_force.max(["pair", "storey"])
    assert total.sel(time=strongest(one)) == total.max() > 0.0
    apart = made.histories(touch=False)
    assert np.abs(apart.displacement).sel(time=strongest(apart)).max() == np.abs(apart.displacement).max()


def test_the_row_stands_at_its_strongest_impact():
    one = made.histories()
    figure = FIGURES["row"].draw(one)
    (marks,) = [c for c in figure.axes[0].collections if len(c.get_offsets())]
    assert marks.get_offsets()[:, 1].tolist() == [3.0, 6.0]
    assert f"{strongest(one):.3f} s" in figure.get_suptitle()
    assert f"drawn {Stage(one).factor:g} times" in figure.get_suptitle()


# -- the animation -----------------------------------------------------------------------------------------------------


def test_a_gif_moves(tmp_path):
    path = animate(made.histories(True, False), tmp_path / "row.gif", frames=3, speed=0.25, start=0.0, end=0.5)
    with Image.open(path) as gif:
        assert gif.format == "GIF"
        assert gif.n_frames == 3
        pictures, pauses = [], []
        for number in range(gif.n_frames):
            gif.seek(number)
            pictures.append(gif.convert("RGB").tobytes())
            pauses.append(gif.info["duration"])
    assert len(set(pictures)) == 3
    assert sum(pauses[1:]) == pytest.approx(1e3 * 0.5 / 0.25, rel=0.05)


def test_a_short_impact_between_two_pictures_is_marked_and_fades():
    one = made.histories()
    pulse = np.zeros((401, 1, 3))
    pulse[203, 0, 1] = 500.0
    pulse[300, 0, 0] = 1000.0
    picture = _Picture(one.assign(contact_force=(one.contact_force.dims, pulse)), 0.0, 2.0)
    seen = []
    for before, now in ((190, 200), (200, 210), (210, 220), (220, 230)):
        picture.show(before, now)
        seen.append(picture.marks[0, 1])
    assert seen[0] == 0.0
    assert seen[1] == pytest.approx(0.5)
    assert 0.5 > seen[2] > seen[3] > 0.0


def test_by_default_it_shows_some_periods_round_the_strongest_impact(tmp_path):
    one = made.histories()
    path = animate(one, tmp_path / "row.gif", frames=2)
    with Image.open(path) as gif:
        assert gif.n_frames == 2
    with pytest.raises(InputError, match="nothing lies between"):
        animate(one, tmp_path / "x.gif", start=5.0, end=6.0)


def test_what_cannot_be_animated_is_said(tmp_path, monkeypatch):
    one = made.histories()
    monkeypatch.setattr("matplotlib.animation.FFMpegWriter.isAvailable", lambda: False)
    for name, options, text in (
        ("row.mp4", {}, "no ffmpeg"),
        ("row.txt", {}, "ending in .gif or .mp4"),
        ("no_folder/row.gif", {}, "can't write"),
        ("row.gif", {"frames": 1}, "at least 2"),
        ("row.gif", {"speed": 0.0}, "positive number"),
    ):
        with pytest.raises((InputError, OutputError), match=text):
            animate(one, tmp_path / name, **options)
    with pytest.raises(InputError, match="pounding-sweep simulate"):
        animate(made.cube(), tmp_path / "row.gif")


# -- parts of cubes, one scenario of a sweep ---------------------------------------------------------------------------


def test_select_by_value():
    cube = made.cube()
    xr.testing.assert_identical(select(cube, {"gap": "0.004", "law": "none"}), cube.isel(gap=1, law=2))
    for values, text in (
        ({"gap": "0.005"}, "has 0.002, 0.004"),
        ({"gap": "wide"}, "is no number"),
        ({"law": "liner"}, "did you mean 'linear'"),
        ({"gab": "1"}, "did you mean 'gap'"),
    ):
        with pytest.raises(InputError, match=text):
            select(cube, values)


@pytest.fixture
def asked(monkeypatch):
    """What `simulate` is asked for; nothing is run."""
    calls = []

    def simulate(*args, **more):
        calls.append((args, more))
        return xr.Dataset()

    monkeypatch.setattr("pounding_sweep.run.simulate.simulate", simulate)
    return calls


def pulses(*names):
    return [ps.pulse_record("sine", amplitude=1.0, period=0.5, dt=0.01, name=name) for name in names]


def test_the_scenario_in_the_middle(asked):
    spec = build_spec(
        scene=made.scene(),
        records=pulses("one", "two", "three"),
        laws=["none", "kelvin_voigt", "linear"],
        gaps=[0.01, 0.02, 0.03, 0.04],
        stiffness_factors=[0.5, 2.0, 4.0],
        restitutions=[0.4, 0.6],
        scales=[1.0, 2.0],
        period_factors={"b": [1.0, 1.5, 2.0]},
        mass_factors={"a": [3.0]},
        damping_ratios=[0.02, 0.04],
        method="newmark",
        dt=2e-3,
        gamma=0.6,
        beta=0.35,
    )
    case = Case("kelvin_voigt", 0.02, None, 2.0, 0.4, "two", 1.0, {"b": 1.5}, {"a": 3.0}, 0.02)
    assert scenario_of(spec) == case
    properties = "period factor of b 1.5; damping ratio 0.02"
    one = simulate_one(spec)
    assert one.attrs["scenario"] == f"stiffness factor 2; restitution 0.4; scale 1; {properties}"
    one = simulate_one(spec, gap=0.5, law="linear", record="one", scale=3.0, stiffness_factor=0.1)
    assert one.attrs["scenario"] == f"stiffness factor 0.1; scale 3; {properties}"  # linear takes no restitution
    (scene, record), first = asked[0]
    assert (first["law"].key, first["stiffness"], first["restitution"]) == ("kelvin_voigt", 2e6, 0.4)
    assert (first["method"], first["dt"], first["beta"], first["gamma"]) == ("newmark", 2e-3, 0.35, 0.6)
    assert record == spec.record("two")
    assert scene.gaps == (0.02,)
    want = case_variants(made.scene(), [case])[0]
    np.testing.assert_allclose(np.concatenate([b.masses for b in scene.buildings]), want.masses[1])
    np.testing.assert_allclose(np.concatenate([b.stiffnesses for b in scene.buildings]), want.stiffnesses[1])
    for i, building in enumerate(scene.buildings):
        np.testing.assert_allclose(building.rayleigh, [x[1] for x in want.rayleigh(i)])
    (scene, record), second = asked[1]
    assert (scene.gaps, second["law"].key, second["stiffness"]) == ((0.5,), "linear", 1e5)
    np.testing.assert_allclose(record.acceleration, 3.0 * spec.record("one").acceleration)


def test_a_listed_case(asked):
    cases = [{"law": "none"}, {"law": "hertz", "gap": [0.01, 0.03], "stiffness": 3e6}, {"law": "linear"}]
    spec = build_spec(scene=made.scene(right_wall=True), records=pulses("one"), cases=cases)
    for number in (None, 2):
        assert simulate_one(spec, case=number).attrs["scenario"] == "case 2; stiffness 3e+06 kN/m^1.5"
        (scene, _), given_ = asked[-1]
        assert (scene.gaps, given_["law"].key, given_["stiffness"]) == ((0.01, 0.03), "hertz", 3e6)
    simulate_one(spec, case=1)
    assert asked[-1][1]["stiffness"] is None
    with pytest.raises(InputError, match="cases 1 to 3"):
        simulate_one(spec, case=4)


def test_a_stiffness_is_not_taken_in_another_unit(asked):
    product = build_spec(
        scene=made.scene(), records=pulses("one"), laws=["kelvin_voigt", "none"], stiffnesses=[1e6, 2e6, 4e6]
    )
    listed = build_spec(scene=made.scene(), records=pulses("one"), cases=[{"law": "linear", "stiffness": 2e6}])
    words = r"2e\+06 kN/m, is that of law '{}', and law 'hertz' takes kN/m\^1.5; give a stiffness \(kN/m\^1.5\)"
    for spec, own in ((product, "kelvin_voigt"), (listed, "linear")):
        with pytest.raises(InputError, match=words.format(own)):
            simulate_one(spec, law="hertz")
        assert not asked
        for law in ("none", "stereomechanical", "linear"):
            simulate_one(spec, law=law)
        assert [more["stiffness"] for _, more in asked] == [None, None, 2e6]
        simulate_one(spec, law="hertz", stiffness=3e7)
        simulate_one(spec, law="hertz", stiffness_factor=2.0)
        assert [more["stiffness"] for _, more in asked[3:]] == [3e7, 2e7]
        asked.clear()


def test_a_stiffness_of_zero_is_not_the_one_of_the_scene(asked):
    spec = build_spec(scene=made.scene(), records=pulses("one"), laws="linear")
    for choice in ({"stiffness": 0.0}, {"stiffness_factor": 0.0}):
        simulate_one(spec, **choice)  # which `simulate` refuses
        assert asked[-1][1]["stiffness"] == 0.0


def test_a_heading_tells_the_scenario_and_its_lines_end_between_parts():
    one = made.histories().assign_attrs(title="pulse: Linear spring", scenario="restitution 0.6; damping ratio 0.02")
    assert heading(one) == "pulse: Linear spring; gap 10 mm; restitution 0.6; damping ratio 0.02"
    lines = ["pulse: Linear spring; gap 10 mm; restitution 0.6;", "damping ratio 0.02; drawn 10 times"]
    assert heading(one, "drawn 10 times", 60).split("\n") == lines
    for key in ("histories", "row"):
        assert "restitution 0.6; damping ratio 0.02" in FIGURES[key].draw(one).get_suptitle()


def test_every_axis_may_be_chosen(asked):
    spec = build_spec(
        scene=made.scene(right_wall=True),
        records=pulses("one"),
        laws="linear",
        pgas=[1.0, 2.0],
        period_factors={"b": [1.0, 1.5]},
        damping_ratios=[0.02, 0.05],
    )
    choice = {"pga": 3.0, "period_factor_b": 2.0, "mass_factor_a": 4.0, "damping_ratio": 0.1, "gap": [0.01, 0.03]}
    one = simulate_one(spec, **choice)
    (scene, record), _ = asked[0]
    assert record.pga == pytest.approx(3.0)
    assert scene.gaps == (0.01, 0.03)
    case = Case("linear", period_factors={"b": 2.0}, mass_factors={"a": 4.0}, damping_ratio=0.1)
    want = case_variants(made.scene(right_wall=True), [case])[0]
    np.testing.assert_allclose(np.concatenate([b.masses for b in scene.buildings]), want.masses[1])
    np.testing.assert_allclose(np.concatenate([b.stiffnesses for b in scene.buildings]), want.stiffnesses[1])
    assert one.attrs["scenario"] == "pga 3; period factor of b 2; mass factor of a 4; damping ratio 0.1"
    assert simulate_one(spec, mass_factor_a=1.0).attrs["scenario"].endswith("mass factor of a 1; damping ratio 0.02")
    for bad, text in (
        ({"period_factor_c": 1.0}, "did you mean 'period_factor_b'"),
        ({"mass_factor_a": -1.0}, r"factor is -1.0; it must be in \[0.001, 1000\]"),
        ({"damping_ratio": 1.5}, "damping ratio is 1.5"),
    ):
        with pytest.raises(InputError, match=text):
            simulate_one(spec, **bad)


def test_histories_are_run_finer_until_they_show_their_peaks(monkeypatch):
    """By default; a step that is asked for is the one that is taken."""
    taken = []

    def simulate(*args, output_step=None, **more):
        taken.append(output_step)
        step = output_step or 8e-3
        shown = 100.0 * (1.0 - step**2 / 4e-4)
        values = {"impact_force_max": ("pair", [100.0]), "contact_force": (("time", "pair"), [[0.0], [shown]])}
        return xr.Dataset(values, attrs={"time_step": step})

    monkeypatch.setattr("pounding_sweep.run.simulate.simulate", simulate)
    spec = build_spec(scene=made.scene(), records=pulses("one"), laws="linear")
    assert peaks_shown(simulate_shown(spec)) == pytest.approx(0.99)
    assert taken == [None, 4e-3, 2e-3]
    simulate_shown(spec, 5e-3)
    assert taken[3:] == [5e-3]


def test_choices_are_checked(asked):
    spec = build_spec(scene=made.scene(), records=pulses("one"), laws="linear")
    for choice, text in (
        ({"case": 1}, "product of axes"),
        ({"record": "ono"}, "did you mean 'one'"),
        ({"stiffness": 1.0, "stiffness_factor": 1.0}, "exclude each other"),
        ({"gaps": 1.0}, "did you mean 'gap'"),
    ):
        with pytest.raises(InputError, match=text):
            simulate_one(spec, **choice)
    assert not asked


# -- the commands ------------------------------------------------------------------------------------------------------

SWEEP = """\
[scene]
gaps = [0.002, 0.002]
contact = { linear_stiffness = 1e6, restitution = 0.6 }
row = [
    { name = "low", masses = [120.0], stiffnesses = [2e5], storey_heights = [6.0] },
    { name = "high", masses = [100.0, 90.0], stiffnesses = [8e4, 7e4] },
    { wall = true },
]

[sweep]
records = [{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.01, duration = 2.0 }]
laws = ["kelvin_voigt", "none"]
gaps = [0.001, 0.005, 9.0]
"""


def command(*words, code=0):
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == code, done.output
    return done


def test_options_of_figures_on_the_command_line(tmp_path, not_rendered):
    cube, one, picture = tmp_path / "cube.nc", tmp_path / "one.nc", tmp_path / "x.png"
    write_cube(of_periods(), cube)
    write_cube(made.histories(), one)
    words = ("plot", cube, "map", "-o", picture, "--dpi", "20")
    command(*words, "--x", "gap", "--y", "period_ratio", "--value", "drift_max_ratio", "--contours")
    assert picture.exists()
    assert not_rendered == [{"dpi": 20.0}]
    assert "did you mean 'gap'" in command(*words, "--x", "gpa", code=2).stderr
    command("plot", one, "phase", "-o", tmp_path / "y.png", "--dpi", "20", "--start", "0.5", "--end", "1")
    said = command("plot", one, "histories", "-o", picture, "--x", "gap", code=2).stderr
    assert re.search(r"'histories' takes no x; amplification, force-gap, law-comparison, map do", said)
    assert "give them to 'pounding-sweep compare CUBE.nc" in command(*words, "--event", "touch", code=2).stderr


@pytest.mark.parametrize("name", ["simulate", "animate"])
def test_choices_of_a_scenario_on_the_command_line(tmp_path, name):
    """What is wrong is said before anything is run."""
    sweep = tmp_path / "s.toml"
    sweep.write_text(SWEEP)
    for words, text in (
        (["--gap", "0.1", "--at", "gap=0.2"], "gap is given twice, by --gap and by --at"),
        (["--at", "pga=1", "--at", "pga=2"], "--at gives 2 values of pga"),
        (["--at", "gap=wide"], "--at gap=wide is no number"),
        (["--at", "case=1.5"], "--at case=1.5 is no whole number"),
        (["--at", "period_factor_hgh=2"], "did you mean 'period_factor_high'"),
        (["--at", "gap=1", "--at", "gap=1", "--at", "gap=1"], "3 gaps for a row of 3; give 2"),
        (["--output-step", "0"], "output_step is 0.0; it must be a positive number"),
    ):
        done = command(name, sweep, "-o", tmp_path / ("x.nc" if name == "simulate" else "x.gif"), *words, code=2)
        assert text in done.stderr, done.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("always:records:UserWarning")  # printed, as in a process of its own
def test_a_scenario_from_its_file_to_its_pictures(tmp_path):
    sweep, one, gif = tmp_path / "s.toml", tmp_path / "one.nc", tmp_path / "row.gif"
    sweep.write_text(SWEEP)
    gone = tmp_path / "gone.toml"
    gone.write_text(SWEEP.replace("records = [", 'records = ["missing", '))
    done = command("simulate", sweep, "-o", one)
    assert done.stdout.splitlines() == [str(one)]
    assert "Kelvin-Voigt without tension; gap 5 mm" in done.stderr
    scene = ps.load_sweep(sweep).spec.scene.with_gaps([0.005, 0.005])
    want = ps.simulate(scene, ps.load_sweep(sweep).spec.records[0], law="kelvin_voigt")
    with open_cube(one) as found:
        assert found.pair_gap.values.tolist() == [0.005, 0.005]
        assert stored_scene(found) == scene
        np.testing.assert_array_equal(found.contact_force, want.contact_force)
    assert command("plot", one, "histories", "-o", tmp_path / "h.png").stdout.strip() == str(tmp_path / "h.png")
    possible, others = command("plot", one).stdout.split("not possible")
    assert re.search(r"^row ", possible, re.MULTILINE)
    assert re.search(r"^force-gap +law, gap$", others, re.MULTILINE)
    assert "unknown record 'missing'" in command("simulate", gone, "-o", tmp_path / "two.nc", code=2).stderr
    said = command("simulate", gone, "-o", tmp_path / "two.nc", "--skip-missing-records", "--stiffness", "3e6").stderr
    assert "left out" in said
    assert "gap 5 mm; stiffness 3e+06 kN/m\n" in said
    more = ("--stiffness", "2e6", "--skip-missing-records")
    done = command("animate", gone, "-o", gif, "--frames", "3", "--gap", "0.001", "--start", "0.2", "--end", "1", *more)
    assert "gap 1 mm; stiffness 2e+06 kN/m\n" in done.stderr
    with Image.open(io.BytesIO(gif.read_bytes())) as picture:
        assert picture.n_frames == 3
    assert "exists" in command("simulate", sweep, "-o", one, code=2).stderr
    assert "ending in .gif" in command("animate", sweep, "-o", tmp_path / "x.avi", code=2).stderr


def test_help_gives_the_defaults_of_an_animation():
    text = " ".join(command("animate", "--help").stdout.split())
    assert PERIODS == 4.0
    assert "by default four periods of the motion before --end" in text
    assert "by default four periods after" in text
    assert f"such that it takes {WATCHED:g} s" in text


def test_plot_lists_and_selects(tmp_path, not_rendered):
    cube, picture = tmp_path / "cube.nc", tmp_path / "x.png"
    write_cube(made.cube(), cube)
    listed = command("plot", "--list").stdout
    for kind in FIGURES.values():
        assert re.search(rf"^{kind.key} ", listed, re.MULTILINE)
    possible, others = command("plot", cube).stdout.split("not possible")
    assert re.search(r"^force-gap ", possible, re.MULTILINE)
    assert re.search(r"^histories +time, ground_acceleration, displacement$", others, re.MULTILINE)
    command("plot", cube, "profiles", "-o", picture, "--at", "gap=0.004", "--at", "law=linear")
    assert len(not_rendered) == 1
    for words, text in (
        ((), "give CUBE.nc FIGURE"),
        ((cube, "profiles"), "-o is missing"),
        ((cube, "profiles", "-o", picture, "--at", "gap"), "AXIS=VALUE"),
        ((cube, "histories", "-o", picture), "pounding-sweep simulate"),
    ):
        assert text in command("plot", *words, code=2).stderr


@pytest.mark.slow
@pytest.mark.parametrize("key", sorted(key for key, kind in FIGURES.items() if kind.source == "cube"))
def test_every_figure_of_one_value_of_any_axis_is_drawn_or_refused_in_words(key, tmp_path):
    cube, picture = tmp_path / "cube.nc", tmp_path / "x.png"
    write_cube(made.cube(record=2, scale=2, stiffness_factor=2), cube)
    drawn = []
    for part in ("pair=a-b", "building=a", "storey=2"):
        done = CliRunner().invoke(app, ["plot", str(cube), key, "-o", str(picture), "--dpi", "20", "--at", part])
        assert done.exit_code in (0, 2), (part, done.output)
        drawn += [part] if done.exit_code == 0 else []
    refused = {"energy-budget": {"storey=2"}, "profiles": {"storey=2"}}
    refused |= {key: {"building=a", "storey=2"} for key in ("required-gap", "gap-for-probability")}
    assert set(drawn) == {"pair=a-b", "building=a", "storey=2"} - refused.get(key, set())


def test_what_is_drawn_of_a_part_is_that_part(tmp_path):
    cube = made.cube(record=3, scale=3)
    part = select(cube, {"storey": 2}, INNER_DIMS)
    ax = FIGURES["incremental"].draw(part).axes[0]
    assert ax.get_title().endswith("storey 2")
    (lacks,) = FIGURES["profiles"].lacks(part)
    assert lacks == "the storeys from the first on"


@pytest.mark.usefixtures("not_rendered")
def test_several_values_are_not_drawn_as_one(tmp_path):
    cube, picture = tmp_path / "cube.nc", tmp_path / "x.png"
    write_cube(made.cube(), cube)
    several = [word for gap in ("0.002", "0.004", "0.008") for word in ("--at", f"gap={gap}")]
    refused = command("plot", cube, "profiles", "-o", picture, *several, code=2)
    assert "3 values of gap are asked for, and this figure takes one value of that axis" in refused.stderr
    command("plot", cube, "force-gap", "-o", picture, *several)
    laws = [word for law in ("linear", "kelvin_voigt") for word in ("--at", f"law={law}")]
    write_cube(made.cube(record=3, scale=4), cube, overwrite=True)
    refused = command("plot", cube, "fragility", "-o", picture, *laws, code=2)
    assert "2 values of law are asked for" in refused.stderr


def test_histories_of_one_instant_are_refused():
    for key in ("histories", "row", "closing", "force-penetration", "phase"):
        assert FIGURES[key].lacks(made.histories().isel(time=3)) == ("several times",)


@pytest.mark.parametrize("key", ["fragility", pytest.param("incremental", marks=pytest.mark.slow)])
def test_figures_of_suites_name_laws_and_records_and_take_the_spacing_of_scales(key):
    cube = made.cube(record=2, scale=4, law=2).isel(gap=[0])
    for scales, spacing in (([0.5, 1.0, 1.5, 2.0], "linear"), ([0.25, 0.5, 1.0, 2.0], "log")):
        figure = FIGURES[key].draw(cube.assign_coords(scale=scales))
        assert {ax.get_xscale() for ax in figure.axes} == {spacing}
        assert "2 records" in figure.get_suptitle()
        assert "Linear spring" in figure.get_suptitle() + figure.axes[0].get_title()
    alone = cube.isel(record=[0]).assign_coords(record=["el_centro"])
    assert "record Imperial Valley 1940" in FIGURES[key].draw(alone).get_suptitle()


def test_marks_of_a_fragility_are_those_of_its_stripes():
    cube = made.cube(record=6, scale=4)
    pga = xr.DataArray([1.0, 2.0, 3.0, 4.0], dims="pga", coords={"pga": [1.0, 2.0, 3.0, 4.0]})
    cube = cube.drop_vars("scale").rename(scale="pga").assign_coords(pga=pga, record_pga=("record", np.full(6, 2.0)))
    cube = cube.assign_coords(scale=(("record", "pga"), np.tile([0.5, 1.0, 1.5, 2.0], (6, 1))))
    ax = FIGURES["fragility"].draw(cube.isel(gap=[0])).axes[0]
    marks = [line for line in ax.lines if len(line.get_xdata()) == 1]
    assert [float(line.get_xdata()[0]) for line in marks if line.get_color() == marks[0].get_color()] == [1, 2, 3, 4]


@pytest.mark.parametrize("key", ["force-gap", "law-comparison", "map", "incremental"])
def test_pairs_without_contacts_have_no_panel(key):
    cube = made.cube(right_wall=True, record=2, scale=3)
    met = cube["pair"] != "a-b"
    unmet = cube.assign({name: part.where(met) for name, part in cube.data_vars.items() if "pair" in part.dims})
    said = [sum("pair a-b" in ax.get_title() for ax in FIGURES[key].draw(each).axes) for each in (cube, unmet)]
    assert said[0] > said[1] == 0
    assert any("pair b-w2" in ax.get_title() for ax in FIGURES[key].draw(unmet).axes)


@pytest.mark.parametrize("key", ["required-gap", "gap-for-probability"])
def test_pairs_without_contacts_need_no_gap(key):
    exact, rules = [[0.01, np.nan], [0.02, np.nan], [0.04, np.nan]], ["abs"]
    coords = {"record": ["r1", "r2", "r3"], "pair": ["a-b columns of b", "a-b"], "rule": rules}
    gaps = {"exact": (("record", "pair"), exact), "rule_gap": (("rule", "record", "pair"), [exact])}
    result = xr.Dataset(gaps | {"ratio": (("rule", "record", "pair"), [exact])}, coords, {"comparison": "required-gap"})
    drawn = result if key == "required-gap" else COMPARISONS[key].make(result)
    titles = [ax.get_title() for ax in FIGURES[key].draw(drawn).axes]
    assert [title for title in titles if title] == ["pair a-b columns of b"]


def test_of_one_record_incremental_draws_its_curve_alone():
    one, two = (FIGURES["incremental"].draw(made.cube(record=n, scale=4)) for n in (1, 2))
    legends = [[text.get_text() for text in figure.legends[0].texts] for figure in (one, two)]
    assert legends == [["record"], ["record", "16% fractile", "median", "84% fractile"]]
    assert [len(ax.lines) for ax in one.axes] == [1] * len(one.axes)
    assert "No fractiles" not in one.get_suptitle()


def test_bands_of_a_fragility_end_at_the_intensities_tried():
    cube = made.cube(record=6, scale=4, law=1).isel(gap=[0], restitution=[0], storey=[0])
    cube = cube.assign_coords(record_pga=("record", np.ones(6)))  # scales 0.5 to 2
    closes_at = xr.DataArray([0.4, 0.6, 0.9, 1.2, 1.4, 1.7], dims="record")
    cube["impact_count"] = (cube["impact_count"] > 0) & (cube["scale"] > closes_at)
    ax = FIGURES["fragility"].draw(cube).axes[0]
    (band,) = ax.collections
    x = np.concatenate([path.vertices[:, 0] for path in band.get_paths()])
    tried = [x for x in ax.lines[0].get_xdata() if x >= 0.5]
    assert (x.min(), x.max()) == (min(tried), 2.0)
    assert ax.lines[0].get_xdata().min() < 0.1  # the curve itself begins there


def test_fractiles_that_no_intensity_allows_are_said_to_be_missing():
    cube = made.cube(record=3, scale=3)
    cube = cube.assign_coords(record_pga=("record", [0.1, 1.0, 100.0]))
    figure = FIGURES["incremental"].draw(cube)
    assert "No fractiles: none of these intensities" in figure.get_suptitle()
    assert "fractile" not in " ".join(text.get_text() for text in figure.legends[0].texts)
    figure = FIGURES["incremental"].draw(cube.assign_coords(record_pga=("record", [0.9, 1.0, 1.1])))
    assert "No fractiles" not in figure.get_suptitle()
    assert "median" in [text.get_text() for text in figure.legends[0].texts]

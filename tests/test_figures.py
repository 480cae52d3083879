"""Figures: every one of the registry drawn or refused, what is handed to them, the row in motion, and the commands."""

from __future__ import annotations

import io
import json
import re

import figure_data as made
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from scenes import call

import pounding_sweep as ps
from pounding_sweep.analysis import COMPARISONS, amplification, fragility
from pounding_sweep.analysis.comparisons.fragility import fit_rows
from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.analysis.scenarios import TOUCH_VARIABLES
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.figures import CONTACT, FIGURES, FIRST_STOREY, NO_CONTACT, SOURCES, plot, require
from pounding_sweep.figures.gallery.scenario import animate, draw_row, fading_marks
from pounding_sweep.figures.select import select_default
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.dataset import UNTITLED
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.output.select import select
from pounding_sweep.variables.registry import INNER_DIMS, Status

#: Words of labels that have no unit.
NO_UNIT = re.compile(r"impacts|error|drawn|probability|restitution|ratio|factor|share|pounding over|storey|law|input")
CUBE_FIGURES = [key for key, kind in FIGURES.items() if kind.source == "cube"]
FORCE = "impact_force_max"


def some(keys, *fast):
    """Parametrise by figures of which only some are drawn by day."""
    return pytest.mark.parametrize("key", [k if k in fast else pytest.param(k, marks=pytest.mark.slow) for k in keys])


def draw(key, dataset, **options):
    return FIGURES[key].draw(dataset, **options)


def title(key, dataset):
    return "; ".join(draw(key, dataset).caption)


def masked(cube, there):
    """A cube whose scenarios have values where `there` is true, and were not run elsewhere."""
    part = cube.assign({name: v.where(there) for name, v in cube.data_vars.items() if v.dtype.kind == "f"})
    return part.assign(status=cube["status"].where(there, int(Status.NOT_RUN)).astype("i1"))


CASES = made.cases(FIGURES)


@pytest.mark.parametrize("name", CASES)
def test_every_figure_shows_what_it_should_on_labelled_axes(name):
    key, make, options = CASES[name]
    figure, golden = draw(key, make(), **options), json.loads(made.GOLDEN.read_text(encoding="utf-8"))[name]
    assert {"title": figure.get_suptitle(), "caption": [*getattr(figure, "caption", [])]} == {
        key: golden[key] for key in ("title", "caption")
    }
    assert figure.get_suptitle().count("\n") < 2
    for panel, expected in zip(made.summary(figure)["panels"], golden["panels"], strict=True):
        assert panel[:-1] == expected[:-1]
        for numbers, wanted in zip(panel[-1], expected[-1], strict=True):
            assert numbers == pytest.approx(wanted, rel=1e-3, abs=1e-9), panel
    labels = [text for ax in figure.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]
    assert labels
    assert [label for label in labels if not re.search(r"\([^()]+\)", label) and not NO_UNIT.search(label)] == []


@pytest.mark.slow
@pytest.mark.parametrize("key", FIGURES)
def test_every_figure_finds_its_layout_and_is_saved(key, tmp_path):
    plot(made.MAKERS[FIGURES[key].source](), key, tmp_path / "figure.png", dpi=20)
    with Image.open(tmp_path / "figure.png") as picture:
        assert min(picture.size) > 20


@pytest.mark.parametrize("key", FIGURES)
def test_a_dataset_that_lacks_something_is_refused_in_words(key):
    kind = FIGURES[key]
    with pytest.raises(InputError, match=re.escape(SOURCES[kind.source])) as error:
        require(xr.Dataset(), key)
    for need in kind.needs:
        if need.split("|")[0] not in (CONTACT, NO_CONTACT, FIRST_STOREY):
            assert need.split("|")[0] in str(error.value)


def test_what_figures_need():
    cube, intensities = made.cube(), "scales or PGAs or spectral accelerations"
    none = (cube["law"] == "none").values
    bare = cube[["status", "impact_count", "floor_elevation"]]
    for key, dataset, missing in (
        ("profiles", cube.drop_vars(["displacement_max", "drift_max", "acceleration_max"]), ""),
        (
            "profiles",
            bare,
            "displacement_max or displacement_min or drift_max or storey_shear_max or acceleration_max"
            " or drift_ratio_max",
        ),
        ("law-comparison", cube, ""),
        ("law-comparison", cube.sel(law=["linear", "none"]), "several laws with contact"),
        ("incremental", made.cube(scale=3), ""),
        ("incremental", cube, f"several {intensities}"),
        ("fragility", made.cube(record=3), ""),
        ("fragility", made.cube(scale=3), ""),
        ("fragility", cube, f"several records or {intensities}"),
        ("amplification", amplification(cube), ""),
        ("amplification", cube.isel(law=none), CONTACT),
        ("map", cube.isel(gap=[0], restitution=0), "two axes of several numbers such as gap and restitution"),
        ("sensitivity", cube, ""),
        ("sensitivity", made.histories(), 'a design of kind "saltelli" or axes of several numbers'),
        ("profiles", select(cube, {"storey": 2}, INNER_DIMS), "the storeys from the first on"),
        *((key, made.histories().isel(time=3), "several times") for key in ("histories", "row", "closing", "phase")),
    ):
        assert ", ".join(FIGURES[key].missing(dataset)) == missing, key
    assert FIGURES["amplification"].missing(cube.isel(law=~none))[0].startswith(NO_CONTACT)


@some((key for key, item in COMPARISONS.items() if item.figure), "required-gap")
def test_figures_of_comparisons_take_a_cube_or_what_was_made_of_it(key):
    figure = COMPARISONS[key].figure
    cube = made.design() if FIGURES[figure].source == "design" else made.cube(right_wall=True, record=3, scale=3)
    one, other = (draw(figure, dataset) for dataset in (cube, COMPARISONS[key].make(cube)))
    for ax, same in zip(one.axes, other.axes, strict=True):
        assert ax.get_title() == same.get_title()
        for line, its in zip(ax.lines, same.lines, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), its.get_ydata())


def test_titles_name_the_study_and_the_subject_in_two_lines(tmp_path, monkeypatch):
    cube, headings = made.cube(), []
    savefig = "matplotlib.figure.Figure.savefig"
    monkeypatch.setattr(savefig, lambda self, file, **more: headings.append(self.get_suptitle()))
    for study, more in (
        ("by hand", {}),
        ("long " * 40, {}),
        (UNTITLED, {}),
        ("", {"title": "School"}),
        ("", {"title": ""}),
    ):
        plot(cube.assign_attrs(title=study), "profiles", tmp_path / "x.png", **more)
    subject = "Peak responses over the height"
    assert headings == [f"by hand\n{subject}", subject, subject, "School", ""]
    with pytest.raises(OutputError, match=r"no_folder.x\.txt"):
        plot(cube, "profiles", tmp_path / "x.png", caption=tmp_path / "no_folder" / "x.txt")


def test_files_of_every_kind_and_notebooks(tmp_path):
    for suffix, start in (("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")):
        assert plot(made.cube(), "force-gap", tmp_path / f"x.{suffix}").read_bytes().startswith(start)
    with Image.open(io.BytesIO(draw("row", made.histories())._repr_png_())) as picture:
        assert picture.format == "PNG"
        assert min(picture.size) > 200


def test_what_cannot_be_drawn_or_written_is_said(tmp_path):
    cube, one = made.of_periods(), made.histories()
    both = cube.assign_coords(period_ratio_a_b=(("period_factor_a", "gap"), np.ones((5, 4))))
    instants = "fewer than two instants.*they run from 0 s to 2 s"
    for dataset, key, options, text in (
        (cube, "profile", {}, "did you mean 'profiles'"),
        *((cube, "force-gap", {"dpi": dpi}, f"dpi is {dpi:g}; it must be from 10 to 1200") for dpi in (5, 2000)),
        (cube, "force-gap", {"value": "drift_max"}, "valid: impact_count, impact_force_max"),
        (cube, "map", {"x": "gpa"}, "did you mean 'gap'"),
        (cube, "map", {"x": "gap", "y": "gap"}, "are the same, gap"),
        (cube, "map", {"x": "law"}, "unknown axis to draw along 'law'; valid: gap, period_factor_a, period_ratio"),
        (cube, "map", {"y": "storey", "value": "status"}, "status is not a value of storeys"),
        (cube, "map", {"value": "impact_forces"}, "did you mean 'impact_force_max'"),
        (cube, "amplification", {"value": "impulse_ratio"}, "unknown value to draw"),
        (cube, "profiles", {"value": "impulse"}, "unknown value to draw"),
        (
            both,
            "map",
            {"x": "period_ratio_a_b", "y": "gap"},
            "varies with period_factor_a and gap; choose one value of",
        ),
        *((one, "phase", {"start": a, "end": b}, instants) for a, b in ((3, None), (0.5, 0.4), (None, -1), (0.5, 0.5))),
    ):
        with pytest.raises(InputError, match=text):
            plot(dataset, key, tmp_path / "x.png", **options)
    with pytest.raises(OutputError, match=r"ending in \.png"):
        plot(cube, "force-gap", tmp_path / "x.xyz")


@pytest.mark.parametrize("key", [key for key in CUBE_FIGURES if key != "modes"])  # which are of the row
def test_a_figure_without_a_value_is_an_error(key, tmp_path):
    cube = made.cube(record=2, scale=3, gap=1, stiffness_factor=2, restitution=1).squeeze("gap")
    assert not FIGURES[key].missing(cube)
    words = "at gap 2 mm: 36 of 36 scenarios are not_run; choose others with --at"
    with pytest.raises(InputError, match=f"figure '{key}' has nothing to draw {words}"):
        plot(masked(cube, xr.zeros_like(cube["status"], dtype=bool)), key, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()


def test_the_middle_of_the_other_axes():
    cube = made.cube(restitution=3, record=3, scale=2)
    part, words = select_default(cube, ("law", "gap"), [FORCE])
    xr.testing.assert_identical(part, cube.isel(stiffness_factor=0, restitution=1, record=1, scale=0))
    others = "restitution 0.6 (one of 3); record r2 (one of 3); scale 0.5 (one of 2)"
    assert words == f"{others}; --at restitution=... or record=... or scale=... for another"
    chosen = cube.isel(gap=2, scale=1, storey=1).squeeze("stiffness_factor")
    words = "gap 6 mm; stiffness factor 1; restitution 0.6 (one of 3); record r2 (one of 3); scale 1; storey 2"
    words += "; --at restitution=... or record=... for another"
    assert select_default(chosen, ("law",), [FORCE])[1] == words


def test_the_scenario_next_to_the_middle_that_has_values_and_touches():
    cube = made.cube(restitution=5, record=5).isel(scale=0, drop=True)
    there = xr.zeros_like(cube["status"], dtype=bool)
    for place in ({"restitution": 0, "record": 0}, {"restitution": 3, "record": 1}, {"restitution": 4, "record": 4}):
        there[{"law": 0, "gap": 3, **place}] = True
    assert title("force-gap", masked(cube, there)).endswith(
        "; median of 1 of 5 records; restitution 1 (one of 5); --at restitution=... for another"
    )
    cube = made.cube(gap=6, restitution=3)
    touches = (cube["gap"] < 0.003) & (cube["restitution"] > 0.5) & (cube["law"] != "none")
    cube["impact_count"] = cube["impact_count"].where(touches, 0)
    blind = cube.drop_vars([name for name in TOUCH_VARIABLES if name in cube])
    for dataset, drawn, words in (
        (cube, FORCE, "gap 2 mm (one of 6); restitution 0.6 (one of 3)"),
        (cube.assign(impact_count=0 * cube["impact_count"]), FORCE, "gap 6 mm (one of 6)"),
        (blind, "drift_max", "gap 6 mm (one of 6)"),
        (amplification(cube), "drift_max_ratio", "gap 2 mm (one of 6)"),  # which says itself what touches
    ):
        assert select_default(dataset, ("law",), [drawn])[1].startswith(words)
    cube = made.cube(record=3)  # forces are looked for among laws with contact
    there = (cube["law"] == "none") | (cube["record"] == "r3") & (cube["status"] == 0)
    assert "; median of 1 of 3 records;" in title("force-gap", masked(cube, there))


@some(("force-gap", "amplification", "profiles"), "force-gap", "profiles")
def test_records_are_thin_lines_and_their_median_counts_those_that_have_values(key):
    cube = made.cube(record=3)
    assert "median of 3 records" in title(key, cube)
    lines = [line for line in draw(key, cube).axes[-1].lines if len(line.get_xdata())]  # with one line for each law
    for colour in {line.get_color() for line in lines if line.get_alpha()}:
        bold, *thin = (np.stack(line.get_data()) for line in lines if line.get_color() == colour)
        assert len({part.tobytes() for part in thin}) == len(thin) == 3
        np.testing.assert_array_equal(bold, np.median(thin, axis=0))
    assert "median of 2 of 3 records" in title(key, masked(cube, (cube["record"] != "r2") & (cube["status"] == 0)))


def test_lines_of_forces_end_where_contact_ends():
    """Four records of which all, three, one and none touch as the gap grows."""
    cube = made.cube(record=4, law=1, restitution=1)
    touching = np.array([4, 3, 1, 0])[:, None] > np.arange(4)
    touching = xr.DataArray(touching, dims=("gap", "record"))
    cube = cube.assign({name: cube[name].where(touching, 0) for name in (FORCE, "impact_count")})
    for ax in draw("force-gap", cube).axes:
        median, *each = [line.get_ydata() for line in ax.lines if len(line.get_ydata())]
        assert np.isfinite(median).tolist() == [True, True, False, False]
        assert sorted(np.isfinite(line).sum() for line in each) == [1, 2, 2, 3]
        assert ax.get_xlim()[1] > 1e3 * cube["gap"].max()


@pytest.mark.parametrize(("key", "count"), [("force-gap", 2), ("profiles", 3 * 2)])
def test_many_records_are_a_band(key, count):
    cube = made.cube(record=12, restitution=1)
    figure = draw(key, cube)
    bands = [band for band in figure.axes[0].collections if band.get_paths()]
    assert len(bands) == count  # of each law, and to both sides
    names = [text.get_text() for text in figure.legends[0].texts]
    assert ("16 to 84 % of the records" in names, "each record" in names) == (True, False)
    if key == "force-gap":
        forces = cube[FORCE].max("storey").sel(pair="a-b", law="linear").squeeze(drop=True)
        ends = forces.quantile([0.16, 0.84], "record")
        y = bands[0].get_paths()[0].vertices[:, 1]
        assert (y.min(), y.max()) == pytest.approx((ends.min().item(), ends.max().item()))
        dotted = [line.get_ydata() for line in figure.axes[0].lines if line.get_linestyle() == ":"]
        np.testing.assert_allclose(dotted[0], forces.max("record"))


@some(("force-gap", "amplification", "law-comparison", "profiles", "energy-budget"), "force-gap", "profiles")
def test_laws_without_values_are_not_drawn(key):
    cube = made.many_laws()
    axes = draw(key, masked(cube, (cube["law"] != "hertz") & (cube["status"] == 0))).axes
    texts = [t for ax in axes for t in (ax.get_ylabel(), *(tick.get_text() for tick in ax.get_xticklabels()))]
    texts = [text.replace("\n", " ") for text in (*texts, *(line.get_label() for ax in axes for line in ax.lines))]
    for law, there in (("hertz", False), ("hertz_damped", True), ("kelvin_voigt", True)):
        assert any(text.removesuffix(" elevation (m)") == LAWS[law].title for text in texts) == there


def test_listed_cases_are_drawn_one_by_one():
    cube = made.cube(law=1, gap=1, restitution=1).squeeze(drop=True)
    cases = xr.concat([cube, cube], "case").assign_coords(case=[1, 2], law=("case", ["linear", "hertz"]))
    with pytest.raises(InputError, match="--at case=N"):
        draw("profiles", cases)
    figure = draw("profiles", select(cases, {"case": 2}))
    assert {line.get_label() for line in figure.axes[2].lines} == {"Hertz"}
    assert figure.get_suptitle() == "by hand\nPeak responses over the height"
    assert figure.caption[1:] == ["case 2"]


def test_a_part_of_the_row_that_was_selected():
    """By xarray itself, which takes the dimension away: titles of panels, or else of the figure, tell it."""
    cube = made.cube(right_wall=True, restitution=1, record=3, scale=3)
    figure = draw("force-gap", cube.sel(pair="a-b", storey=2))
    assert figure.axes[0].get_title() == "pair a-b"
    assert "storey 2" in figure.caption[1]
    assert draw("profiles", cube.sel(building="b")).axes[0].get_title() == "building b"
    assert "storey 2" in title("incremental", select(cube, {"storey": 2}, INNER_DIMS))


@some(("force-gap", "law-comparison", "map", "incremental", "required-gap"), "force-gap", "required-gap")
def test_pairs_without_contacts_have_no_panel(key):
    cube = made.cube(right_wall=True, record=2, scale=3)
    cube = COMPARISONS[key].make(cube) if key == "required-gap" else cube
    met = cube["pair"] != "a-b"
    unmet = cube.assign({name: part.where(met) for name, part in cube.data_vars.items() if "pair" in part.dims})
    whole, part = ("; ".join(ax.get_title() for ax in draw(key, dataset).axes) for dataset in (cube, unmet))
    assert "pair a-b" in whole
    assert "pair a-b" not in part
    assert "pair b-w2" in part


def test_a_title_tells_the_scenario():
    one = made.histories().assign_attrs(title="pulse: Linear spring", scenario="restitution 0.6; damping ratio 0.02")
    for key in ("histories", "row"):
        assert title(key, one).startswith("pulse: Linear spring; gap 10 mm; restitution 0.6; damping ratio 0.02")


@some(("force-gap", "amplification", "law-comparison"), "force-gap")
@pytest.mark.parametrize(
    ("x", "label", "scale", "size"),
    [("period_ratio", "period ratio T1/T2 of a and b (-)", "log", 5), ("gap", "gap (mm)", "linear", 4)],
)
def test_any_axis_of_numbers_may_be_drawn_along(key, x, label, scale, size):
    axes = draw(key, made.of_periods(record=2), x=x).axes
    assert {ax.get_xscale() for ax in axes} == {scale}
    assert label in [ax.get_xlabel() for ax in axes]
    values = axes[0].lines[0].get_xdata()
    assert len(values) == size
    assert (np.diff(values) > 0).all()


def test_axes_of_a_figure_of_ones_own():
    cube, one = made.of_periods().sel(law=["linear", "none"]), made.histories()
    for key, dataset, options, words in (
        ("map", cube, {}, "gap"),
        ("map", cube.sel(building="b"), {"value": "storey_shear_max_ratio"}, "gap"),
        ("force-gap", cube, {"value": FORCE}, "gap"),
        ("amplification", cube.sel(building="b"), {"value": "drift_max_ratio"}, "gap"),
        ("row", one, {}, "displacements and gaps drawn"),
        ("closing", one, {}, "relative displacement"),
        ("force-penetration", one, {}, "penetration"),
    ):
        own = Figure()
        ax = own.subplots(1, 2)[1]
        assert draw(key, dataset, ax=ax, **options) is own
        assert ax.has_data()
        assert not own.get_suptitle()
        assert words in ax.get_title() + ax.get_ylabel() + ax.get_xlabel()
    with pytest.raises(InputError, match="2 x 1 panels, and axes for one are given"):
        draw("force-gap", cube, ax=ax)


@some(CUBE_FIGURES, "force-gap", "profiles", "fragility")
def test_panels_show_all_of_their_lines(key):
    """Panels share axes, and the values of the last one are the largest; intervals of gaps may end outside."""
    cube = made.cube(right_wall=True, gap=2, restitution=1, record=2, scale=3)
    for dim in ("pair", "building"):
        growing = xr.DataArray(10.0 ** np.arange(cube.sizes[dim]), dims=dim)
        cube = cube.assign({name: v * growing for name, v in cube.data_vars.items() if dim in v.dims})
    for ax in draw(key, cube).axes:
        for line in (line for line in ax.lines if line.get_transform() is ax.transData and line.get_marker() != "|"):
            for values, (low, high) in ((line.get_xdata(), ax.get_xlim()), (line.get_ydata(), ax.get_ylim())):
                finite = np.asarray(values, float)[np.isfinite(values)]
                assert ((low <= finite) & (finite <= high)).all(), (ax.get_title(), line.get_label())


def cells(ax):
    """Values of the grey cells of a panel of a map, and of the coloured ones."""
    return [np.ma.filled(mesh.get_array(), np.nan) for mesh in ax.collections if hasattr(mesh, "get_coordinates")]


def test_drift_ratios_are_drawn_in_per_cent():
    cube = made.cube(scale=3)
    cube["drift_ratio_max"] = (cube["drift_max"] / 3.0).assign_attrs(
        long_name="largest interstorey drift ratio", units="1"
    )
    drawn = {name: draw("incremental", cube, value=name) for name in ("drift_max", "drift_ratio_max")}
    assert "largest interstorey drift ratio (%)" in " ".join(drawn["drift_ratio_max"].axes[-1].get_xlabel().split())
    x, y = (figure.axes[0].lines[0].get_xdata() for figure in drawn.values())  # mm and %
    np.testing.assert_allclose(y, 100.0 * x / 3000.0)


@pytest.mark.parametrize("key", ["incremental", "fragility", "ground-motion"])
def test_accelerations_in_g(key, tmp_path, monkeypatch):
    """Axes of accelerations have round numbers of g, texts have their numbers in it; nothing drawn moves."""
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure))
    options = {"fragility": {"event": "acceleration", "level": 1.0}, "incremental": {"value": "acceleration_max"}}
    dataset = made.spectra() if key == "ground-motion" else made.cube(record=3, scale=4)
    for units in ("m/s2", "g"):
        plot(dataset, key, tmp_path / f"{units[0]}.png", units=units, **options.get(key, {}))
    metric, changed = figures
    labels = []
    for before, after in zip(metric.axes, changed.axes, strict=True):
        assert (before.get_xlim(), before.get_ylim()) == (after.get_xlim(), after.get_ylim())
        for one, other in ((before.xaxis, after.xaxis), (before.yaxis, after.yaxis)):
            label = one.get_label_text() or before.figure.get_supylabel() * (one is before.yaxis)
            ticks = other.get_major_locator()()
            if "(m/s²)" in label:
                written = [float(other.get_major_formatter()(tick)) for tick in ticks]
                np.testing.assert_allclose(9.81 * np.array(written), ticks, atol=1e-9)
            elif label:
                np.testing.assert_array_equal(ticks, one.get_major_locator()())
            labels.append(label)
    assert any("(m/s²)" in label for label in labels)
    texts = " ".join(text.get_text() for text in changed.findobj(Text))
    assert "m/s²" not in texts
    assert ("above 0.102 g" in texts) == (key == "fragility")
    with pytest.raises(InputError, match="unknown unit of accelerations 'gal'; valid: g, m/s2"):
        plot(dataset, key, tmp_path / "no.png", units="gal")


def test_maps_over_records_and_heights_of_impact_say_what_is_hatched():
    cube = made.cube(record=3, right_wall=True).sel(law=["none", "linear"])
    want = cube[FORCE].sel(law="linear", restitution=0.4).squeeze(drop=True)
    for name, values in (("record", want.max("storey")), ("storey", want.median("record"))):
        figure = draw("map", cube, y=name)
        for ax, pair in zip(figure.axes, ("a-b", "b-w2"), strict=False):
            grey, shown = cells(ax)
            np.testing.assert_array_equal(
                np.where(np.isnan(grey), shown, 0.0), values.sel(pair=pair).transpose(name, "gap")
            )
        assert not figure.legends
    refused = masked(cube, (cube["gap"] > 0.002) & (cube["status"] == 0))
    assert "hatched: info --status says why" in title("map", refused)
    low = cube.assign(drift_max=cube["drift_max"].where((cube["storey"] < 3) | (cube["building"] == "b")))
    legend = draw("map", low, y="storey", value="drift_max").legends[0]
    assert [text.get_text() for text in legend.texts] == ["no such storey or not ok"]


def test_axes_of_impacts_are_logarithmic_where_they_span_decades():
    for factor, scales in ((1, ("linear", "linear")), (100, ("symlog", "log"))):
        cube = made.cube(stiffness_factor=3).assign(impact_count=lambda cube, by=factor: by * cube["impact_count"])
        axes = draw("force-gap", cube).axes[1], draw("map", cube, value="impact_count").axes[-1]
        assert tuple(ax.get_yscale() for ax in axes) == scales


def test_the_map_shows_medians_over_records_and_where_nothing_touches():
    cube = made.cube(record=3, stiffness_factor=3).sel(law=["none", "linear"], gap=[0.004, 0.002, 0.008])
    cube = cube.assign({FORCE: cube[FORCE] * (cube["gap"] > 0.002)})
    ax = draw("map", cube).axes[0]
    free, peaks = cells(ax)
    want = cube[FORCE].sel(law="linear", pair="a-b", restitution=0.4).max("storey").median("record").squeeze()
    want = want.sortby("gap").transpose("stiffness_factor", "gap").values
    np.testing.assert_allclose(peaks, np.where(want > 0.0, want, np.nan))
    np.testing.assert_array_equal(np.isfinite(free), want == 0.0)
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["2", "4", "8"]
    assert (ax.get_yscale(), ax.get_title()) == ("log", "Linear spring\npair a-b")
    few = cube.assign({FORCE: cube[FORCE].where(cube["record"] == "r1", 0.0)}).sortby("gap")
    figure = draw("map", few)
    free, peaks = cells(figure.axes[0])
    assert np.isnan(peaks).all()  # the median over records is 0 everywhere
    assert (free[:, 0] == 1.8).all()  # nothing touches under any record
    assert free[:, 1:] == pytest.approx(0.9 - 1 / 3)
    assert {text.get_text() for text in figure.axes[0].texts} == {"33%"}
    names = [text.get_text() for text in figure.legends[0].texts]
    assert names == ["no contact", "less than half of the records touch"]


def test_onsets_of_contact_and_reported_peaks_are_marked():
    one = made.histories(left_wall=True)
    for ax, name in zip(draw("closing", one).axes, ("w1-a", "a-b"), strict=True):
        marks = sorted(t for line in ax.lines if line.get_marker() == "o" for t in line.get_xdata())
        deep = one.penetration.sel(pair=name).fillna(0.0).transpose("time", "storey").values > 0.0
        assert marks == sorted(np.repeat(one.time.values[1:, None], deep.shape[1], axis=1)[deep[1:] & ~deep[:-1]])
    later = draw("histories", made.reported(), start=1.0, end=1.5)  # after the peaks
    assert not [line for ax in later.axes for line in ax.lines if line.get_marker() == "o"]
    assert later.axes[-1].get_xlim() == (1.0, 1.5)
    for key in ("histories", "force-penetration"):
        assert draw(key, made.histories(touch=False)).axes[-1].texts[0].get_text() == "no contact"


def test_loops_of_a_contact_hold_what_it_took():
    """Of a law that keeps half of its force as floors part, half of the work."""
    one = made.histories()
    opening = one.penetration.differentiate("time") < 0
    lossy = one.assign(contact_force=one.contact_force.where(~opening, 0.5 * one.contact_force))
    depth, force = (np.nan_to_num(values) for values in draw("force-penetration", lossy).axes[0].lines[1].get_data())
    put_in = sum(np.maximum(np.diff(0.5e6 * one.penetration.sel(storey=2).values[:, 0] ** 2), 0.0))
    assert np.trapezoid(force, 1e-3 * depth) == pytest.approx(0.5 * put_in, rel=0.05)


def test_the_force_is_upright_where_it_jumps():
    """A force 7 + 1000 d that pulls as floors part, another that jumps nowhere, and floors apart in between."""
    depth = np.array([0, 0, 1, 3, 4, 2, 1, 0, 0, 0]) * 1e-3
    sign = np.sign([0, 0, 1, 1, 1, -1, -1, 0, 0, 0])
    for force, first, last in ((sign * (7.0 + 1e3 * depth), 7.0, -7.0), (1e3 * depth**1.5, 0.0, 0.0)):
        one = made.histories().isel(time=slice(len(depth)))
        values = {"penetration": depth, "contact_force": force}
        one = one.assign({name: 0.0 * one[name] + xr.DataArray(v, dims="time") for name, v in values.items()})
        x, y = draw("force-penetration", one).axes[0].lines[0].get_data()
        assert x.tolist()[:3] == [0.0, 0.0, 1.0]
        assert y[:3] == pytest.approx([0.0, first, force[2]])
        assert y[-4:-1] == pytest.approx([force[6], last, 0.0])
        assert np.isnan(y[-1])


def test_fragility_shows_buildings_without_pounding():
    """One line where the axis is of the contacts alone, as gaps are, one for each value of another."""
    cube = made.cube(record=6, scale=4, gap=2, restitution=1)
    response = cube["scale"] * (1.0 + 0.1 * xr.DataArray(np.arange(6), dims="record")) + 0.0 * cube["drift_max"]
    cube = cube.assign(drift_max=0.01 * response.where(cube["law"] == "none", 2.0 * response))
    lines = draw("fragility", cube, event="drift", level=0.012).axes[0].get_legend_handles_labels()[1]
    assert [line.partition(":")[0] for line in lines] == ["gap 2 mm", "gap 4 mm", "No pounding"]
    alone = fragility(cube, "drift", 0.012).sel(law="none", building="a").isel(gap=0)
    assert f"median {alone['median'].item():.3g} m/s²" in lines[-1].replace("\n", " ")
    factors = cube.rename(gap="mass_factor_a")
    factors["drift_max"] = factors["drift_max"] * factors["mass_factor_a"] / 0.003
    lines = draw("fragility", factors, event="drift", level=0.012).axes[0].get_legend_handles_labels()[1]
    assert sum(line.startswith("No pounding; mass factor a") for line in lines) == 2


def test_fragility_shows_its_trials_and_bands():
    cube = made.cube(right_wall=True, record=4, scale=5)
    weak = (cube["pair"] != "a-b") | (cube["scale"] < 1.0)
    cube = cube.assign(impact_count=cube["impact_count"].where(weak))
    first, second = draw("fragility", cube).axes  # trials that the first pair has not
    farthest = [max(np.max(line.get_xdata(), initial=0.0) for line in ax.lines) for ax in (first, second)]
    assert farthest[0] < farthest[1] < second.get_xlim()[1]
    cube = made.cube(record=6, scale=4)  # marks of stripes
    pga = {"pga": xr.DataArray([1.0, 2.0, 3.0, 4.0], dims="pga"), "record_pga": ("record", np.full(6, 2.0))}
    stripes = cube.drop_vars("scale").rename(scale="pga").assign_coords(pga)
    stripes = stripes.assign_coords(scale=(("record", "pga"), np.tile([0.5, 1.0, 1.5, 2.0], (6, 1))))
    assert draw("fragility", stripes.isel(gap=[0])).axes[0].lines[-1].get_xdata().tolist() == [1, 2, 3, 4]
    ax = draw("fragility", made.suite()).axes[0]
    x = np.concatenate([path.vertices[:, 0] for path in ax.collections[0].get_paths()])
    assert (x.min(), x.max()) == (ax.lines[0].get_xdata().min(), ax.lines[0].get_xdata().max())  # no cut edge
    assert ax.lines[0].get_xdata().min() < 0.1  # the curve itself begins there


@pytest.mark.parametrize(
    ("factor", "bands", "notes"),
    [
        (5.0, 1, "6 records: give 20 or more"),
        (12.0, 0, "(a) no band: the confidence interval of the median or dispersion spans more than a factor of 10"),
        (np.nan, 0, "(a) no band: one record alone, or records that too often go back"),
    ],
)
def test_fragility_of_any_event_has_a_band_if_its_interval_is_not_too_wide(factor, bands, notes):
    cube = made.suite()
    drift = 0.02 * cube["impact_count"].isel(pair=0, drop=True) + 0.0 * cube["drift_max"]
    result = fragility(cube.assign(drift_max=drift), "drift", 0.01)
    result["dispersion_interval"][:] = xr.DataArray([1.0, factor], dims="bound")
    result["median_interval"][:] = xr.DataArray([1.0, 2.0], dims="bound")
    figure = draw("fragility", result)
    assert len(figure.axes) == 2
    assert [sum(bool(c.get_paths()) for c in ax.collections) for ax in figure.axes] == [bands, bands]
    assert notes in figure.get_supxlabel().replace("\n", " ") or notes in figure.caption
    assert all(("(a)" in text) != bands for text in figure.axes[0].get_legend_handles_labels()[1])
    assert (factor > 10.0) == ("no band" in fit_rows(result)[0]["fit"])
    with pytest.raises(InputError, match="of the event 'drift', not 'touch'"):
        draw("fragility", result, event="touch")


@some(("fragility", "incremental"), "fragility")
def test_figures_of_suites_name_laws_and_records_and_take_the_spacing_of_scales(key):
    cube = made.cube(record=2, scale=4, law=2).isel(gap=[0])
    for scales, spacing in (([0.5, 1.0, 1.5, 2.0], "linear"), ([0.25, 0.5, 1.0, 2.0], "log")):
        figure = draw(key, cube.assign_coords(scale=scales))
        assert {ax.get_yscale() if key == "incremental" else ax.get_xscale() for ax in figure.axes} == {spacing}
        assert figure.caption[1] == "2 records"
        assert "Linear spring" in "".join(figure.caption) + figure.axes[0].get_title()
    assert "record Imperial Valley 1940" in title(key, cube.isel(record=[0]).assign_coords(record=["el_centro"]))


@pytest.mark.parametrize(
    ("pga", "fractiles", "why"),
    [
        ([1.0], [], "fractiles of 16%, 50%, 84% need 7, 2, 7 curves at one intensity, at most 1 reach"),
        ([0.1, 1.0, 100.0], [], "16%, 50%, 84% need 7, 2, 7 curves at one intensity, at most 1 reach"),
        ([0.9, 1.0, 1.1], ["median"], "fractiles of 16%, 84% need 7, 7 curves at one intensity, at most 3"),
        ([1.0] * 7, ["16% fractile", "median", "84% fractile"], ""),
        ([1.0] * 12 + [9.0] * 4, ["16% fractile", "median", "84% fractile"], ""),
    ],
)
def test_incremental_draws_fractiles_that_enough_records_reach(pga, fractiles, why):
    cube = made.cube(record=len(pga), scale=3).assign_coords(record_pga=("record", pga))
    figure = draw("incremental", cube)
    assert [text.get_text() for text in figure.legends[0].texts][1:] == fractiles
    assert why in figure.caption[-1]
    assert ("fractile" in figure.caption[-1]) == bool(why)


@pytest.mark.parametrize("turn", [False, True])
def test_incremental_is_of_the_largest_over_storeys_upright_or_turned(turn):
    cube = made.cube(law=1, gap=1, restitution=1, record=8, scale=3).assign_coords(record_pga=("record", [2.0] * 8))
    figure = draw("incremental", cube, value="drift_max", turn=turn, names=True)
    assert "drift (mm)" in (figure.axes[0].get_ylabel() if turn else figure.axes[0].get_xlabel()).replace("\n", " ")
    curves = {line.get_label(): line.get_data()[:: -1 if turn else 1] for line in figure.axes[1].lines}
    drift = 1e3 * cube["drift_max"].sel(building="b").max("storey").squeeze().transpose("record", "scale").values
    np.testing.assert_allclose(curves["r8"], (drift[-1], 2.0 * cube["scale"]))
    np.testing.assert_allclose(curves["84% fractile"][0], np.quantile(drift, 0.84, axis=0))
    assert len({(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines}) == 8 + 3


@pytest.mark.parametrize("turn", [False, True])
def test_incremental_has_an_axis_for_each_building(turn):
    cube = made.cube(record=3, scale=3)
    cube = cube.assign(drift_max=cube["drift_max"] * xr.DataArray([1.0, 10.0], dims="building"))
    grid = draw("incremental", cube, value="drift_max", turn=turn).axes
    ends = [(ax.get_ylim if turn else ax.get_xlim)()[1] for ax in grid]
    assert ends[1] > 5.0 * ends[0]
    assert ends[0] == ends[2]  # of the laws below
    assert len({(ax.get_xlim if turn else ax.get_ylim)() for ax in grid}) == 1


@some(("force-gap", "amplification", "law-comparison", "incremental", "required-gap"), "force-gap")
def test_legends_stand_inside_their_figures(key):
    """Of one pair or building, with long names of laws."""
    cube = made.cube(scale=3).assign_coords(law=["nonlinear_viscoelastic", "modified_kelvin_voigt", "none"])
    figure = draw(key, cube.sel(building=["a"]) if key == "amplification" else cube)
    figure.draw_without_rendering()
    inside, whole = figure.legends[0].get_window_extent(), figure.bbox
    assert whole.x0 <= inside.x0 <= inside.x1 <= whole.x1
    assert whole.y0 <= inside.y0 <= inside.y1 <= whole.y1


def test_a_row_that_is_not_told_is_asked_for():
    one = made.histories()
    for changed in ({}, {"scene": "["}, {"scene": '{"row": []}'}, {"scene": '{"row": [1], "gaps": [], "contact": {}}'}):
        with pytest.raises(InputError, match=r"does not carry its row of buildings.*simulate the scenario again"):
            draw("row", one.drop_attrs().assign_attrs(changed))


@pytest.mark.parametrize("walls", [(False, False), (True, False), (False, True), (True, True)])
def test_floors_overlap_in_the_drawing_as_far_as_they_penetrate(walls):
    """Faces of neighbours are as far apart as gap and displacements make them, times the factor."""
    one = made.histories(*walls, names=("wall-west", "wall", "wall-b", "wall-wall"))  # whose pairs begin and end alike
    axes, factor, show = draw_row(one)
    assert f"{factor:.0e}"[0] in "125"
    row, first = stored_scene(one), int(walls[0])
    still = [np.tile(wall.get_paths()[0].get_extents().intervalx, (3, 1)) for wall in axes[0, 0].collections[:-1]]
    assert len(still) == sum(walls)
    for number in (0, 7, 25, 60, 400):
        show(number, np.zeros(one.penetration.shape[1:]))
        faces = [line.get_xdata().reshape(-1, 3)[:, :2] for line in axes[0, 0].lines[3::3]]
        faces = [*still[:first], *faces, *still[first:]]
        for contact in row.contacts:
            i, s = contact.pair, contact.storey - 1
            u = [one.displacement.values[number, j - first, s] if 0 <= j - first < 2 else 0.0 for j in (i, i + 1)]
            overlap = factor * (u[0] - u[1] - row.gaps[i])
            assert faces[i][s, 1] - faces[i + 1][s, 0] == pytest.approx(overlap, abs=1e-12)


def test_a_wall_stands_as_high_as_the_floors_that_it_meets():
    low, high = (
        wall.get_paths()[0].get_extents().y1 for wall in draw("row", made.histories(True, True)).axes[0].collections[:2]
    )
    assert (low, high) == (9.0, 6.0)


def test_the_row_stands_at_its_strongest_impact():
    one, apart = made.histories(), made.histories(touch=False)
    figure = draw("row", one)
    assert figure.axes[0].collections[0].get_offsets()[:, 1].tolist() == [3.0, 6.0]
    at = one.contact_force.max(["pair", "storey"]).idxmax("time")
    assert f"{at:.3f} s, largest force {one.contact_force.max():.0f} kN" in figure.get_suptitle()
    assert f"drawn {draw_row(one)[1]:g} times" in figure.axes[0].get_xlabel()
    assert f"{abs(apart.displacement).max(['building', 'storey']).idxmax('time'):.3f} s" in title("row", apart)


def test_a_gif_moves(tmp_path):
    path = animate(made.histories(True, False), tmp_path / "row.gif", frames=3, speed=0.25, start=0.0, end=0.5)
    with Image.open(path) as gif:
        assert gif.n_frames == 3
        pictures, pauses = set(), []
        for number in range(gif.n_frames):
            gif.seek(number)
            pictures.add(gif.convert("RGB").tobytes())
            pauses.append(gif.info["duration"])
    assert len(pictures) == 3
    assert sum(pauses[1:]) == pytest.approx(1e3 * 0.5 / 0.25, rel=0.05)
    alone = made.histories().isel(building=[0]).drop_dims("pair")  # no contacts to draw, four periods by default
    assert len(draw("histories", alone).axes) == 2
    with Image.open(animate(alone, tmp_path / "row.gif", frames=2)) as gif:
        assert gif.n_frames == 2


def test_a_short_impact_between_two_pictures_is_marked_and_fades():
    forces = np.zeros((401, 1))
    forces[203] = 0.5
    seen = fading_marks(forces, np.array([190, 200, 210, 220, 230]))[:, 0]
    assert seen.tolist() == pytest.approx([0.0, 0.0, 0.5, 0.3, 0.18])


def test_what_cannot_be_animated_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("matplotlib.animation.FFMpegWriter.isAvailable", lambda: False)
    for name, options, text in (
        ("row.mp4", {}, "no ffmpeg"),
        ("row.txt", {}, "ending in .gif or .mp4"),
        ("no_folder/row.gif", {}, "can't write"),
        ("row.gif", {"frames": 1}, "at least 2"),
        ("row.gif", {"speed": 0.0}, "positive number"),
        ("row.gif", {"start": 5.0, "end": 6.0}, "fewer than two instants"),
    ):
        with pytest.raises((InputError, OutputError), match=text):
            animate(made.histories(), tmp_path / name, **options)
    with pytest.raises(InputError, match="pounding-sweep simulate"):
        animate(made.cube(), tmp_path / "row.gif")


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


def test_plot_on_the_command_line(tmp_path, not_rendered):
    periods, cube, one, picture = (tmp_path / name for name in ("periods.nc", "cube.nc", "one.nc", "x.png"))
    write_cube(made.of_periods(), periods)
    write_cube(made.cube(), cube)
    write_cube(made.histories(), one)
    listed = call("plot", "--list").stdout
    assert [key for key in FIGURES if not re.search(rf"^(figure +)?{key}\b", listed, re.MULTILINE)] == []
    possible, others = call("plot", cube).stdout.split("not possible")
    assert re.search(r"^(figure +)?force-gap\b", possible, re.MULTILINE)
    assert re.search(r"^histories +several times, ground_acceleration, displacement$", others, re.MULTILINE)
    words = ("plot", periods, "map", "-o", picture, "--dpi", "20")
    call(*words, "--x", "gap", "--y", "period_ratio", "--value", "drift_max_ratio", "--contours")
    assert picture.exists()
    assert not_rendered == [{"dpi": 20.0}]
    call("plot", cube, "profiles", "-o", picture, "--at", "gap=0.004", "--at", "law=linear")
    call("plot", one, "phase", "-o", picture, "--start", "0.5", "--end", "1")
    told = call("plot", cube, "force-gap", "-o", picture, "--at", "gap=0.002", "--at", "gap=0.008").stderr
    assert "--at restitution=... for another" in told
    text, words = tmp_path / "x.txt", ("plot", cube, "profiles", "-o", picture, "--caption", tmp_path / "x.txt")
    for more, first in ((["--title", "School"], "School"), (["--no-title"], "by hand; Peak responses over the height")):
        call(*words, *more)
        heading, values = text.read_text().splitlines()
        assert heading == first
        assert values.startswith("gap 4 mm (one of 4); restitution 0.4 (one of 2)")
    for words, text in (
        ((), "give CUBE.nc FIGURE"),
        ((cube, "profiles"), "-o is missing"),
        ((cube, "profiles", "-o", picture, "--at", "gap"), "AXIS=VALUE"),
        ((one, "histories", "-o", picture, "--x", "gap"), "'histories' takes no x; it takes start, end"),
    ):
        assert text in call("plot", *words, code=2).stderr


@pytest.mark.usefixtures("not_rendered")
def test_a_part_without_values_is_refused_by_the_command(tmp_path):
    cube, file, picture = made.cube(record=2), tmp_path / "cube.nc", tmp_path / "x.png"
    write_cube(masked(cube, (cube["record"] == "r1") & (cube["law"] == cube["law"])), file)
    message = call("plot", file, "force-gap", "-o", picture, "--at", "record=r2", code=2).stderr
    assert "nothing to draw at record r2: 24 of 24 scenarios are not_run" in message
    assert not picture.exists()
    call("plot", file, "force-gap", "-o", picture, "--at", "record=r1")
    with pytest.raises(InputError, match=r"needs a law with contact, .*: choose others with --at, or run .* a law"):
        plot(cube.sel(law=["none"]), "force-gap", picture)
    with pytest.raises(InputError, match="has nothing to draw: none of its values is a number"):
        plot(amplification(cube).where(False), "amplification", picture)


def test_choices_of_a_scenario_on_the_command_line(tmp_path):
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
        for name, suffix in (("simulate", "nc"), ("animate", "gif")):
            assert text in call(name, sweep, "-o", tmp_path / f"x.{suffix}", *words, code=2).stderr
    assert "ending in .gif" in call("animate", sweep, "-o", tmp_path / "x.avi", code=2).stderr


@pytest.mark.slow
def test_a_scenario_from_its_file_to_its_pictures(tmp_path):
    sweep, one, gif = (tmp_path / name for name in ("s.toml", "one.nc", "row.gif"))
    sweep.write_text(SWEEP)
    done = call("simulate", sweep, "-o", one, "--stiffness", "3e6")
    assert done.stdout.splitlines() == [str(one)]
    assert "Kelvin-Voigt without tension; gap 5 mm; stiffness 3e+06 kN" in done.stderr
    call("simulate", sweep, "-o", one, "--overwrite")
    spec = ps.load_sweep(sweep).spec
    scene = spec.scene.with_gaps([0.005, 0.005])
    with open_cube(one) as cube:
        assert cube.pair_gap.values.tolist() == [0.005, 0.005]
        assert stored_scene(cube) == scene
        want = ps.simulate(scene, spec.records[0], law="kelvin_voigt")
        np.testing.assert_array_equal(cube.contact_force, want.contact_force)
    assert call("plot", one, "histories", "-o", tmp_path / "h.png").stdout.strip() == str(tmp_path / "h.png")
    call("animate", sweep, "-o", gif, "--frames", "3", "--gap", "0.001", "--start", "0.2", "--end", "1")
    with Image.open(gif) as picture:
        assert picture.n_frames == 3
    assert "exists" in call("simulate", sweep, "-o", one, code=2).stderr

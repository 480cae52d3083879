"""Figures of cubes that are not complete: what they show of it, and what they say where there is nothing."""

from __future__ import annotations

import figure_data as made
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from pounding_sweep.analysis import amplification
from pounding_sweep.analysis.scenarios import TOUCH_VARIABLES
from pounding_sweep.base.errors import InputError
from pounding_sweep.cli.app import app
from pounding_sweep.figures import FIGURES, plot
from pounding_sweep.figures.shown import middle, shows_values
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.netcdf import write_cube
from pounding_sweep.outputs.variables import Status

CUBE_FIGURES = [key for key, kind in FIGURES.items() if kind.source == "cube"]


def only(cube, there, status=Status.NOT_RUN):
    """A cube whose scenarios have values where `there` is true, and that status elsewhere."""
    found = cube.assign({name: v.where(there) for name, v in cube.data_vars.items() if v.dtype.kind == "f"})
    found["status"] = cube["status"].where(there, int(status)).astype("i1")
    return found


def nowhere(cube):
    return xr.zeros_like(cube["status"], dtype=bool)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


# -- nothing to draw ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def empty():
    """A cube that all figures can be drawn from, and the same without a value."""
    whole = made.cube(record=2, scale=3, gap=1, stiffness_factor=2, restitution=1).squeeze("gap")
    return whole, only(whole, nowhere(whole))


@pytest.mark.parametrize("key", CUBE_FIGURES)
def test_a_figure_without_a_value_is_an_error(key, empty, tmp_path):
    whole, cube = empty
    assert not FIGURES[key].lacks(whole)
    picture = tmp_path / "figure.png"
    with pytest.raises(InputError, match=f"figure '{key}' has nothing to draw") as error:
        plot(cube, key, picture)
    assert "at gap 2 mm: 36 of 36 scenarios are not_run; choose others with --at" in str(error.value)
    assert not picture.exists()


def test_a_result_without_a_value_is_told(tmp_path):
    result = amplification(made.cube())
    assert shows_values(FIGURES["amplification"].draw(result))
    with pytest.raises(InputError, match="has nothing to draw: none of its values is a number"):
        plot(result.where(False), "amplification", tmp_path / "x.png")


@pytest.mark.usefixtures("not_rendered")
def test_a_cube_of_the_law_without_contact_has_no_forces(tmp_path):
    cube = made.cube().sel(law=["none"])
    with pytest.raises(InputError, match=r"needs a law with contact, .*: choose others with --at, or run .* a law"):
        plot(cube, "force-gap", tmp_path / "x.png")
    plot(cube, "profiles", tmp_path / "y.png")
    with pytest.raises(InputError, match="at No pounding: 8 of 8 scenarios are diverged"):
        plot(only(cube.isel(law=0), nowhere(cube.isel(law=0)), Status.DIVERGED), "profiles", tmp_path / "z.png")


@pytest.mark.usefixtures("not_rendered")
def test_the_command_says_it_and_fails(tmp_path):
    cube = made.cube(record=2)
    file, picture = tmp_path / "cube.nc", tmp_path / "x.png"
    write_cube(only(cube, (cube["record"] == "r1") & (cube["law"] == cube["law"])), file)
    words = ["plot", str(file), "force-gap", "-o", str(picture), "--at"]
    done = CliRunner().invoke(app, [*words, "record=r2"])
    assert done.exit_code == 2
    assert "nothing to draw at record r2: 24 of 24 scenarios are not_run" in done.stderr
    assert not picture.exists()
    assert CliRunner().invoke(app, [*words, "record=r1"]).exit_code == 0


# -- where something happens ----------------------------------------------------------------------------------------


def test_the_scenario_next_to_the_middle_that_has_values():
    cube = made.cube(restitution=5, record=5).isel(scale=0, drop=True)
    centre = "restitution 0.8 (one of 5); record r3 (one of 5)"
    assert middle(cube, ("law", "gap"))[1] == centre
    there = nowhere(cube)
    for place in ({"restitution": 0, "record": 0}, {"restitution": 3, "record": 1}, {"restitution": 4, "record": 4}):
        there[{"law": 0, "gap": 3, **place}] = True
    assert middle(only(cube, there), ("law", "gap"))[1] == "restitution 1 (one of 5); record r2 (one of 5)"
    unsure = only(cube, there, Status.UNDER_RESOLVED_CONTACT).assign(impact_count=cube["impact_count"])
    assert middle(unsure, ("law", "gap"))[1] == centre  # they have values, and touch
    assert middle(only(cube, nowhere(cube)), ("law", "gap"))[1] == centre
    figure = FIGURES["force-gap"].draw(only(cube, there))
    assert figure.get_suptitle() == "restitution 1 (one of 5); record r2 (one of 5)"
    assert shows_values(figure)


def test_the_scenario_next_to_the_middle_that_touches():
    """Floors that never touch have nothing to show; what was taken is told, and of how many values."""
    cube = made.cube(gap=6, restitution=3)
    touches = (cube["gap"] < 0.003) & (cube["restitution"] > 0.5) & (cube["law"] != "none")
    cube["impact_count"] = cube["impact_count"].where(touches, 0)
    assert middle(cube, ("law",))[1].startswith("gap 2 mm (one of 6); restitution 0.6 (one of 3)")
    assert middle(cube.assign(impact_count=0 * cube["impact_count"]), ("law",))[1].startswith("gap 6 mm (one of 6)")
    blind = cube.drop_vars([name for name in TOUCH_VARIABLES if name in cube])
    assert middle(blind, ("law",))[1].startswith("gap 6 mm (one of 6)")
    result = amplification(cube)  # which says itself what touches
    assert middle(result, ("law",))[1].startswith("gap 2 mm (one of 6)")


def test_of_a_result_its_values_tell():
    values = np.full((3, 3, 2), np.nan)
    values[2, 0, 1] = 1.0
    result = xr.Dataset(
        {"drawn": (("scale", "gap", "law"), values), "other": (("scale",), np.ones(3)), "touches": ("gap", [1, 1, 1])},
        {"scale": [1.0, 2.0, 3.0], "gap": [1.0, 2.0, 3.0], "law": ["linear", "hertz"]},
    )
    found, shown = middle(result, ["law"], ["drawn"])
    assert shown == "gap 1 (one of 3); scale 3 (one of 3)"
    assert found["drawn"].values.tolist() == pytest.approx([np.nan, 1.0], nan_ok=True)
    assert middle(result, ["law"])[1] == "gap 2 (one of 3); scale 2 (one of 3)"  # where another variable has a value


def test_forces_are_looked_for_among_laws_with_contact():
    cube = made.cube(record=3)
    there = (cube["law"] == "none") | (cube["record"] == "r3") & (cube["status"] == 0)
    assert FIGURES["force-gap"].draw(only(cube, there)).get_suptitle().endswith("record r3 (one of 3); scale 0.5")


@pytest.mark.parametrize("key", [pytest.param("amplification", marks=pytest.mark.slow), "law-comparison"])
def test_a_median_counts_the_records_that_have_values(key):
    cube = made.cube(record=3)
    assert "median of 3 records" in FIGURES[key].draw(cube).get_suptitle()
    there = (cube["record"] != "r2") & (cube["status"] == 0)
    assert "median of 2 of 3 records" in FIGURES[key].draw(only(cube, there)).get_suptitle()


# -- laws without values -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "key", ["force-gap", *(pytest.param(key, marks=pytest.mark.slow) for key in ("amplification", "law-comparison"))]
)
def test_laws_without_values_are_not_in_the_legend(key):
    laws = [LAWS[key].title for key in ("kelvin_voigt", "linear", "none")]
    cube = made.cube().assign_coords(law=["linear", "kelvin_voigt", "none"])
    cube = xr.concat([cube, cube.isel(law=[0]).assign_coords(law=["hertz"])], "law", combine_attrs="override")
    assert "Hertz" in legend(FIGURES[key].draw(cube))
    there = (cube["law"] != "hertz") & (cube["status"] == 0)
    shown = legend(FIGURES[key].draw(only(cube, there)))
    assert set(shown) <= set(laws)
    assert set(laws[:2]) <= set(shown)


def test_laws_without_values_have_no_panels_of_profiles():
    cube = made.cube()
    more = [cube.isel(law=[0]).assign_coords(law=[law]) for law in ("hertz", "hertz_damped")]
    cube = xr.concat([cube, *more], "law", combine_attrs="override")
    there = (cube["law"] != "hertz") & (cube["status"] == 0)
    for given, rows in (
        (cube, ["linear", "kelvin_voigt", "hertz", "hertz_damped"]),
        (only(cube, there), ["linear", "kelvin_voigt", "hertz_damped"]),
    ):
        axes = FIGURES["profiles"].draw(given).axes
        labels = [ax.get_ylabel().replace("\n", " ") for ax in axes[::2]]
        assert labels == [f"{LAWS[law].title} elevation (m)" for law in rows]


def test_laws_without_values_have_no_bar():
    cube = made.cube()
    figure = FIGURES["energy-budget"].draw(only(cube, (cube["law"] != "linear") & (cube["status"] == 0)))
    assert [text.get_text().replace("\n", " ") for text in figure.axes[0].get_xticklabels()] == [
        LAWS["kelvin_voigt"].title
    ]

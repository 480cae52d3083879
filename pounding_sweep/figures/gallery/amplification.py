"""Responses with pounding over responses without, by building."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import CONTACT, NO_CONTACT, figure_of
from pounding_sweep.figures.shown import (
    along,
    drawn_axis,
    first_varied,
    labels_with_values,
    middle_over_records,
    result_of,
)
from pounding_sweep.figures.style import label_edges, legend_below, look, put_title, subplots

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: Responses, the first three of which that are there are drawn.
_ROWS = (
    ("displacement_peak_ratio", "displacement"),
    ("drift_max_ratio", "drift"),
    ("acceleration_max_ratio", "acceleration"),
    ("storey_shear_max_ratio", "storey shear"),
    ("displacement_max_ratio", "displacement to the right"),
    ("displacement_min_ratio", "displacement to the left"),
)


#: Of which a cube must have one, and what the comparison makes of them.
_RESPONSES = "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max"
_RATIOS = "|".join(f"{name}_ratio" for name in _RESPONSES.split("|"))


@figure_of(
    "cube",
    "responses with pounding over responses without, by building and law",
    needs=(
        "law",
        f"{_RESPONSES}|{_RATIOS}",
        CONTACT,
        f"{NO_CONTACT}|{_RATIOS}",
    ),
)
def amplification(cube: xr.Dataset) -> Figure:
    """Draw the amplification by pounding against gap, stiffness, scale, restitution or a building property.

    One column per building, one row per response, one line per law that has values: the
    largest over storeys; over the storeys themselves where no axis varies. Of several
    records the median is shown, of the other axes the middle value, which the title
    names. The thin line at 1 is no change.
    """
    result = result_of(cube, "amplification")
    if "case" in result.dims:
        msg = (
            "figure 'amplification' needs axes, and this cube lists its scenarios as cases; give the axes of the sweep"
        )
        raise InputError(msg)
    result = along(along(along(result, "law"), "building"), "storey")
    rows = [row for row in _ROWS if row[0] in result][:3]
    if not rows:
        msg = (
            "figure 'amplification' shows displacements, drifts, accelerations and shears, none of which this cube has"
        )
        raise InputError(msg)
    names = [name for name, _ in rows]
    axis = first_varied(result)
    result, shown = middle_over_records(result, ("law", axis or "storey"), names)
    result = result.sortby(axis or "storey")
    buildings, laws = result["building"].values.tolist(), labels_with_values(result, "law", names)
    figure, axes = subplots(len(rows), len(buildings), (1.6 + 2.4 * len(buildings), 1.3 + 1.7 * len(rows)))
    x, label = drawn_axis(result, axis) if axis else (result["storey"].values, "storey (-)")
    for row, (name, _) in enumerate(rows):
        for column, building in enumerate(buildings):
            ax = axes[row, column]
            ax.axhline(1.0, color="0.6", linewidth=0.8, zorder=0)
            for number, law in enumerate(laws):
                values = result[name].sel(law=law, building=building)
                ax.plot(x, values.max("storey") if axis else values, label=law, **look(number))
            if axis is None:
                ax.set_xticks(x)
            if row == 0:
                ax.set_title(f"building {building}")
    label_edges(axes, label, [f"{text}\nover no pounding (-)" for _, text in rows])
    legend_below(figure, axes[0, 0])
    put_title(figure, shown)
    return figure

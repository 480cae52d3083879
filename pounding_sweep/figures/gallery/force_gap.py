"""Peak impact force and number of impacts against the gap, law by law."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pounding_sweep.analysis.scenarios import pounding_only
from pounding_sweep.figures import CONTACT, figure_of
from pounding_sweep.figures.shown import along, labels_with_values, middle
from pounding_sweep.figures.style import label_edges, legend_below, look, put_title, start_at_zero, subplots

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_ROWS = (("impact_force_max", "peak impact force (MN)", 1e-3), ("impact_count", "impacts of one floor", 1.0))


@figure_of(
    "cube",
    "peak impact force and impacts of each pair against the gap, law by law",
    needs=("law", "gap", "pair", "impact_force_max", "impact_count", CONTACT),
)
def force_gap(cube: xr.Dataset) -> Figure:
    """Draw peak impact force and impacts of each pair against the gap."""
    cube, shown = middle(pounding_only(along(along(cube, "law"), "gap")), ("law", "gap"))
    cube = cube.sortby("gap")
    laws = labels_with_values(cube, "law", [name for name, *_ in _ROWS])
    pairs = cube.pair.values.tolist()
    figure, axes = subplots(len(_ROWS), len(pairs), (2.0 + 3.2 * len(pairs), 5.2))
    gaps = cube.gap.values * 1e3
    for row, (name, _, factor) in enumerate(_ROWS):
        for column, pair in enumerate(pairs):
            ax = axes[row, column]
            for number, law in enumerate(laws):
                values = cube[name].sel(law=law, pair=pair).max("storey") * factor
                ax.plot(gaps, values, label=law, **look(number))
            if row == 0:
                ax.set_title(f"pair {pair}")
        start_at_zero(axes[row, 0])
    label_edges(axes, "gap (mm)", [label for _, label, _ in _ROWS])
    legend_below(figure, axes[0, 0])
    put_title(figure, shown)
    return figure

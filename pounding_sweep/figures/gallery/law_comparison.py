"""Contact laws over a reference law, at equal nominal and at equal realised restitution."""

from __future__ import annotations

import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import (
    along,
    labels_with_values,
    law_name,
    middle_over_records,
    over_storeys,
    panels_of,
    result_of,
)
from pounding_sweep.figures.sides import drawn_side
from pounding_sweep.figures.style import label_edges, legend_below, look, put_title, subplots

#: Outputs by which laws are compared in pictures, the first that is there, and in words.
_OUTPUTS = {
    "impact_force_max": "peak impact force",
    "penetration_max": "penetration",
    "impulse": "impulse",
    "approach_speed_max": "approach speed",
    "impact_count": "number of impacts",
}


@figure_of(
    "cube",
    "impact forces over those of a reference law, at equal nominal and at equal realised restitution",
    needs=("law", "pair", "|".join([*_OUTPUTS, *(f"{name}_compared" for name in _OUTPUTS)])),
    several=("law",),
)
def law_comparison(cube: xr.Dataset, *, x: str | None = None) -> Figure:
    """Draw the peak impact force of each law over that of the reference law.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of several laws with contact, or what `pounding_sweep.analysis.compare_laws` made of one.
    x : str, optional
        Axis of several numbers, or a coordinate along one, to draw along; by default the restitution, or, where
        there is one, the first axis that varies.
    """
    drawn = next((name for name in _OUTPUTS if name in cube), None)
    result = result_of(cube, "laws", outputs=drawn and [drawn])
    name = next((key for key in _OUTPUTS if f"{key}_compared" in result), None)
    if name is None:
        msg = (
            f"figure 'law-comparison' needs one of {', '.join(_OUTPUTS)}, which this cube lacks; run the sweep with it"
        )
        raise InputError(msg)
    reference = result.attrs["reference_law"]
    peak = over_storeys(along(result, "pair")[f"{name}_compared"])
    base = peak.sel(law=reference, drop=True).reset_coords(drop=True)
    ratio = (peak / base.where(base != 0.0)).to_dataset(name="ratio")
    side = drawn_side(ratio, x or ("restitution" if ratio.sizes.get("restitution", 1) > 1 else None), but=["basis"])
    if side is None:
        msg = "figure 'law-comparison' needs an axis along which values vary: gap, stiffness, restitution, scale, ..."
        raise InputError(msg)
    ratio, shown = middle_over_records(ratio, ("law", "basis", side.dim), ["ratio"])
    bases, pairs = ratio["basis"].values.tolist(), panels_of(peak.to_dataset(name=name), "pair", [name])
    figure, axes = subplots(len(bases), len(pairs), (1.8 + 2.8 * len(pairs), 1.4 + 2.1 * len(bases)))
    ratio = ratio.sortby(side.name)
    laws = labels_with_values(ratio, "law", ["ratio"])
    at = side.values(ratio)
    label = "coefficient of restitution (-)" if side.name == "restitution" else side.label  # nominal or realised
    for row, basis in enumerate(bases):
        for column, pair in enumerate(pairs):
            ax = axes[row, column]
            for number, law in enumerate(laws):
                line = ratio["ratio"].sel(basis=basis, pair=pair, law=law)
                ax.plot(at, line, label=law_name(ratio, law), **look(number))
            side.draw(ax.xaxis, at)
            ax.set_title(f"pair {pair}\nequal {basis} restitution")
    label_edges(axes, label, [f"{_OUTPUTS[name]}\nover the reference's (-)"] * len(bases))
    legend_below(figure, axes[0, 0])
    put_title(figure, f"reference law: {law_name(ratio, reference)}", shown)
    return figure

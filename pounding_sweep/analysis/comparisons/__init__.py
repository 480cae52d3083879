"""Every comparison by name: what it is, what a cube must have for it, what it makes and what draws it.

The command line and the documentation print this registry. Adding a comparison is
adding one `Comparison` to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pounding_sweep.base.deferred import function_at

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Comparison:
    """A comparison by name.

    Attributes
    ----------
    key : str
        Name on the command line, and the attribute ``comparison`` of its results.
    title : str
        What it shows.
    needs : str
        What a cube must have, in words.
    place : str
        ``module:function`` that takes a cube and returns a dataset.
    columns : tuple of str
        Dimensions that its printed table tells apart; everything else is taken together.
    variables : tuple of str
        Endings of the variables in that table; () for all.
    lead : tuple of str
        Variables that a summary shows; the first two where it has none of them.
    figure : str
        Key of the figure that draws it; "" where none does.
    """

    key: str
    title: str
    needs: str
    place: str
    columns: tuple[str, ...]
    variables: tuple[str, ...]
    lead: tuple[str, ...]
    figure: str

    def load(self) -> Callable[..., xr.Dataset]:
        """Return the function that makes it."""
        return function_at(self.place)


#: Every comparison by key, in the order in which they are listed.
COMPARISONS: dict[str, Comparison] = {
    comparison.key: comparison
    for comparison in (
        Comparison(
            key="amplification",
            title="responses with pounding over responses without, by building and storey",
            needs="the law 'none' among the laws, and displacements, drifts, shears, accelerations or energies",
            place="pounding_sweep.analysis.comparisons.amplification:amplification",
            columns=("law", "building"),
            variables=("_ratio",),
            lead=("displacement_peak_ratio", "drift_max_ratio", "storey_shear_max_ratio", "acceleration_max_ratio"),
            figure="amplification",
        ),
        Comparison(
            key="laws",
            title="contact laws against a reference law, at equal nominal and at equal realised restitution",
            needs="an axis of two or more laws with contact; for equal realised restitution, several restitutions",
            place="pounding_sweep.analysis.comparisons.laws:compare_laws",
            columns=("basis", "law", "pair", "building"),
            variables=("_ratio",),
            lead=("impact_force_max_ratio", "drift_max_ratio"),
            figure="law-comparison",
        ),
        Comparison(
            key="required-gap",
            title="the gap that each pair needs, exactly and by separation rules",
            needs="pairs; the law 'none' with closing_max and displacements, or the records at hand",
            place="pounding_sweep.analysis.comparisons.required_gap:required_gap",
            columns=("rule", "pair"),
            variables=("exact", "rule_gap", "ratio"),
            lead=("exact", "ratio"),
            figure="required-gap",
        ),
        Comparison(
            key="impacts",
            title="how often, how hard and how soon floors touch",
            needs="pairs, a law with contact, and impact counts or any other output of contacts",
            place="pounding_sweep.analysis.comparisons.impacts:impact_statistics",
            columns=("law", "pair", "quantile"),
            variables=(),
            lead=("pair_touching_share", "impact_force_max_fractiles"),
            figure="",
        ),
        Comparison(
            key="energy",
            title="where the energy of each building went, and whether transfers sum to the contacts' work",
            needs="energy_input, energy_damping, energy_kinetic, energy_strain and contact_work",
            place="pounding_sweep.analysis.comparisons.energy:energy_budget",
            columns=("law", "building", "pair"),
            variables=(),
            lead=("transfer_share", "contact_work", "residual_relative"),
            figure="energy-budget",
        ),
        Comparison(
            key="fractiles",
            title="median and fractiles of responses over a suite of records",
            needs="an axis of several records",
            place="pounding_sweep.analysis.comparisons.fractiles:fractiles",
            columns=("law", "building", "pair", "quantile"),
            variables=(),
            lead=("displacement_max_fractiles", "drift_max_fractiles", "impact_force_max_fractiles"),
            figure="",
        ),
        Comparison(
            key="incremental",
            title="responses against intensity as records are scaled up, with the fractiles of the suite",
            needs="an axis of several scales",
            place="pounding_sweep.analysis.comparisons.incremental:incremental_curves",
            columns=("law", "building", "pair", "quantile"),
            variables=("_fractiles",),
            lead=("drift_max_fractiles", "impact_force_max_fractiles"),
            figure="incremental",
        ),
        Comparison(
            key="fragility",
            title="probability that a pair touches, or of another event, against intensity: a fitted lognormal",
            needs="pairs, a law with contact, and records or scales of several intensities",
            place="pounding_sweep.analysis.comparisons.fragility:fragility",
            columns=("law", "gap", "pair"),
            variables=("median", "dispersion"),
            lead=(),
            figure="fragility",
        ),
    )
}

"""The gap that a pair needs so that few motions of a suite make it touch, and how surely a suite tells it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.analysis.along import fractiles_over
from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.comparisons.required_gap import required_gap
from pounding_sweep.analysis.scenarios import COMPARISON, described, finished, labelled, need_several
from pounding_sweep.base.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

#: Shares of the motions that may make a pair touch.
PROBABILITIES = (0.5, 0.16, 0.1, 0.05, 0.02)


@comparison(
    "the gap that a pair needs so that it touches under no more than a share of the records",
    needs="several records; else what 'required-gap' needs",
    columns=("probability", "pair"),
    variables=("gap", "gap_lower", "gap_upper", "gap_observed"),
    lead=("gap", "gap_upper"),
    arguments=("folders",),
)
def separation(
    cube: xr.Dataset,
    probabilities: Sequence[float] = PROBABILITIES,
    *,
    confidence: float = 0.95,
    records: Any = None,
    folders: Any = None,
) -> xr.Dataset:
    """Find the gap at which a pair touches under a given share of the motions that a suite stands for.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis ``record``, or the result of `pounding_sweep.analysis.required_gap`.
    probabilities : sequence of float
        Shares of the motions under which the pair may touch, in (0, 1).
    confidence : float
        Of the interval, in (0, 1).
    records, folders : optional
        As for `pounding_sweep.analysis.required_gap`.

    Returns
    -------
    xarray.Dataset
        On ``probability``, ``pair``, and ``scale`` and building properties where the cube has them, all in m:
        ``gap`` by a lognormal distribution of the records' exact required gaps; ``gap_lower`` and ``gap_upper``,
        its confidence interval; ``gap_observed``, the fractile of the required gaps themselves, missing where
        there are too few records for that probability. Beside them ``median`` (m) and ``dispersion`` of the
        lognormal and ``records``, how many count. Missing with fewer than two records that count, and where a
        pair never closes under one of them.

    Raises
    ------
    InputError
        The cube has no several records, a required gap can't be had from it, or a number is out of range.

    Notes
    -----
    With m and s the mean and standard deviation of ln g over n records, and z the normal quantile of 1 - p, the gap
    is exp(m + z s), and the interval of the quantile is exact for a lognormal: exp(m + t s / sqrt(n)), t of
    Student's noncentral distribution with n - 1 degrees of freedom and noncentrality z sqrt(n). As for every required
    gap, all pairs of the row must have theirs.

    Examples
    --------
    >>> import xarray as xr
    >>> exact = (("record", "pair"), [[0.01], [0.02], [0.04]])
    >>> gaps = xr.Dataset({"exact": exact}, {"pair": ["left-right"]}, {"comparison": "required-gap"})
    >>> separation(gaps, [0.5]).gap.round(6).values.tolist()
    [[0.02]]
    """
    import xarray as xr
    from scipy.stats import nct, norm

    if not len(probabilities) or not all(0.0 < p < 1.0 for p in (*probabilities, confidence)):
        msg = f"probabilities are {list(probabilities)}, confidence is {confidence!r}; all must be between 0 and 1"
        raise InputError(msg)
    own = cube.attrs.get(COMPARISON) == "required-gap"
    gaps = cube if own else required_gap(cube, records, folders=folders)
    need_several(gaps, "a separation by probability", "record")
    exact = gaps["exact"]
    index = labelled("probability", probabilities, "share of the motions under which the pair touches", "1")
    count = exact.notnull().sum("record")
    enough = (count > 1) & ~(exact <= 0.0).any("record")
    logs: Any = np.log(exact.where(enough))
    middle, spread = logs.mean("record"), logs.std("record", ddof=1)
    z = index.copy(data=norm.isf(index.values))
    found = {"gap": np.exp(middle + z * spread)}
    sizes, place = np.unique(count.values, return_inverse=True)  # quantiles take long, and sizes are few
    for name, share in (("gap_lower", 0.5 - 0.5 * confidence), ("gap_upper", 0.5 + 0.5 * confidence)):
        table = nct.ppf(share, np.where(sizes > 1, sizes - 1, np.nan), z.values[:, None] * sizes**0.5)
        t = xr.DataArray(table[:, place.reshape(count.shape)], dims=("probability", *count.dims))
        found[name] = np.exp(middle + t * spread / count**0.5)
    observed, _ = fractiles_over(exact, ["record"], [1.0 - p for p in probabilities])
    observed = observed.rename(quantile="probability").assign_coords(probability=index)
    found["gap_observed"] = observed.where(index * count >= 1.0)
    about = {
        "gap": "gap that this share of the motions exceeds, by a lognormal",
        "gap_lower": f"lower end of its {confidence:.0%} confidence interval",
        "gap_upper": f"upper end of its {confidence:.0%} confidence interval",
        "gap_observed": "gap that this share of the records exceeds",
    }
    dataset = xr.Dataset(
        {name: described(part.transpose("probability", ...), "m", about[name]) for name, part in found.items()}
        | {
            "median": described(np.exp(middle), "m", "median required gap"),
            "dispersion": described(spread, "1", "standard deviation of the logarithm of the required gap"),
            "records": described(count, "1", "records that count"),
        },
        coords={"probability": index},
    )
    return finished(dataset, cube, "separation", confidence=confidence)

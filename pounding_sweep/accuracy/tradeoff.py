"""The speed-accuracy trade of a sweep, measured on a sample of its own scenarios.

Every scheme, step, number format, located or not, is run on the same scenarios
and compared with a converged solution; its cost is measured beside it. The
converged solution is itself checked, by its own double step.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.spec.spec import METHODS, PRECISIONS, SweepSpec

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.accuracy.trade_measure import Measured

#: Steps (s) compared by default.
DEFAULT_STEPS = (5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4)
#: A converged solution with a larger error of its own is worth a warning.
DOUBTFUL = 1e-5


def tradeoff(
    sweep: Sweep,
    *,
    steps: Iterable[float] = DEFAULT_STEPS,
    methods: Iterable[str] | None = None,
    located: Iterable[bool] = (True, False),
    precisions: Iterable[str] = PRECISIONS,
    scenarios: int = 96,
    seed: int = 0,
    repeats: int = 5,
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Measure errors and costs of schemes and steps on a sample of a sweep's scenarios.

    Parameters
    ----------
    sweep : Sweep
        The sweep; its own scheme, step and number format don't matter.
    steps : iterable of float
        Largest time steps (s); of those that cut a record alike, one is kept.
    methods : iterable of str, optional
        Schemes, out of `pounding_sweep.schemes.SCHEMES`; those that ``accuracy`` chooses from by default.
    located : iterable of bool
        With contacts located inside the step, without, or both.
    precisions : iterable of str
        Number formats, out of "float64" and "float32".
    scenarios : int
        About how many scenarios errors are measured on.
    seed : int
        Of the random sample.
    repeats : int
        Passes over all configurations in which costs are measured.
    workers : int, optional
        Processes that compile kernels; one per core by default. Costs are always of one core.
    progress : Progress, optional
        Display.

    Returns
    -------
    xarray.Dataset
        ``error`` on (scheme, located, precision, step, output, population, statistic),
        ``cost`` (s per thousand scenarios), ``status_count``, ``pareto``, the same by law,
        and the errors of every single scenario; settings, machine and sweep as attributes.

    Raises
    ------
    InputError
        An argument is not valid, or no scenario can touch.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> sweep = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.005, 0.01])
    >>> only = {"methods": ["rk4"], "located": [True], "precisions": ["float64"]}
    >>> trade = ps.tradeoff(sweep, steps=[1e-3], scenarios=2, repeats=1, **only)
    >>> worst = trade.error.sel(population="all", statistic="worst", output="impact_force_max")
    >>> bool(worst.item() < 1e-3)
    True
    """
    from pounding_sweep.accuracy.trade_dataset import make_dataset
    from pounding_sweep.accuracy.trade_measure import Compared, measure

    spec = sweep.spec
    modes = tuple(dict.fromkeys(bool(value) for value in located))
    for name, count in (("scenarios", scenarios), ("repeats", repeats), ("located", len(modes))):
        if count < 1:
            msg = f"{name} = {count!r} must be at least 1"
            raise InputError(msg)
    compared = Compared(
        _chosen("method", measured_schemes() if methods is None else methods, METHODS),
        modes,
        _chosen("precision", precisions, PRECISIONS),
        _distinct_steps(spec, steps),
        spec.beta,
        spec.gamma,
    )
    found = measure(
        spec,
        compared,
        scenarios=scenarios,
        seed=seed,
        repeats=repeats,
        workers=workers,
        progress=progress or Progress(),
    )
    warn_of_doubt(found)
    return make_dataset(found, {"seed": seed, "repeats": repeats})


def warn_of_doubt(measured: Measured) -> None:
    """Warn, with the worst case by name, where the converged solution is not converged."""
    own = np.nan_to_num(measured.reference_errors, posinf=np.inf)
    doubtful = int((own.max(axis=1) > DOUBTFUL).sum())
    if not doubtful:
        return
    row, output = np.unravel_index(np.argmax(own), own.shape)
    table = measured.plan.unique[measured.sample.rows]
    gaps = ", ".join(f"{gap:g}" for gap in table.gaps[row])
    warnings.warn(
        f"the converged solution of {doubtful} of {len(own)} scenarios differs from that of twice its step by more "
        f"than {DOUBTFUL:g}, so their smaller errors can't be told; worst {own[row, output]:.1e} in "
        f"{measured.outputs[output]} of law {measured.plan.laws[table.law[row]].key}, gaps {gaps} m, stiffness "
        f"{table.stiffness[row]:g}, restitution {table.restitution[row]:g}. Compare a smaller finest step",
        RuntimeWarning,
        stacklevel=3,
    )


def _chosen(kind: str, given: Iterable[str], valid: Sequence[str]) -> tuple[str, ...]:
    """Return the names asked for, in the order of `valid`."""
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if name not in valid:
            raise InputError(unknown(kind, name, valid))
    if not names:
        msg = f"no {kind} is given; valid: {', '.join(valid)}"
        raise InputError(msg)
    return tuple(name for name in valid if name in names)


def _distinct_steps(spec: SweepSpec, steps: Iterable[float]) -> tuple[float, ...]:
    """Return the steps from the largest to the smallest, one of those that cut every record alike."""
    found: dict[tuple[int, ...], float] = {}
    for step in sorted((float(s) for s in steps), reverse=True):
        if not (math.isfinite(step) and step > 0):
            msg = f"step {step!r} must be a positive number (s), such as 1e-3"
            raise InputError(msg)
        cut = tuple(Numerics("rk4", step).steps(record) for record in spec.records)
        found.setdefault(cut, step)
    if not found:
        msg = f"no steps are given; give one or more (s), such as {', '.join(f'{s:g}' for s in DEFAULT_STEPS)}"
        raise InputError(msg)
    return tuple(found.values())

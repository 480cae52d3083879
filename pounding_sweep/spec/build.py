"""From what a user gave to the sweep's description.

`build_spec` turns what a user gave, in Python or in a file, into a `SweepSpec` or into one error that lists every
fault. Nothing is run and nothing of the sweep's size is allocated here.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable
from typing import Any

from pounding_sweep.spec.axes import AXES
from pounding_sweep.spec.faults import spell
from pounding_sweep.spec.schema import Arguments, read_sweep
from pounding_sweep.spec.spec import SweepSpec, sweep_error


def build_spec(**arguments: Any) -> SweepSpec:
    """Check everything a user gave and make the sweep's description of it.

    Parameters
    ----------
    scene : Scene or str
        The row, or the name of a preset.
    records : Record, str, path, or several
        Ground motions: records, names or files.
    laws : str, Law, or several, optional
        Contact laws; "all" stands for every law, "mate2015" for the paper's seven models. Needed without `cases`.
    **axes
        AXES
    cases : iterable of Case or dict, optional
        Listed scenarios instead of laws and axes.
    design : dict, optional
        Inputs drawn from distributions, instead of axes over them: ``kind`` and ``samples``, ``seed`` (0 by default)
        and ``inputs``, a table by the name of an axis (see `pounding_sweep.spec.design`). Each point is run with each
        law, each record and each value of the other axes.
    method : str, optional
        Time-stepping scheme, one of `pounding_sweep.schemes.SCHEMES`; "rk4" by default, with `accuracy` the
        cheapest that reaches it.
    dt : float, optional
        Time step (s); 1e-3 by default, with `accuracy` the largest that reaches it.
    locate : bool
        Split steps where a pair touches or separates.
    outputs : str or several, optional
        Variables; "default" (as by default), "all", or names.
    beta, gamma : float, optional
        Newmark's parameters, in [0, 0.5] and [0.5, 1]; 0.25 and 0.5 by default.
    force_unstable : bool
        Run even beyond the stability limit.
    title : str
        Title of the cube.
    precision : {"float64", "float32"}, optional
        Number format of the kernels; "float64" by default, with `accuracy` the cheaper that reaches it.
    restitution_basis : {"published", "realised"}
        Whether damping follows from the restitution by each law's published formula,
        or so that two free masses rebound at exactly it.
    accuracy : float, optional
        Relative error asked for, 1e-6 to 1e-2, instead of a step.
    audit : float
        Share of the sweep's cost, in [0, 1], spent on running a sample of its own
        scenarios again at a finer step, to measure their error; 0 for none.
    sa_period : float, optional
        Period (s) at which the spectral accelerations `sas` are meant; needed with them.
    folders : path or several, optional
        Where to find records by name.
    base : path, optional
        Folder that relative record paths start from.
    skip_missing_records : bool
        Go on without the records that are not found, with a warning for each, as long as
        one is left. A file that is found but can't be read is always an error.

    Returns
    -------
    SweepSpec
        Values in the order given.

    Raises
    ------
    SweepError
        Something is not valid; ``problems`` lists every fault, each with its place.

    Examples
    --------
    >>> spec = build_spec(scene="mate2015", records="el_centro", laws=["linear", "hertz"], gaps=[0.005, 0.01])
    >>> spec.n_scenarios
    4
    """
    spec, faults = read_sweep(arguments)
    if spec is None:
        raise sweep_error([f"{spell(place)}: {text}" if place else text for place, text in faults])
    return spec


def _sign(function: Callable[..., SweepSpec]) -> None:
    """Give a function the signature of `Arguments`, and every axis of the registry in the place of ``**axes``."""
    texts = []
    for name, axis in AXES.items():
        kind = f"{'mapping of str to ' * axis.by_building}float, Range, or several, optional"
        texts += [f"{name} : {kind}", textwrap.fill(axis.meaning, 110, initial_indent="    ", subsequent_indent="    ")]
    doc = str(function.__doc__).replace("    **axes\n        AXES\n", textwrap.indent("\n".join(texts) + "\n", "    "))
    function.__doc__ = doc
    keyword, missing = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.empty
    parameters = [
        inspect.Parameter(name, keyword, default=missing if field.is_required() else field.default)
        for name, field in Arguments.model_fields.items()
        if name != "building"
    ]
    function.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]


_sign(build_spec)

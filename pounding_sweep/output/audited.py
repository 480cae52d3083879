"""The audit of a cube: the measured errors of its own outputs, stored and in a few rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pounding_sweep.output.dataset import Coordinates, CubeParts
from pounding_sweep.outputs.variables import CHANGE

#: Dimensions of an audit; no scenario axes.
AUDIT_DIMS = ("audit", "output")
#: What it measured; its other arrays say which scenarios these are.
_MEASURED = ("audit_error", "audit_sensitivity", "audit_sensitive", "audit_undecided", "audit_status")


def add_audit(cube: CubeParts, arrays: Coordinates, touching: int, share: float) -> None:
    """Put the arrays of an audit into a cube, attributes on every output, and what of the sweep was run again."""
    for name, (dims, values, about) in arrays.items():
        part = cube.data_vars if name in _MEASURED else cube.coords
        part[name] = (tuple(dims), values, dict(about))
    error, undecided = arrays["audit_error"][1], arrays["audit_undecided"][1] != 0
    for i, name in enumerate(arrays["output"][1].tolist()):
        if not undecided.all() and name in cube.data_vars:
            decided = error[~undecided, i]
            about = {"audit_error_max": float(decided.max()), "audit_error_median": float(np.median(decided))}
            cube.data_vars[name][2].update(about)
    cube.attrs.update(
        audit_scenarios=len(error),
        audit_touching=touching,
        audit_share=share,
        audit_perturbation=CHANGE,
        audit_undecided_share=float(undecided.mean()),
    )


def has_audit(cube: Mapping[Any, Any]) -> bool:
    """Whether a cube carries the measured errors of a sample of its scenarios."""
    return "audit_error" in cube


def audit_table(cube: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """Summarise an audit, one row per output.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube, or its arrays by name.

    Returns
    -------
    list of dict
        ``output``; ``scenarios`` run again that are not undecided, and ``error_median``
        and ``error_max`` over them; how many are ``sensitive``; ``undecided`` ones and their
        ``error_max_undecided``.
        None where there is none, or where an error is infinite (a touch in one run only).
        Empty for a cube without audit.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> cube = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02]).run()
    >>> [row["output"] for row in audit_table(cube)][:2]
    ['displacement_max', 'displacement_min']
    """
    if not has_audit(cube):
        return []
    error = np.asarray(cube["audit_error"][...])
    sensitive, undecided = (np.asarray(cube[name][...], bool) for name in ("audit_sensitive", "audit_undecided"))

    def reduced(reduce: Callable[[np.ndarray], Any], values: np.ndarray) -> float | None:
        number = float(reduce(values)) if values.size else math.inf
        return number if math.isfinite(number) else None

    return [
        {
            "output": output,
            "scenarios": int((~undecided).sum()),
            "error_median": reduced(np.median, error[~undecided, i]),
            "error_max": reduced(np.max, error[~undecided, i]),
            "sensitive": int(sensitive.sum()),
            "undecided": int(undecided.sum()),
            "error_max_undecided": reduced(np.max, error[undecided, i]),
        }
        for i, output in enumerate(np.asarray(cube["output"][...]).tolist())
    ]


def audit_sentence(rows: Sequence[Mapping[str, Any]], attributes: Mapping[Any, Any]) -> str:
    """Say in one line what was audited, how much of it is sensitive, and what is set apart; "" without an audit."""
    # rows of `audit_table`, and attributes of the cube
    if not rows:
        return ""
    sensitive, undecided = rows[0]["sensitive"], rows[0]["undecided"]
    n, change = rows[0]["scenarios"] + undecided, attributes["audit_perturbation"]
    text = (
        f"{n} of {attributes['audit_touching']} touching scenarios run again at half the step "
        f"({attributes['audit_share']:.2g} of their cost)"
    )
    if sensitive:
        text += f"; {sensitive} of them ({sensitive / n:.1%}) sensitive: inputs changed by {change:g} change the answer"
    if undecided:
        text += f"; {undecided} ({undecided / n:.1%}) undecided and set apart: no step settles them"
    return text

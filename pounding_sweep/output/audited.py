"""What a cube's audit says: the measured error of its own outputs, in a few rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

#: Dimensions of an audit; no scenario axes.
AUDIT_DIMS = ("audit", "output")


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
    """
    if not has_audit(cube):
        return []
    error = np.asarray(cube["audit_error"][...])
    sensitive, apart = (np.asarray(cube[name][...], bool) for name in ("audit_sensitive", "audit_undecided"))
    return [
        {
            "output": output,
            "scenarios": int((~apart).sum()),
            "error_median": _number(np.median, error[~apart, i]),
            "error_max": _number(np.max, error[~apart, i]),
            "sensitive": int(sensitive.sum()),
            "undecided": int(apart.sum()),
            "error_max_undecided": _number(np.max, error[apart, i]),
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


def _number(reduce: Any, values: np.ndarray) -> float | None:
    found = float(reduce(values)) if values.size else math.inf
    return found if math.isfinite(found) else None

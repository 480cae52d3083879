"""What a cube's audit says: the measured error of its own outputs, in a few rows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr


#: Dimensions of an audit; no scenario axes.
AUDIT_DIMS = ("audit", "output")


def has_audit(cube: xr.Dataset) -> bool:
    """Whether a cube carries the measured errors of a sample of its scenarios."""
    return "audit_error" in cube.data_vars


def audit_table(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Summarise an audit, one row per output.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.

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
    error = np.asarray(cube["audit_error"].values)
    if cube["audit_error"].dims != AUDIT_DIMS:
        error = error.T
    sensitive = cube["audit_sensitive"].values.astype(bool)
    apart = cube["audit_undecided"].values.astype(bool)
    return [
        {
            "output": str(output),
            "scenarios": int((~apart).sum()),
            "error_median": _number(np.median, error[~apart, i]),
            "error_max": _number(np.max, error[~apart, i]),
            "sensitive": int(sensitive.sum()),
            "undecided": int(apart.sum()),
            "error_max_undecided": _number(np.max, error[apart, i]),
        }
        for i, output in enumerate(cube["output"].values)
    ]


def audit_sentence(cube: xr.Dataset) -> str:
    """Say in one line what was audited, how much of it is sensitive, and what is set apart; "" without an audit."""
    if not has_audit(cube):
        return ""
    n, change = cube.sizes["audit"], cube.attrs["audit_perturbation"]
    sensitive, undecided = (int(cube[name].values.sum()) for name in ("audit_sensitive", "audit_undecided"))
    text = (
        f"{n} of {cube.attrs['audit_touching']} touching scenarios run again at half the step "
        f"({cube.attrs['audit_share']:.2g} of their cost)"
    )
    if sensitive:
        text += f"; {sensitive} of them ({sensitive / n:.1%}) sensitive: inputs changed by {change:g} change the answer"
    if undecided:
        text += f"; {undecided} ({undecided / n:.1%}) undecided and set apart: no step settles them"
    return text


def _number(reduce: Any, values: np.ndarray) -> float | None:
    found = float(reduce(values)) if values.size else math.inf
    return found if math.isfinite(found) else None

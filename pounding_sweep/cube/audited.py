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
        ``output``; ``scenarios`` run again that are not sensitive, and ``error_median``
        and ``error_max`` over them; ``sensitive`` ones and their ``error_max_sensitive``.
        None where there is none, or where an error is infinite (a touch in one run only).
        Empty for a cube without audit.
    """
    if not has_audit(cube):
        return []
    error = cube["audit_error"].transpose("audit", "output").values
    apart = cube["audit_sensitive"].values.astype(bool)
    return [
        {
            "output": str(output),
            "scenarios": int((~apart).sum()),
            "error_median": _number(np.median, error[~apart, i]),
            "error_max": _number(np.max, error[~apart, i]),
            "sensitive": int(apart.sum()),
            "error_max_sensitive": _number(np.max, error[apart, i]),
        }
        for i, output in enumerate(cube["output"].values)
    ]


def audit_sentence(cube: xr.Dataset) -> str:
    """Say in one line what was audited and how much of it is sensitive; "" for a cube without audit."""
    if not has_audit(cube):
        return ""
    apart = int(cube["audit_sensitive"].values.sum())
    text = (
        f"{cube.sizes['audit']} of {cube.attrs['audit_touching']} touching scenarios run again at half the step "
        f"({cube.attrs['audit_share']:.2g} of their cost)"
    )
    if apart:
        change = cube.attrs["audit_perturbation"]
        text += f"; {apart} of them sensitive: changed by {change:g} they give another answer, and no step size helps"
    return text


def _number(reduce: Any, values: np.ndarray) -> float | None:
    found = float(reduce(values)) if values.size else math.inf
    return found if math.isfinite(found) else None

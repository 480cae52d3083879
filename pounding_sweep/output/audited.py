"""Errors of a cube: what its audit measured, and what its scenarios estimate themselves, stored and in a sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pounding_sweep.base.text import finite
from pounding_sweep.output.dataset import Coordinates, CubeParts
from pounding_sweep.variables.registry import Status

#: Dimensions of an audit; no scenario axes.
AUDIT_DIMS = ("audit", "output")
#: What it measured; its other arrays say which scenarios these are.
_MEASURED = ("audit_error", "audit_undecided", "audit_random", "audit_status")
#: Confidence of what is said of the scenarios that were not drawn.
CONFIDENCE = 0.95


def add_audit(cube: CubeParts, arrays: Coordinates, touching: int, share: float, reference: str) -> None:
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
        audit_reference=reference,
        audit_undecided_share=float(undecided.mean()),
    )


def has_audit(cube: Mapping[Any, Any]) -> bool:
    """Whether a cube carries the measured errors of a part of its scenarios."""
    return "audit_error" in cube


def _arrays(cube: Mapping[Any, Any], *names: str) -> list[np.ndarray]:
    """Return arrays of a cube, or of a file."""
    return [np.asarray(cube[name][...]) for name in names]


def audit_table(cube: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """Summarise an audit, one row per output.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube, or its arrays by name.

    Returns
    -------
    list of dict
        ``output``; ``scenarios`` compared that are not undecided, and ``error_median``, ``error_99`` (99 % are no
        larger) and ``error_max`` over them; how many are ``undecided``, and their ``error_max_undecided``.
        None where there is none, or where an error is infinite (a touch in one run only).
        Empty for a cube without audit.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> cube = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02], dt=1e-3).run()
    >>> [row["output"] for row in audit_table(cube)][:2]
    ['displacement_max', 'displacement_min']
    """
    if not has_audit(cube):
        return []
    error, undecided, outputs = _arrays(cube, "audit_error", "audit_undecided", "output")
    rows, undecided = [], undecided != 0
    for output, errors in zip(outputs.tolist(), error.T, strict=True):
        decided, others = (part if part.size else [math.inf] for part in (errors[~undecided], errors[undecided]))
        numbers = {
            "scenarios": int((~undecided).sum()),
            "error_median": float(np.median(decided)),
            "error_99": _most(decided),
            "error_max": float(np.max(decided)),
            "undecided": int(undecided.sum()),
            "error_max_undecided": float(np.max(others)),
        }
        rows.append({"output": output} | {name: finite(number) for name, number in numbers.items()})
    return rows


def errors_sentence(cube: Mapping[Any, Any], attributes: Mapping[Any, Any]) -> str:
    """Say in one line how large the errors of a cube are, of which scenarios; "" where nothing was measured."""
    if "error_estimate" in cube:
        estimate, status = _arrays(cube, "error_estimate", "status")
        estimate = estimate[status == Status.OK]
        n, estimate = len(estimate), estimate[~np.isnan(estimate)]
        if not len(estimate):
            return ""
        numbers = f"largest {estimate.max():.2g}, 99 % within {_most(estimate):.2g}, median {np.median(estimate):.2g}"
        which = f"all {n}" if n == len(estimate) else f"a sample of {len(estimate)} of {n}"
        grazes = "; a touch shallower than that may be counted or not" * ("impact_count" in cube)
        return f"relative, estimated in {which} scenarios that are ok: {numbers}{grazes}"
    if not has_audit(cube) or "audit_reference" not in attributes:
        return ""
    names = ("audit_error", "audit_undecided", "audit_random", "audit_law", "law", "output")
    error, undecided, random, laws, all_laws, outputs = _arrays(cube, *names)
    n, undecided = len(error), undecided != 0
    touching, reference = attributes["audit_touching"], attributes["audit_reference"]
    how_many = f"all {n} touching scenarios" if n == touching else f"{n} of {touching} touching scenarios"
    audited = sorted({*laws.tolist()})
    which = "all laws" if {*all_laws.ravel().tolist()} <= {*audited, "none"} else ", ".join(audited)
    text = f"{how_many}, {which}, compared with {reference}"
    if not undecided.all():
        decided = np.where(undecided[:, None], -1.0, error)
        row, output = np.unravel_index(int(decided.argmax()), error.shape)
        different = dict.fromkeys(np.atleast_1d(cube["audit_gap"][int(row)]).tolist())
        gaps = ", ".join(f"{1e3 * gap:.3g}" for gap in different)
        where = f"{outputs[output]}, {laws[row]}, gap {gaps} mm"
        largest = "infinite, a touch in one run only" if np.isinf(decided.max()) else f"{decided.max():.2g}"
        text += f": largest error {largest} ({where}), median {np.median(decided[~undecided].max(axis=1)):.2g}"
    if drawn := int(((random != 0) & ~undecided).sum()) if n < touching else 0:
        others = 1.0 - (1.0 - CONFIDENCE) ** (1.0 / drawn)
        text += f"; with {CONFIDENCE:.0%} confidence at most {others:.1%} of the others err more"
    if undecided.any():
        text += f"; {undecided.sum()} ({undecided.mean():.1%}) undecided and set apart: no step settles them"
    return text


def errors_by_law(cube: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """Return errors of each output under each law, as an audit measured them, undecided scenarios apart."""
    if not has_audit(cube):
        return []
    error, undecided, laws, outputs = _arrays(cube, "audit_error", "audit_undecided", "audit_law", "output")
    error, laws = error[undecided == 0], laws[undecided == 0]
    columns = {law: zip(outputs.tolist(), error[laws == law].T, strict=True) for law in laws}
    return [
        {"law": law, "output": output, "median": np.median(part), "most": _most(part), "largest": part.max()}
        for law, outputs in columns.items()
        for output, part in outputs
    ]


def _most(values: Any) -> float:
    """Return what 99 % of values do not exceed."""
    return float(np.quantile(values, 0.99, method="higher"))

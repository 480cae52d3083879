"""What a scenario is known by: parts are merged, and results of an earlier cube taken, where scenarios have one key."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

#: What of a record decides on results, in the description of a sweep.
MOTION = ("sha256", "dt", "n_points", "scale")
#: What tells scenarios of one study apart, as coordinates of listed cases are named.
KNOWN_BY = (
    *("law", "record", "scale", "restitution", "contact_stiffness", "pair_gap"),
    *("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening"),
)


def motion_of(record: object) -> tuple[object, ...]:
    """Return what a record, or what a cube says of one, is known by, whatever its name."""
    return tuple(record[key] if isinstance(record, Mapping) else getattr(record, key) for key in MOTION)


def numbered(values: np.ndarray, texts: dict[str, int]) -> np.ndarray:
    """Return numbers as they are, texts as those under which they were first met, in any cube."""
    if values.dtype.kind in "iuf":
        return values
    codes = [texts.setdefault(str(value), len(texts)) for value in values.ravel().tolist()]
    return np.reshape(codes, values.shape)


def scenario_keys(known: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the key of each scenario by numbers of shape (scenarios, ...): the same bytes where all are equal."""
    columns = [np.reshape(values, (len(values), -1)) for values in known.values()]
    table = np.hstack(columns).astype(float) + 0.0  # -0.0 is 0.0
    table[np.isnan(table)] = np.nan  # which may have many forms
    return np.ascontiguousarray(table).view(f"V{table.itemsize * table.shape[1]}")[:, 0]


def places_of(wanted: np.ndarray, rising: np.ndarray) -> np.ndarray:
    """Return where keys stand among rising ones; -1 where they don't."""
    places = np.searchsorted(rising, wanted).clip(max=len(rising) - 1)
    return np.where(rising[places] == wanted, places, -1)

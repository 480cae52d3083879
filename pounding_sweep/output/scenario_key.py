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


#: Shifts and pairs of odd factors by which each number changes all bits of a key (MurmurHash3 and SplitMix64).
_MIXING = [
    (np.uint64(33), np.array([0xFF51AFD7ED558CCD, 0xBF58476D1CE4E5B9], np.uint64)),
    (np.uint64(29), np.array([0xC4CEB9FE1A85EC53, 0x94D049BB133111EB], np.uint64)),
]


def scenario_keys(known: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return 16 bytes for each scenario by numbers of shape (scenarios, ...): the same where all numbers are equal."""
    columns = [np.reshape(values, (len(values), -1)) for values in known.values()]
    keys = np.zeros((len(columns[0]), 2), np.uint64)
    for column in columns:
        for values in column.T:
            bits = values.astype(float) + 0.0  # -0.0 is 0.0
            bits[np.isnan(bits)] = np.nan  # which may have many forms
            keys ^= bits.view(np.uint64)[:, None]
            for shift, factors in _MIXING:
                keys ^= keys >> shift
                keys *= factors
            keys ^= keys >> np.uint64(32)
    return keys.view("V16")[:, 0]


def places_of(wanted: np.ndarray, rising: np.ndarray) -> np.ndarray:
    """Return where keys stand among rising ones; -1 where they don't."""
    places = np.searchsorted(rising, wanted).clip(max=len(rising) - 1)
    return np.where(rising[places] == wanted, places, -1)

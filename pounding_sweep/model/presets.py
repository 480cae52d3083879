"""Named scenes that a sweep can start from, of ``data/presets.toml``, and buildings made of a few numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pounding_sweep.base.errors import SceneError, unknown
from pounding_sweep.base.files import read_data
from pounding_sweep.model.building import Building
from pounding_sweep.model.faults import NotNegative, Positive, checked_call
from pounding_sweep.model.scene import Scene


@dataclass(frozen=True)
class Preset:
    """One named scene, with its own gaps (m) and contact properties; `reference` is the source of its values."""

    key: str
    title: str
    reference: str
    scene: Scene


#: All presets by key.
PRESETS: dict[str, Preset] = {
    key: Preset(key, table["title"], table["reference"], Scene(**table["scene"]))
    for key, table in read_data("presets.toml").items()
}


def get_preset(name: str) -> Scene:
    """Return the scene of a name, a key of `PRESETS`.

    Raises
    ------
    SceneError
        There is no such preset; the message lists the valid ones.

    Examples
    --------
    >>> get_preset("mate2015").pair_names
    ('left-middle', 'middle-right')
    """
    if not isinstance(name, str) or name not in PRESETS:
        raise SceneError(unknown("preset scene", name, PRESETS))
    return PRESETS[name].scene


@partial(checked_call, SceneError)
def base_isolated(
    building: Building,
    base_mass: Positive,
    period: Positive,
    damping_ratio: NotNegative,
    strength: NotNegative = 0.0,
    yield_drift: Positive = 0.01,
    *,
    height: Positive = 1.5,
) -> Building:
    """Put an elastic building on isolators: a first storey that yields, with a dashpot.

    The isolators' shear is bilinear: the characteristic strength at no displacement, and a stiffness that gives the
    whole mass the isolation period. Dashpots in the storeys take the place of the building's damping, by the first mode
    on a fixed base: Rayleigh's would damp the isolators as well.

    Parameters
    ----------
    building : Building
        What stands on the isolators, as on a fixed base; its damping ratio in the first mode is kept.
    base_mass : float
        Mass of the floor above the isolators (t).
    period : float
        Isolation period (s), of the whole mass on the isolators' stiffness after yielding.
    damping_ratio : float
        Of the isolators' dashpot, at that period.
    strength : float
        Characteristic strength (kN) of all isolators, their force at no displacement; 0: they are linear.
    yield_drift : float
        Displacement at which isolators with a strength yield (m).
    height : float
        Height of the isolators' storey (m).

    Raises
    ------
    SceneError
        A value is out of range.

    References
    ----------
    Naeim & Kelly (1999), Design of Seismic Isolated Structures, Wiley. Ryan & Polanco (2008), J. Struct. Eng. 134(11).

    Examples
    --------
    >>> from pounding_sweep.model.building import Building
    >>> tower = base_isolated(Building("tower", [100.0], [2e5], 0.02), 100.0, 2.0, 0.05, strength=60.0)
    >>> [round(x, 1) for x in tower.yield_strengths], [round(x, 1) for x in tower.dashpots]
    ([79.7, inf], [62.8, 178.9])
    """
    if building.stiffnesses is None:
        raise SceneError("isolators go under storeys that have stiffnesses; this building has a stiffness_matrix")
    masses, n = [base_mass, *building.masses], building.n_storeys
    w, total = 2.0 * math.pi / period, sum(masses)
    soft = total * w**2
    stiff = soft + strength / yield_drift
    share = 2.0 * np.ravel(building.damping_ratio)[0] / building.frequencies[0]
    walls = {name: [0.0, *building.of_infill(name)] for name in ("stiffnesses", "yield_strengths", "hardening")}
    k_and_c = zip(np.add(building.stiffnesses, walls["stiffnesses"][1:]), building.dashpots or (0.0,) * n, strict=True)
    assert building.storey_heights is not None
    first_yield, first_hardening = (stiff * yield_drift, soft / stiff) if strength else (math.inf, 0.0)
    storeys = building.yield_strengths or [math.inf] * n
    return replace(
        building,
        masses=masses,
        stiffnesses=[stiff, *building.stiffnesses],
        damping_ratio=0.0,
        storey_heights=[height, *building.storey_heights],
        yield_strengths=[first_yield, *storeys] if strength or any(building.yields) else None,
        hardening=[first_hardening, *building.hardenings] if any(building.yields) else first_hardening,
        infill=replace(building.infill, **walls) if building.infill else None,
        damping_stiffness="initial",
        slab_depths=None if building.slab_depths is None else [0.0, *building.slab_depths],
        column_stiffnesses=None if building.column_stiffnesses is None else [stiff, *building.column_stiffnesses],
        dashpots=[2.0 * damping_ratio * total * w, *(share * k + c for k, c in k_and_c)],
    )

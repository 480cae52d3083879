"""Named scenes that a sweep can start from, and buildings made of a few numbers.

Adding a scene is adding one entry to `PRESETS`; sweep files, the Python interface and the documentation read it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pounding_sweep.base.errors import SceneError, unknown
from pounding_sweep.model.faults import NotNegative, Positive, checked_call
from pounding_sweep.model.scene import Building, ContactProperties, Scene


@dataclass(frozen=True)
class Preset:
    """One named scene, with its own gaps (m) and contact properties; `reference` is the source of its values."""

    key: str
    title: str
    reference: str
    scene: Scene


# Printed with transposed subscripts; read so that the columns' 12 E I / h^3 gives the stiffnesses.
_LEFT = Building("left", [173.331, 173.331, 133.956], [555.55e3] * 3, 0.05, [3.0] * 3)
_MIDDLE = Building("middle", [175.661, 175.661, 136.286], [355.55e3] * 3, 0.05, [3.0] * 3)
_RIGHT = Building("right", [182.041, 182.041, 140.641], [333.472e3] * 3, 0.05, [3.0] * 3)
_CONTACT = ContactProperties(linear_stiffness=2e6, hertz_stiffness=1.88e7, restitution=0.6)
# Values that the paper's tables fit, each with the slip that would explain it: a right building of twice the printed
# stiffness; a gap stiffness of a tenth, 2e5 tonne-force per metre entered as kN/m; Hertz stiffness by Eqs 9 to 11 as
# printed (square root, 1 - nu) with E = 25 000, as IS 456 gives it in N/mm2, entered as kN/m2.
_STIFFER = replace(_RIGHT, stiffnesses=[2.0 * k for k in _RIGHT.stiffnesses])
_AS_RUN = replace(_CONTACT, linear_stiffness=2e5, hertz_stiffness=2.79e4)

PRESETS: dict[str, Preset] = {
    preset.key: preset
    for preset in (
        Preset(
            key="mate2015",
            title="three 3-storey shear buildings, gaps of 0.01 m (as printed)",
            reference="Mate, Bakre & Jaiswal (2015), Asian Journal of Civil Engineering 16(3)",
            scene=Scene([_LEFT, _MIDDLE, _RIGHT], gaps=[0.01, 0.01], contact=_CONTACT),
        ),
        Preset(
            key="mate2015_as_run",
            title="the same row with the values that the paper's tables fit (as probably run)",
            reference="inferred from Tables 3 to 5 of Mate, Bakre & Jaiswal (2015); stated nowhere in it",
            scene=Scene([_LEFT, _MIDDLE, _STIFFER], gaps=[0.01, 0.01], contact=_AS_RUN),
        ),
    )
}
"""All presets by key."""


def get_preset(name: str) -> Scene:
    """Return the scene of that name.

    Parameters
    ----------
    name : str
        A key of `PRESETS`.

    Returns
    -------
    Scene
        Masses in t, stiffnesses in kN/m, lengths in m.

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


@checked_call(SceneError)
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

    The isolators' shear is bilinear: the characteristic strength at no displacement, and a stiffness that gives
    the whole mass the isolation period. The building's damping becomes that of dashpots in its storeys, by the first
    mode on a fixed base: Rayleigh's would damp the isolators as well.

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

    Returns
    -------
    Building
        Of one storey more, the isolators' the first.

    Raises
    ------
    SceneError
        A value is out of range.

    References
    ----------
    Naeim & Kelly 1999, Design of Seismic Isolated Structures, Wiley. Ryan & Polanco 2008, Journal of Structural
    Engineering 134(11).

    Examples
    --------
    >>> from pounding_sweep.model.scene import Building
    >>> tower = base_isolated(Building("tower", [100.0], [2e5], 0.02), 100.0, 2.0, 0.05, strength=60.0)
    >>> [round(x, 1) for x in tower.yield_strengths], [round(x, 1) for x in tower.dashpots]
    ([79.7, inf], [62.8, 178.9])
    """
    masses, n = [base_mass, *building.masses], building.n_storeys
    w, total = 2.0 * math.pi / period, sum(masses)
    soft = total * w**2
    stiff = soft + strength / yield_drift
    share = 2.0 * float(np.ravel(building.damping_ratio)[0]) / float(building.frequencies[0])
    own = zip(building.stiffnesses, building.dashpots or (0.0,) * n, strict=True)
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
        damping_stiffness="initial",
        slab_depths=None if building.slab_depths is None else [0.0, *building.slab_depths],
        column_stiffnesses=None if building.column_stiffnesses is None else [stiff, *building.column_stiffnesses],
        dashpots=[2.0 * damping_ratio * total * w, *(share * k + c for k, c in own)],
    )

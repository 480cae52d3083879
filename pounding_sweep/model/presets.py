"""Named scenes that a sweep can start from.

Adding a scene is adding one entry to `PRESETS`; sweep files, the Python
interface and the documentation read it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pounding_sweep.base.errors import SceneError, unknown
from pounding_sweep.model.scene import Building, ContactProperties, Scene


@dataclass(frozen=True)
class Preset:
    """One named scene, with its own gaps (m) and contact properties; `reference` is the source of its values."""

    key: str
    title: str
    reference: str
    scene: Scene


def _mate2015() -> Preset:
    # Printed with transposed subscripts; read so that the columns' 12 E I / h^3 gives the stiffnesses.
    left = Building("left", [173.331, 173.331, 133.956], [555.55e3] * 3, 0.05, [3.0] * 3)
    middle = Building("middle", [175.661, 175.661, 136.286], [355.55e3] * 3, 0.05, [3.0] * 3)
    right = Building("right", [182.041, 182.041, 140.641], [333.472e3] * 3, 0.05, [3.0] * 3)
    contact = ContactProperties(linear_stiffness=2e6, hertz_stiffness=1.88e7, restitution=0.6)
    return Preset(
        key="mate2015",
        title="three 3-storey shear buildings, gaps of 0.01 m (as printed)",
        reference="Mate, Bakre & Jaiswal (2015), Asian Journal of Civil Engineering 16(3)",
        scene=Scene([left, middle, right], gaps=[0.01, 0.01], contact=contact),
    )


def _mate2015_as_run() -> Preset:
    # Values that the paper's tables fit, each with the slip that would explain it: a right building of twice the
    # printed stiffness; a gap stiffness of a tenth, 2e5 tonne-force per metre entered as kN/m; Hertz stiffness by
    # Eqs 9 to 11 as printed (square root, 1 - nu) with E = 25 000, as IS 456 gives it in N/mm2, entered as kN/m2.
    printed = _mate2015().scene
    left, middle, right = printed.buildings
    stiffer = replace(right, stiffnesses=[2.0 * k for k in right.stiffnesses])
    contact = replace(printed.contact, linear_stiffness=2e5, hertz_stiffness=2.79e4)
    return Preset(
        key="mate2015_as_run",
        title="the same row with the values that the paper's tables fit (as probably run)",
        reference="inferred from Tables 3 to 5 of Mate, Bakre & Jaiswal (2015); stated nowhere in it",
        scene=Scene([left, middle, stiffer], gaps=printed.gaps, contact=contact),
    )


PRESETS: dict[str, Preset] = {preset.key: preset for preset in (_mate2015(), _mate2015_as_run())}
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
    preset = PRESETS.get(name) if isinstance(name, str) else None
    if preset is None:
        raise SceneError(unknown("preset scene", name, PRESETS))
    return preset.scene

"""Named scenes that a sweep can start from.

Adding a scene is adding one entry to `PRESETS`; sweep files, the Python
interface and the documentation read it.
"""

from __future__ import annotations

from dataclasses import dataclass

from pounding_sweep.errors import SceneError, unknown
from pounding_sweep.scene import Building, ContactProperties, Scene


@dataclass(frozen=True)
class Preset:
    """One named scene.

    Attributes
    ----------
    key : str
        Name in sweeps and on the command line.
    title : str
        What it is, in one line.
    reference : str
        Source of its values.
    scene : Scene
        The row, with its own gaps (m) and contact properties.
    """

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


PRESETS: dict[str, Preset] = {preset.key: preset for preset in (_mate2015(),)}
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

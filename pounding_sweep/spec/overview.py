"""A row in words: its buildings, and where neighbours face each other."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pounding_sweep.base.errors import SceneError
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.model.variants import variants_of
from pounding_sweep.records import STANDARD_GRAVITY
from pounding_sweep.spec.spec import scene_of

#: Elevations that a line lists one by one.
_LISTED = 8


def overview(scene: Scene) -> list[tuple[str, str]]:
    """Describe a row: names of buildings and pairs, and of each what is to be known before anything is run.

    Examples
    --------
    >>> from pounding_sweep.model.scene import Building, Scene
    >>> a, b = Building("a", [100.0] * 2, [1e5] * 2), Building("b", [80.0] * 2, [2e5] * 2, storey_heights=[3.0, 4.0])
    >>> for name, text in overview(Scene([a, b], [0.01])):
    ...     print(f"{name}: {text}")
    a: 2 storeys, 6 m high, periods 0.321, 0.123 s, weight 1962 kN
    b: 2 storeys, 7 m high, periods 0.203, 0.0777 s, weight 1570 kN
    a-b: floors meet at 3 m; floor 2 of a (6 m) stands before columns of b, which it passes through
    """
    lines = [(item.name, _building(item)) for item in scene.buildings]
    systems = zip(scene.linked_buildings, variants_of(scene).systems, strict=True) if scene.links else ()
    for group, (frequencies, _) in systems:
        if len(group) > 1:
            periods = ", ".join(f"{2.0 * math.pi / w:.3g}" for w in frequencies[0, :4])
            lines.append((" + ".join(scene.buildings[b].name for b in group), f"linked, periods as one {periods} s"))
    return lines + [(name, _pair(scene, index)) for index, name in enumerate(scene.pair_names)]


def overview_of(attributes: Mapping[Any, Any]) -> list[tuple[str, str]]:
    """Describe the row of a file by its attributes (a sweep, or the row itself, as JSON); nothing if it has none."""
    try:
        stored = json.loads(attributes["sweep"])["scene"] if "sweep" in attributes else json.loads(attributes["scene"])
        return overview(scene_of(stored))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, SceneError):  # a file may hold anything
        return []


def _building(item: Building) -> str:
    periods = ", ".join(f"{period:.3g}" for period in item.periods[:2])
    several = item.n_storeys > 1
    weight = f"weight {sum(item.masses) * STANDARD_GRAVITY:.0f} kN"
    if item.p_delta:
        weight += f" with P-Delta, stability coefficients up to {max(item.stability_coefficients):.2g}"
    if item.foundation is not None:
        fixed = ", ".join(f"{period:.3g}" for period in item.on_fixed_base.periods[:2])
        weight += f", on a foundation (on a fixed base {fixed} s)"
    return (
        f"{item.n_storeys} storey{'s' * several}, {item.elevations[-1]:g} m high, period{'s' * several} {periods} s, "
        f"{weight}"
    )


def _pair(scene: Scene, pair: int) -> str:
    left, right = scene.row[pair : pair + 2]
    elevations = [z for item in scene.buildings for z in item.elevations]
    met = [c for c in scene.contacts if c.pair == pair]
    meets = [elevations[c.right if c.left < 0 else c.left] for c in met if c.struck < 0]
    limited = " (limited by the scene)" if scene.pair_names[pair] in dict(scene.storeys) else ""
    parts = [
        f"floors meet at {_metres(meets)}{limited}" if meets else f"no floors meet{limited}",
        *_bumpers(scene, pair),
    ]
    for mine, other, found in zip((left, right), (right, left), scene.faced(pair), strict=True):
        strikes = {c.storey for c in met if c.struck >= 0 and (c.struck == 1) == (mine is left)}
        for striking in (True, False):
            floors = [facing.floor for facing in found if (facing.floor + 1 in strikes) is striking]
            if not floors or not isinstance(mine, Building):
                continue
            what = f"floor{'s' * (len(floors) > 1)} {_listed([s + 1 for s in floors])} of {mine.name}"
            where = _metres([mine.elevations[s] for s in floors])
            stand, it = ("stands", "it") if len(floors) == 1 else ("stand", "they")
            does = f"{it} strike{'s' * (it == 'it')}" if striking else f"{it} pass{'es' * (it == 'it')} through"
            parts.append(f"{what} ({where}) {stand} before columns of {other.name}, which {does}")
    return "; ".join(parts)


def _bumpers(scene: Scene, pair: int) -> list[str]:
    """Say of each bumper of a pair at which storeys it stands, its law and numbers."""
    found = []
    for bumper in scene.bumpers:
        if bumper.pair == scene.pair_names[pair]:
            each = zip(scene.contacts, scene.bumper_of, strict=True)
            storeys = [contact.storey for contact, own in each if own is bumper]
            unit = "kN/m" if bumper.law.exponent == 1.0 else f"kN/m^{bumper.law.exponent:g}"
            text = f"storey{'s' * (len(storeys) > 1)} {_listed(storeys)} with bumpers {bumper.law.key!r}: "
            text += f"{1e3 * bumper.thickness:g} mm, " * bool(bumper.thickness) + f"k = {bumper.stiffness:.4g} {unit}"
            found.append(text + (f", e = {bumper.restitution:g}" if bumper.restitution is not None else ""))
    return found


def _listed(values: Sequence[float]) -> str:
    """List numbers; of very many the first and the last, and how many they are."""
    if len(values) <= _LISTED:
        return ", ".join(f"{value:g}" for value in values)
    return f"{values[0]:g} to {values[-1]:g} ({len(values)})"


def _metres(elevations: Iterable[float]) -> str:
    return f"{_listed(sorted(elevations))} m"

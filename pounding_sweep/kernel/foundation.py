"""Foundations: a rigid base under a building, that sways and rocks on springs and dashpots.

Displacements U of floors are those relative to the free field: with the base's displacement u, its rotation
theta and the elevation h of a floor, U = u + h theta + (the building's own), so that masses stay apart.
A storey's drift is U_i - U_(i-1) - (h_i - h_(i-1)) theta, with u in place of U_0, and its shear V_i acts on both
floors and, by its lever arm, on the rotation; Rayleigh's a m acts on motions relative to the base,
w_i = U_i - u - h_i theta, and on the base by reaction:

    m_f u''     = V_1 + a sum m_i w_i' - K_h u - c_h u' - m_f g''
    I   theta'' = sum V_i (h_i - h_(i-1)) + a sum m_i h_i w_i' - K_theta theta - c_theta theta'
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma


def accelerations(group: Group, shears: Any, x: Any, y: Any) -> Iterator[tuple[int, Any]]:
    """Give total accelerations of the sway and the rocking of each base, from the state of the whole row."""
    for b in group.spec.foundations:
        floors, base = group.building_floors[b], group.spec.base(b)
        assert base is not None
        drags = [group.prop("m", i) * (group.prop("alpha", b) * group.deformation(i, y, i)) for i in floors]
        sway, moment = shears[floors[0]], None
        for i, drag in zip(floors, drags, strict=True):
            sway = sway + drag
            part = fma(group.prop("elevation", i), drag, group.prop("height", i) * shears[i])
            moment = part if moment is None else moment + part
        for i, load in zip(base, (sway, moment), strict=True):
            held = fma(group.prop("dashpot", i), y[i], group.prop("k", i) * x[i])
            yield i, group.prop("im", i) * (load - held)


def stiffen(
    group: Group, diagonal: list[Any], beside: list[dict[int, Any]], storeys: Sequence[Any], be: Any, ga: Any
) -> None:
    """Add to the matrix of an implicit step what foundations, and storeys above them by `storeys`, add to it."""

    def add(share: Any, moved: dict[int, Any]) -> None:  # share times the square of a sum of weighted motions
        for p, x in moved.items():
            part = share * x
            diagonal[p] = fma(part, x, diagonal[p])
            for q, z in moved.items():
                if q > p:
                    other = part * z
                    beside[p][q] = beside[q][p] = beside[p][q] + other if q in beside[p] else other

    for b in group.spec.foundations:
        floors, base = group.building_floors[b], group.spec.base(b)
        assert base is not None
        sway, rocks = base
        for i in base:
            held = fma(ga, group.prop("dashpot", i), be * group.prop("k", i))
            diagonal.append(group.prop("m", i) + held)
        for i in floors:
            below = group.spec.below(i)
            assert below is not None
            one = group.full(1.0)
            add(storeys[i], {i: one, below: -one, rocks: -group.full(group.prop("height", i))})
            drag = ga * group.prop("alpha", b) * group.prop("m", i)
            add(drag, {i: one, sway: -one, rocks: -group.full(group.prop("elevation", i))})

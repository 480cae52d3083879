"""The row of buildings: its equation of motion, its energies, its accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma


def storey_forces(group: Group, x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
    """Storey forces f = k (w_i - w_(i-1)), w = x + beta y."""
    spec, forces = group.spec, []
    for b, floors in enumerate(group.building_floors):
        w = [fma(group.prop("beta", b), y[i], x[i]) if len(floors) > 1 else x[i] for i in floors]
        forces += [group.prop("k", i) * (w[s] - w[s - 1] if s else w[s]) for s, i in enumerate(floors)]
    assert len(forces) == spec.n_dof
    return forces


def accelerations(group: Group, x: Sequence[Any], y: Sequence[Any], ground: Any, push: Sequence[Any]) -> list[Any]:
    """Accelerations relative to the ground, of displacements x and velocities y, under contact forces `push`."""
    spec, found, f = group.spec, [], storey_forces(group, x, y)
    for i, b in enumerate(spec.building_of):
        net = -f[i] if spec.top[i] else f[i + 1] - f[i]
        for j, force in enumerate(push):
            left, right, _ = spec.contacts[j]
            if i == left:
                net = net - force
            elif i == right:
                net = net + force
        found.append(fma(group.prop("im", i), net, -fma(group.prop("alpha", b), y[i], ground)))
    return found


def _sum(terms: Sequence[Any]) -> Any:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def powers(group: Group, y: Sequence[Any], ground: Any) -> list[tuple[Any, Any]]:
    """Powers (kW) of the ground and of damping on each building, at the velocities y."""
    spec, found = group.spec, []
    for b, floors in enumerate(group.building_floors):
        momentum = _sum([group.prop("m", i) * y[i] for i in floors])
        mass = _sum([group.prop("m", i) * y[i] * y[i] for i in floors])
        drift = [y[i] if spec.bottom[i] else y[i] - y[i - 1] for i in floors]
        stiff = _sum([group.prop("k", i) * dv * dv for i, dv in zip(floors, drift, strict=True)])
        found.append((-ground * momentum, group.prop("alpha", b) * mass + group.prop("beta", b) * stiff))
    return found


def kinetic(group: Group, b: int) -> Any:
    """v'Mv/2 of building b."""
    return _sum(
        [0.5 * group.prop("m", i) * group.state["v", i] * group.state["v", i] for i in group.building_floors[b]]
    )


def strain(group: Group, b: int) -> Any:
    """u'Ku/2 of building b."""
    terms, below = [], None
    for i in group.building_floors[b]:
        u = group.state["u", i]
        drift = u if below is None else u - below
        terms.append(0.5 * group.prop("k", i) * drift * drift)
        below = u
    return _sum(terms)


def transferred(group: Group, b: int) -> Any:
    """Input - kinetic - damping - strain of building b since the start: what its contacts took."""
    s = group.state
    return s["e_in", b] - s["e_damp", b] - (kinetic(group, b) + strain(group, b) - s["kinetic0", b])


def total_accelerations(group: Group, x: Sequence[Any], y: Sequence[Any], forces: Sequence[Any] | None) -> list[Any]:
    """-M^-1 (C y + K x) and what contact forces add: total accelerations, or of rates x, y and forces their rates."""
    spec, found = group.spec, []
    for b, floors in enumerate(group.building_floors):
        w = [x[i] + group.prop("beta", b) * y[i] for i in floors]
        for s, i in enumerate(floors):
            here = -(group.prop("alpha", b) * y[i]) - group.prop("im", i) * (
                group.prop("k", i) * (w[s] - w[s - 1] if s else w[s])
            )
            if not spec.top[i]:
                here = here + group.prop("im", i) * (group.prop("k", i + 1) * (w[s + 1] - w[s]))
            found.append(here)
    for j, force in enumerate(forces or ()):
        left, right, _ = spec.contacts[j]
        if left >= 0:
            found[left] = found[left] - group.prop("im", left) * force
        if right >= 0:
            found[right] = found[right] + group.prop("im", right) * force
    return found

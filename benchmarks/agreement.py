"""Random rows by three programs: the engine's exact scheme, heyoka's Taylor series, and scipy's DOP853.

`python -m benchmarks.agreement [ROWS]` prints how far they differ; events and peaks are located by each.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

import pounding_sweep as ps
from pounding_sweep.model.laws import damping_number

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the reference solver lives there

#: Step (s) of the engine, tolerance of heyoka.
STEP, TOLERANCE = 2e-4, 1e-15
LAWS = ("linear", "kelvin_voigt")
#: Kinds of rows: storeys of the buildings, walls at the left and right end, linked pairs, buildings with dashpots.
SHAPES: tuple[tuple[tuple[int, ...], bool, bool, tuple[int, ...], tuple[int, ...]], ...] = (
    ((2, 1), False, False, (), ()),
    ((3, 3), False, True, (), (0,)),
    ((2, 4), False, False, (0,), ()),
    ((5, 2), True, False, (), (1,)),
    ((3, 2, 1), False, False, (), ()),
    ((1, 3, 2), False, True, (1,), (0,)),
    ((2, 2, 2), True, True, (), ()),
    ((2, 1, 2, 1), False, False, (), (3,)),
    ((3, 2, 2, 3), False, False, (0, 2), ()),
    ((1, 1, 1, 1), True, False, (), ()),
)


@dataclass(frozen=True)
class Case:
    """One random row under a motion and a law."""

    scene: ps.Scene
    record: ps.Record
    law: str


def draw(seed: int) -> Case:
    """Draw masses, periods, damping, gaps, contact stiffness, restitution and motion of a row of a listed kind."""
    rng = np.random.default_rng(seed)
    storeys, left, right, linked, dashed = SHAPES[seed % len(SHAPES)]
    row: list[Any] = [ps.Wall("west")] if left else []
    for i, n in enumerate(storeys):
        mass = rng.uniform(50.0, 300.0, n)
        stiffness = mass.mean() * (2.0 * np.pi / (rng.uniform(0.1, 0.2) * n)) ** 2 * rng.uniform(0.7, 1.3, n) * n
        dashpots = list(rng.uniform(50.0, 500.0, n)) if i in dashed else None
        row.append(ps.Building("abcd"[i], list(mass), list(stiffness), rng.uniform(0.01, 0.08), dashpots=dashpots))
    row += [ps.Wall("east")] if right else []
    links = [
        ps.Link(f"{'abcd'[i]}-{'abcd'[i + 1]}", [1], rng.uniform(1e3, 2e4), rng.uniform(20.0, 300.0)) for i in linked
    ]
    contact = ps.ContactProperties(linear_stiffness=10 ** rng.uniform(4.5, 6.5), restitution=rng.uniform(0.3, 0.9))
    ground = np.concatenate([[0.0], rng.normal(0.0, 3.0, 150)])
    scene = ps.Scene(row, list(rng.uniform(0.001, 0.01, len(row) - 1)), contact, links=links)
    return Case(scene, ps.Record("noise", 0.02, ground), LAWS[seed // len(SHAPES) % 2])


def by_heyoka(case: Case) -> dict[str, np.ndarray]:
    """Largest and smallest displacement by floor, peak force and impacts by contact, peak force by link."""
    import heyoka as hy

    scene, record = case.scene, case.record
    n, contacts, links = scene.n_dof, scene.contacts, scene.linked_floors
    mass = np.concatenate([b.masses for b in scene.buildings])
    stiffness, damping = (block_diag(*parts) for parts in zip(*map(_matrices, scene.buildings), strict=True))
    for link in links:
        across = np.eye(n)[link.left] - np.eye(n)[link.right]
        stiffness += link.stiffness * np.outer(across, across)
        damping += link.damping * np.outer(across, across)
    k = float(scene.contact.linear_stiffness or 0.0)
    ratio = float(damping_number(ps.get_law(case.law), scene.contact.restitution))
    dashpot = [2.0 * ratio * np.sqrt(k * c.mass) for c in contacts]

    u = hy.make_vars(*[f"u{i}" for i in range(n)], "unused")[:-1]
    v = hy.make_vars(*[f"v{i}" for i in range(n)], "unused")[:-1]
    ground = hy.par[0] + hy.par[1] * hy.time

    def closing(x: Any, left: int, right: int) -> Any:
        return (x[left] if left >= 0 else 0.0) - (x[right] if right >= 0 else 0.0)

    rate = [
        -ground - sum((stiffness[i, j] * u[j] + damping[i, j] * v[j] for j in range(n)), 0.0 * u[0]) / mass[i]
        for i in range(n)
    ]
    depth = [closing(u, c.left, c.right) - scene.gaps[c.pair] for c in contacts]
    press = [k * d + z * closing(v, c.left, c.right) for d, z, c in zip(depth, dashpot, contacts, strict=True)]
    for j, c in enumerate(contacts):
        if c.left >= 0:
            rate[c.left] -= hy.par[2 + j] * press[j] / mass[c.left]
        if c.right >= 0:
            rate[c.right] += hy.par[2 + j] * press[j] / mass[c.right]

    highest, lowest = np.zeros(n), np.zeros(n)
    force, impacts, link_force = np.zeros(len(contacts)), np.zeros(len(contacts)), np.zeros(len(links))
    inside = np.zeros(len(contacts), bool)

    def measure(x: np.ndarray) -> None:
        np.maximum(highest, x[:n], out=highest)
        np.minimum(lowest, x[:n], out=lowest)
        for j, c in enumerate(contacts):
            d, speed = closing(x, c.left, c.right) - scene.gaps[c.pair], closing(x[n:], c.left, c.right)
            if inside[j]:
                force[j] = max(force[j], k * d + dashpot[j] * speed)
        for j, link in enumerate(links):
            pull = link.stiffness * (x[link.left] - x[link.right])
            pull += link.damping * (x[n + link.left] - x[n + link.right])
            link_force[j] = max(link_force[j], abs(pull))

    def peak(ta: Any, time: float, sign: int) -> None:
        measure(ta.update_d_output(time))

    def cross(j: int) -> Callable[[Any, int], bool]:
        def touch_or_part(ta: Any, sign: int) -> bool:
            inside[j] = sign > 0
            impacts[j] += sign > 0
            ta.pars[2 + j] = inside[j]
            measure(ta.state)
            return True

        return touch_or_part

    def pull(j: int) -> Callable[[Any, int], bool]:
        def release_or_press(ta: Any, sign: int) -> bool:
            ta.pars[2 + j] = inside[j] and sign > 0
            return True

        return release_or_press

    turning = list(v)
    for j, c in enumerate(contacts):
        rise = k * closing(v, c.left, c.right) + dashpot[j] * closing(rate, c.left, c.right)
        turning.append(hy.par[2 + j] * rise + (1.0 - hy.par[2 + j]))
    turning += [
        link.stiffness * (v[link.left] - v[link.right]) + link.damping * (rate[link.left] - rate[link.right])
        for link in links
    ]
    ta = hy.taylor_adaptive(
        [*zip(u, v, strict=True), *zip(v, rate, strict=True)],
        np.zeros(2 * n),
        pars=np.zeros(2 + len(contacts)),
        tol=TOLERANCE,
        compact_mode=True,
        t_events=[hy.t_event(d, callback=cross(j)) for j, d in enumerate(depth)]
        + [hy.t_event(f, callback=pull(j)) for j, f in enumerate(press) if dashpot[j]],
        nt_events=[hy.nt_event(f, peak) for f in turning],
    )
    for g0, g1 in zip(record.acceleration[:-1], record.acceleration[1:], strict=True):
        ta.pars[:2] = g0, (g1 - g0) / record.dt
        ta.time = 0.0
        ta.propagate_until(record.dt)
        measure(ta.state)
    names = ("displacement_max", "displacement_min", "impact_force_max", "impact_count", "link_force_max")
    return dict(zip(names, (highest, lowest, force, impacts, link_force), strict=True))


def _matrices(building: ps.Building) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping matrix of one building."""
    stiffness, (a, b) = building.system_matrix, building.rayleigh
    damping = a * np.diag(building.masses) + b * stiffness
    if building.dashpots is not None:
        drift = np.eye(building.n_storeys) - np.eye(building.n_storeys, k=-1)
        damping += drift.T @ np.diag(building.dashpots) @ drift
    return stiffness, damping


def by_engine(case: Case) -> dict[str, np.ndarray]:
    """Return the same by the exact scheme."""
    one = ps.simulate(case.scene, case.record, law=case.law, method="exact", dt=STEP, rest=0.0)
    contacts = [(c.place, c.storey - 1) for c in case.scene.contacts]
    links = [(x.place, x.storey - 1) for x in case.scene.linked_floors]
    result = {}
    for name in ("displacement_max", "displacement_min"):
        values = one[name].values
        result[name] = np.concatenate([values[i, : b.n_storeys] for i, b in enumerate(case.scene.buildings)])
    for name, places in (("impact_force_max", contacts), ("impact_count", contacts), ("link_force_max", links)):
        result[name] = np.array([float(one[name].values[at]) for at in places])
    return result


def by_reference(case: Case) -> dict[str, np.ndarray]:
    """Return the same by the reference solver of the tests: scipy's DOP853 at 1e-12, events by root search."""
    import reference
    from against_reference import buildings_of

    scene, record = case.scene, case.record
    ends = [floors for link in scene.links for floors in link.floors]
    links = [
        (x.pair, x.storey, right, x.stiffness, x.damping)
        for x, (_, right) in zip(scene.linked_floors, ends, strict=True)
    ]
    k, e = scene.contact.linear_stiffness, scene.contact.restitution
    row, gaps = buildings_of(scene), list(scene.gaps)
    one = reference.run(row, gaps, record.acceleration, record.dt, case.law, k, e, links=links, rtol=1e-12, atol=1e-14)
    result = {
        name: np.concatenate([one[name][i] for i, b in enumerate(scene.row) if not isinstance(b, ps.Wall)])
        for name in ("displacement_max", "displacement_min")
    }
    result |= {name: np.concatenate(one[name]).astype(float) for name in ("impact_force_max", "impact_count")}
    return result | {"link_force_max": np.array([one["link_force"][x.pair][x.storey - 1] for x in scene.linked_floors])}


def difference(mine: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    """Largest difference over the largest value of its variable; infinite where numbers of impacts differ."""
    if not np.array_equal(mine["impact_count"], other["impact_count"]):
        return np.inf
    return max(float(np.abs(mine[n] - x).max() / np.abs(x).max()) for n, x in other.items() if x.size)


def main() -> None:
    """Print the largest differences of each kind of row."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    worst = np.zeros((len(SHAPES), 3))
    for seed in range(rows):
        case = draw(seed)
        mine, taylor, twin = by_engine(case), by_heyoka(case), by_reference(case)
        new = difference(mine, taylor), difference(mine, twin), mine["impact_count"].sum()
        kind = worst[seed % len(SHAPES)]
        kind[:] = max(kind[0], new[0]), max(kind[1], new[1]), kind[2] + new[2]
    heads = ("storeys", "walls", "links", "dashpots", "impacts", "engine - heyoka", "engine - DOP853")
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for (storeys, left, right, linked, dashed), (taylor, twin, impacts) in zip(SHAPES, worst, strict=True):
        sizes = " ".join(map(str, storeys))
        numbers = f"{left + right} | {len(linked)} | {len(dashed)} | {impacts:.0f} | {taylor:.1e} | {twin:.1e}"
        print(f"| {sizes} | {numbers} |")
    print(f"\n{rows} rows under `linear` and `kelvin_voigt`; differences over a variable's largest value")


if __name__ == "__main__":
    main()

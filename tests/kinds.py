"""Kinds of rows, one a feature of the model: what `test_kinds_of_rows` runs of each, and within which bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from kernels_used import (
    BUMPED,
    DEGRADING,
    FOUNDED,
    LEANING,
    LEANING_YIELDS,
    LINKED,
    PADDED,
    SMOOTH,
    STAGGERED,
    YIELDING_SWEEP,
)
from scenes import EVERY, OUTPUTS, motions, pair, yielding_pair

import pounding_sweep as ps

A, B = pair().buildings
YIELDS = yielding_pair()
#: The pair with another hardening in each storey.
STEPPED = replace(
    YIELDS, row=[replace(b, hardening=r) for b, r in zip(YIELDS.buildings, ([0.05, 0.3], [0.2, 0.1]), strict=True)]
)
#: More floors than one straight line of code holds; storeys that yield, links between floors of unequal numbers.
TOWER = ps.Scene(
    [
        ps.Building("tower", [100.0] * 7, [4.5e5] * 7, yield_strengths=np.linspace(900.0, 200.0, 7), hardening=0.02),
        ps.Building("annex", [120.0] * 5, [3.5e5] * 5, dashpots=[500.0, 0.0, 0.0, 200.0, 0.0]),
        ps.Building("twin", [90.0] * 5, [2.5e5] * 5, yield_strengths=[500.0] * 5),
    ],
    gaps=[0.004, 0.004],
    contact=pair().contact,
    links=[ps.Link("tower-annex", [2, (4, 3)], 1e4, 400.0), ps.Link("annex-twin", [5], 5e4)],
)
#: The same without links and dashpots, and all elastic.
ALONE = replace(TOWER, row=[replace(b, dashpots=None) for b in TOWER.row], links=())
HIGH = replace(TOWER, row=[replace(b, yield_strengths=None, hardening=0.0) for b in TOWER.row])
#: Five buildings of which those in the middle touch, and all in a stronger motion.
SIZES = {"a": (4, 3e5), "b": (3, 1.6e5), "c": (4, 5e5), "d": (3, 1.1e5), "e": (4, 2.5e5)}
FIVE = ps.Scene(
    [ps.Building(name, [110.0] * n, [k] * n) for name, (n, k) in SIZES.items()],
    gaps=[0.05, 0.004, 0.05, 0.05],
    contact=pair().contact,
)
#: Rows of which only the dashpot, or only the link, couples modes.
DASHED, TIED = replace(LINKED, links=()), replace(LINKED, row=[replace(LINKED.row[0], dashpots=None), LINKED.row[1]])
#: Storeys that yield in a row with dashpots and a link, at a wall; with dampers that soften, or without.
SOFTENING = ps.Scene(
    [
        replace(A, yield_strengths=[220.0, np.inf], hardening=0.05, dashpots=[200.0, 0.0], damping_stiffness="tangent"),
        replace(B, dashpots=[0.0, 90.0]),
        ps.Wall(),
    ],
    [0.003, 0.004],
    pair().contact,
    links=[ps.Link("a-b", [2], 0, 150)],
)
YIELDING_LINKED = replace(
    SOFTENING,
    row=[
        replace(SOFTENING.row[0], damping_stiffness="initial"),
        replace(SOFTENING.row[1], yield_strengths=[180.0, 200.0]),
        ps.Wall(),
    ],
    links=[ps.Link("a-b", [2], 2e4, 150.0)],
)
SOFT = FOUNDED.row[0].foundation
#: Both on foundations: storeys that yield with dashpots, unequal heights, linked roofs.
BOTH = replace(
    SOFTENING,
    row=[
        replace(SOFTENING.row[0], storey_heights=[4.0, 2.0], foundation=SOFT),
        replace(B, storey_heights=[4.0, 2.0], foundation=ps.Foundation(40.0, 90.0, 4e5, 3e6, 300.0)),
        ps.Wall(),
    ],
    links=[ps.Link("a-b", [2], 1e4, 150.0)],
)
#: A building of Bouc and Wen on a foundation, beside a bilinear one that leans.
MIXED = replace(
    SMOOTH, row=[replace(SMOOTH.row[0], p_delta=False, foundation=SOFT), replace(SMOOTH.row[1], hysteresis=None)]
)
TALL_FOUNDED = ps.Scene(
    [
        ps.Building("a", [100.0] * 12, [3e5] * 12, foundation=replace(SOFT, mass=200.0, inertia=8e3)),
        ps.Building("b", [90.0] * 10, [3.5e5] * 10, foundation=replace(SOFT, rocking_stiffness=6e7)),
    ],
    [0.01],
    pair().contact,
)
#: Bumpers of two kinds in a long row.
LONG = ps.Scene(
    [
        ps.Building("tower", [100.0] * 7, [4.5e5] * 7),
        ps.Building("annex", [120.0] * 5, [3.5e5] * 5),
        ps.Building("twin", [90.0] * 5, [2.5e5] * 5),
        ps.Wall(),
    ],
    gaps=[0.012, 0.004, 0.012],
    contact=pair().contact,
    bumpers=[
        replace(BUMPED.bumpers[0], pair="tower-annex", storeys=[2, 3, 4]),
        replace(BUMPED.bumpers[0], pair="twin-wall"),
        ps.Bumper("annex-twin", "hysteretic", 5e6, 0.5, 0.001, [5]),
    ],
)
#: Floors of which a long row strikes columns too.
LONG_STAGGERED = ps.Scene(
    [
        ps.Building("tower", [100.0] * 12, [4.5e5] * 12),
        ps.Building("annex", [120.0] * 5, [3.5e5] * 5, storey_heights=[4.0, 2.0, 3.5, 3.5, 3.2]),
    ],
    gaps=[0.004],
    contact=pair().contact,
    contacts="floors and columns",
)
TOWER_ABOVE = ps.Building("tower", [150.0] * 3, [3e5] * 3, 0.02, storey_heights=[3.5] * 3)
#: On isolators that yield and have a dashpot, in its moat.
ISOLATED = ps.Scene(
    [ps.base_isolated(TOWER_ABOVE, 150.0, 2.5, 0.05, 250.0, 0.01), ps.Wall()],
    [0.03],
    ps.ContactProperties(linear_stiffness=5e5, restitution=0.6),
    storeys={"tower-wall": [1]},
)
EACH_SORT = ("none", "hertz_damped", "hysteretic", "stereomechanical")
WITHOUT_AND_WITH = ("none", "kelvin_voigt")


@dataclass(frozen=True)
class Kind:
    """A row, and the methods that are held against the reference with their steps and bounds."""

    scene: ps.Scene
    #: By day, under the law.
    runs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: Nightly, under each of the laws.
    slow: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    laws: tuple[str, ...] = EACH_SORT
    law: str = "kelvin_voigt"
    points: int = 101
    scale: float = 1.5
    #: Whether a result proves that the feature acts.
    acts: Callable = lambda got: got.impact_count.sum() > 5
    #: Variables whose errors are to fall at the order of the scheme, and the schemes of which only nightly.
    order: tuple[str, ...] = ()
    nightly: tuple[str, ...] = ()
    #: Histories of energies beside the usual ones.
    stores: tuple[str, ...] = ()
    #: Variables that are rough where velocities jump.
    loose: tuple[str, ...] = ()


def all_touch(got):
    return (got.impact_count > 0).any("storey").all()


def yields(got):
    return got.ductility_max.max() > 1.5


def both_yield(got):
    return (got.ductility_max > 1.5).sum() == 3 and got.impact_count.sum() >= 4


def squeezed_flat(got):
    return (got.impact_count.sum("storey") > 3).all() and got.penetration_max.sel(pair="a-b").max() > 0.8 * 0.009


_YIELDS = {"rk4": (5e-4, 2e-5), "exact": (5e-4, 1e-6), "newmark": (2e-4, 3e-3)}
_SMALL = {"rk4": (5e-4, 1e-5), "newmark": (1e-4, 2e-3), "central_difference": (1e-4, 2e-3)}
_EXACT = {"exact": (5e-4, 1e-5)}
KINDS = {
    "yields": Kind(
        YIELDS,
        _YIELDS,
        {"rk4": (5e-4, 3e-5), "central_difference": (1e-4, 5e-3)},
        acts=both_yield,
        order=("displacement_max", "displacement_min", "storey_shear_max", "acceleration_max", "hysteretic_energy"),
        stores=("hysteretic",),
    ),
    "stepped": Kind(STEPPED, _YIELDS, acts=both_yield),
    "a long row that yields": Kind(
        ALONE, {}, {"rk4": (5e-4, 5e-5), "newmark": (2e-4, 5e-3)}, WITHOUT_AND_WITH, scale=3.0, points=51, acts=yields
    ),
    "linked": Kind(
        LINKED,
        {"rk4": (5e-4, 8e-7), "newmark": (1e-3, 8e-3), "exact": (1e-3, 1e-9)},
        {"rk4": (5e-4, 2e-6), "newmark": (2e-4, 2e-3), "central_difference": (1e-4, 2e-3), **_EXACT},
        order=("displacement_max", "link_force_max", "energy_damping", "energy_links", "impact_force_max"),
        nightly=("rk4", "newmark", "central_difference"),
        stores=("given_to_links",),
    ),
    "dashpots": Kind(DASHED, {}, _EXACT, ("linear", "modified_kelvin", *EACH_SORT)),
    "tied": Kind(TIED, {}, _EXACT, ("linear", "modified_kelvin", *EACH_SORT)),
    "linked towers": Kind(
        TOWER, {}, {"rk4": (5e-4, 2e-6), "newmark": (2e-4, 5e-3), **_EXACT}, WITHOUT_AND_WITH, points=51, scale=3.0
    ),
    "elastic towers": Kind(HIGH, {}, _EXACT, WITHOUT_AND_WITH, points=51, scale=3.0),
    "five": Kind(FIVE, {}, _EXACT, ("linear", "kelvin_voigt"), scale=6.0, acts=all_touch),
    "linked and yielding": Kind(YIELDING_LINKED, {}, _EXACT, WITHOUT_AND_WITH, points=51, scale=3.0, acts=yields),
    "linked and softening": Kind(SOFTENING, {}, _SMALL, ("kelvin_voigt",), acts=yields),
    "isolated": Kind(
        ISOLATED, {}, {"rk4": (1e-3, 2e-5), "exact": (5e-4, 1e-6)}, ("kelvin_voigt",), points=201, scale=2.0,
        acts=lambda got: got.ductility_max.max() > 3.0 and got.impact_count.sum() >= 2,
    ),
    "founded": Kind(
        FOUNDED,
        {"rk4": (5e-4, 8e-7), "newmark": (1e-3, 8e-3), "exact": (1e-3, 1e-8)},
        {"rk4": (5e-4, 4e-6), "newmark": (2e-4, 4e-3), "central_difference": (1e-4, 4e-3), **_EXACT},
        acts=lambda got: got.impact_count.sum() > 10,
        order=("displacement_max", "foundation_sway_max", "foundation_rotation_max", "energy_damping", "energy_strain",
               "impact_force_max"),
        nightly=("rk4", "newmark", "central_difference"),
        loose=("contact_time",),
    ),
    "both founded": Kind(BOTH, {}, _SMALL | _EXACT, ("kelvin_voigt", "hertz_damped"), acts=yields),
    "founded towers": Kind(
        TALL_FOUNDED, {}, {"rk4": (1e-3, 1e-5), "newmark": (1e-3, 2e-3), **_EXACT}, ("kelvin_voigt",), scale=2.0,
        acts=lambda got: got.impact_count.sum() > 10,
    ),
    "bumped": Kind(
        BUMPED,
        {"rk4": (5e-4, 1e-6), "newmark": (5e-4, 3e-3)},
        {"rk4": (5e-4, 1e-5), **_EXACT, "newmark": (2e-4, 2e-3), "central_difference": (1e-4, 2e-3)},
        ("linear", "kelvin_voigt_tension", "nonlinear_viscoelastic", "hysteretic"),
        law="hertz_damped",
        order=("displacement_max", "impact_force_max"),
        nightly=("rk4", "newmark"),
        points=86,
        acts=squeezed_flat,
    ),
    "padded": Kind(PADDED, {"exact": (5e-3, 5e-6)}, points=51),  # by series, at any step
    "long and bumped": Kind(
        LONG, {}, {"rk4": (5e-4, 1e-5), **_EXACT, "newmark": (2e-4, 5e-3)}, ("hertz_damped", "kelvin_voigt"),
        points=51, scale=3.0, acts=lambda got: (got.impact_count.max("storey") > 0).all(),
    ),
    "leaning": Kind(LEANING, {"rk4": (1e-3, 2e-5), "exact": (1e-3, 2e-5)}, points=251,
                    acts=lambda got: got.impact_count.sum() >= 5),
    "leaning and yielding": Kind(
        LEANING_YIELDS, {"rk4": (5e-4, 1e-5)}, {"newmark": (2e-4, 3e-3), "exact": (5e-3, 1e-9)}, ("kelvin_voigt",),
        points=251, acts=lambda got: (got.ductility_max > 3.0).sum() == 3, stores=("hysteretic",),
    ),
    "smooth": Kind(
        SMOOTH,
        {"exact": (5e-3, 1e-8), "rk4": (1e-3, 5e-6), "newmark": (2.5e-4, 2e-4)},
        {"rk4": (5e-4, 1e-5), **_EXACT},
        ("none", "hertz_damped", "stereomechanical"),
        law="linear",
        points=126,
        scale=2.0,
        acts=lambda got: (got.ductility_max > 1.5).sum() >= 3 and got.impact_count.sum() >= 3,
        stores=("hysteretic",),
    ),
    "smooth, founded, beside bilinear": Kind(
        MIXED, {}, {"rk4": (5e-4, 1e-5), "newmark": (2.5e-4, 2e-4), **_EXACT}, ("none", "linear"), points=126,
        scale=2.0, acts=yields, stores=("hysteretic",),
    ),
    "degrading": Kind(
        DEGRADING,
        {"exact": (5e-3, 1e-8)},
        {"rk4": (5e-4, 2e-5), "newmark": (2.5e-4, 2e-3), **_EXACT},
        ("none", "linear", "hertz_damped", "stereomechanical"),
        law="linear", points=96, scale=2.0, stores=("hysteretic",),
        acts=lambda got: (got.ductility_max > 3.0).sum() >= 3 and got.impact_count.sum() >= 3,
    ),
    "staggered": Kind(
        STAGGERED,
        {"rk4": (5e-4, 4e-6), "newmark": (1e-4, 1e-3)},
        {"rk4": (5e-4, 2e-5), **_EXACT, "central_difference": (1e-4, 1e-3)},
        ("linear", "kelvin_voigt", "linear_viscoelastic", "kelvin_voigt_tension", "modified_kelvin"),
        points=126,
        acts=lambda got: (got.impact_count > 0).sum() >= 3,
        order=("displacement_max", "impact_force_max"),
        nightly=("rk4", "newmark"),
    ),
    "long and staggered": Kind(
        LONG_STAGGERED, {}, {"rk4": (5e-4, 1e-5), "newmark": (1e-4, 2e-3)}, ("kelvin_voigt",), points=80,
        acts=lambda got: (got.impact_count > 0).sum() >= 6,
    ),
}  # fmt: skip
#: Rows without a reference of this kind, and the schemes that run them.
INVARIANT = {name: (kind.scene, kind.law, tuple(kind.runs)) for name, kind in KINDS.items() if kind.runs}
INVARIANT["the pair"] = pair(), "kelvin_voigt", ("rk4", "exact")
INVARIANT["the pair, by powers"] = pair(), "hertz_damped", ("newmark", "central_difference")
#: Of each feature: a row with it, one that names it and has none of it, what of a kernel's shape and of its reducers is
#: the feature's.
FEATURES = {
    "yielding": (
        YIELDS,
        replace(pair(), row=[replace(b, yield_strengths=[np.inf] * 2, hardening=0.3) for b in pair().row]),
        {"yielding": (0, 1, 2)},
        {"shear", "residual", "hysteretic"},
    ),
    "links": (
        LINKED,
        replace(pair(), row=[replace(b, dashpots=[0.0, 0.0]) for b in pair().row]),
        {"dashpots": (0,), "links": ((1, 3),)},
        {"links", "link_force"},
    ),
    "foundations": (FOUNDED, pair(), {"foundations": (0,), "n_moving": 6}, {"foundation"}),
    "bumpers": (BUMPED, pair(), {"bumped": (1, 1, 0, 0, 2, 0)}, set()),
    "columns": (STAGGERED, replace(pair(), contacts="floors and columns"), {"struck": (1, 0, 0, -1)}, set()),
    "weights": (LEANING_YIELDS, pair(), {"p_delta": True, "falling": (0, 1, 2)}, set()),
    "flowing": (SMOOTH, pair(), {"flowing": (0, 1, 2, 3)}, set()),
}  # fmt: skip
_MOTION = ps.Record("cut", 0.02, ps.find_record("el_centro").acceleration[50:151])
_LINKED_SWEEP = {
    "scene": LINKED,
    "records": _MOTION,
    "laws": ["none", "kelvin_voigt"],
    "gaps": [0.001, 0.003],
    "scales": [1.5, 3.0],
    "period_factors": {"b": [1.0, 1.3]},
    "mass_factors": {"a": [0.5, 1.0]},
    "dt": 1e-3,
    "outputs": ["displacement_max", "drift_max", "link_force_max", "energy_links", "impact_count"],
}
_COLUMNS_SWEEP = {
    "scene": STAGGERED,
    "records": _MOTION,
    "laws": ["linear", "kelvin_voigt"],
    "gaps": [0.002, 0.5],
    "stiffnesses": [2e5, 8e5],
    "period_factors": {"a": [0.8, 1.0]},
    "mass_factors": {"b": [1.3]},
    "dt": 1e-3,
    "outputs": ["displacement_max", "impact_force_max", "impact_count", "column_shear_top_max"],
}
_BUMPED_SWEEP = {
    "scene": BUMPED,
    "records": motions()[0],
    "laws": ["none", "linear", "kelvin_voigt"],
    "gaps": [0.009, 0.012, 0.05],
    "mass_factors": {"a": [1.0, 1.5]},
    "dt": 1e-3,
    "outputs": [*OUTPUTS, "contact_work"],
}
#: Sweeps whose scenarios are run one by one: what they are, and how near both come; the first by day.
SWEEPS = {
    **{
        f"the pair, {method}": (
            _BUMPED_SWEEP
            | {"scene": pair(), "scales": 3.0, "dt": 0.002, "method": method, "outputs": EVERY}
            | {"laws": ["none", "kelvin_voigt"], "gaps": [0.0005, 0.5, 0.002], "audit": 0.0, "rest": 0.0}
            | {"period_factors": {"a": [0.8, 1.5]}, "damping_ratios": [0.02, 0.05]},
            near,
        )
        for method, near in (("rk4", 1e-10), ("exact", 1e-3))
    },
    "yields": (YIELDING_SWEEP, 1e-8),
    "linked": (_LINKED_SWEEP, 1e-8),
    "linked, float32": (_LINKED_SWEEP | {"precision": "float32"}, 2e-3),
    **{
        f"founded, {method}": (
            _LINKED_SWEEP
            | {
                "scene": FOUNDED,
                "method": method,
                "audit": 0.0,
                "rest": 0.0,  # in which late grazes are of rounding
                "damping_ratios": [0.02, 0.06],
                "period_factors": {"a": [1.0, 1.3]},
            }
            | {"outputs": ["displacement_max", "drift_max", "foundation_sway_max", "energy_damping", "impact_count"]},
            near,
        )
        for method, near in (("rk4", 1e-8), ("exact", 2e-5))  # which flies in longer steps than those of a history
    },
    **{f"bumped, {method}": (_BUMPED_SWEEP | {"method": method}, 2e-6) for method in ("rk4", "exact")},
    **{  # flight looks for peaks otherwise
        f"staggered, {method}": (_COLUMNS_SWEEP | {"method": method}, 2e-3) for method in ("rk4", "newmark", "exact")
    },
}


def varied(scene, at):
    """The scene with what the axes of a sweep say built into it, and whether its floors may touch."""
    row = []
    for b in scene.row:
        f, m, strength = (float(at.get(f"{kind}_factor_{b.name}", 1.0)) for kind in ("period", "mass", "strength"))
        if isinstance(b, ps.Wall):
            row.append(b)
            continue
        factors = {"masses": m, "stiffnesses": m / f**2, "dashpots": m / f, "column_stiffnesses": m / f**2}
        factors["yield_strengths"] = m * strength
        lists = {name: [x * y for y in getattr(b, name)] for name, x in factors.items() if getattr(b, name)}
        base = b.foundation and ps.Foundation(
            *(x * y for x, y in zip(vars(b.foundation).values(), (m, m, *[m / f**2] * 2, *[m / f] * 2), strict=True))
        )
        hardening = float(at.get(f"hardening_{b.name}", 0)) if f"hardening_{b.name}" in at else b.hardening
        ratio = float(at.get("damping_ratio", b.damping_ratio))
        row.append(replace(b, **lists, foundation=base, hardening=hardening, damping_ratio=ratio))
    contact = replace(scene.contact, linear_stiffness=at["stiffness"]) if "stiffness" in at else scene.contact
    gap = 1e3 if at["law"] == "none" else float(at["gap"])
    return replace(scene, row=row, gaps=[gap] * len(scene.gaps), contact=contact)


def mirrored(scene):
    """The row seen from behind, and what its pairs are called there."""
    names = {name: "-".join(reversed(name.split("-"))) for name in scene.pair_names}
    image = replace(
        scene,
        row=scene.row[::-1],
        gaps=scene.gaps[::-1],
        storeys={names[name]: storeys for name, storeys in scene.storeys},
        links=[replace(x, pair=names[x.pair], storeys=[floors[::-1] for floors in x.floors]) for x in scene.links],
        bumpers=[replace(x, pair=names[x.pair]) for x in scene.bumpers],
    )
    return image, {name: name.replace(name.split()[0], names[name.split()[0]]) for name in scene.pair_labels}

"""Elements of the kernel: buildings whose stiffness and damping are matrices, beside NumPy's, and beside chains."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from kernels_used import FOUNDED
from scenes import motions, pair

import pounding_sweep as ps
from pounding_sweep.engine.kernel import make_group
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.row import accelerations, powers, strain
from pounding_sweep.kernel.spec import property_slots
from pounding_sweep.schemes.newmark import _solve_row
from pounding_sweep.variables.registry import VARIABLES, reducers_for

SCENES = {"on the ground": pair(), "on a foundation": FOUNDED}
LANES = 3


def by_pairs(matrix):
    """Stiffnesses of the springs between any two floors, and between each and the base, whose matrix it is."""
    springs = np.diag(matrix.sum(axis=1)) - matrix * (1.0 - np.eye(len(matrix)))
    return springs[np.triu_indices(len(matrix))]


class ByMatrices(RowKernel):
    """A row whose first building is given by matrices: those of its chain, or others."""

    others = None  # K and C

    @cached_property
    def shape(self):
        return replace(RowKernel.shape.func(self), dense=(0,))

    @property
    def matrices(self):
        building = replace(self.scene.buildings[0], foundation=None)
        stiff = building.stiffness_matrix
        return self.others or (stiff, building.rayleigh[1] * stiff)

    def constants(self, rough=False):
        numbers, slots = super().constants(rough).copy(), property_slots(self.shape)
        for name, matrix in zip(("pair_k", "pair_c"), self.matrices, strict=True):
            numbers[slots.first[name] :][: slots.count[name]] = by_pairs(matrix)
        return numbers


def kernel(kind, scene, method):
    return kind(scene, ps.get_law("kelvin_voigt"), Numerics(method, 4e-3), frozenset(reducers_for(list(VARIABLES))))


@pytest.mark.parametrize(
    ("where", "method"), [("on the ground", "exact"), ("on a foundation", "rk4"), ("on a foundation", "newmark")]
)
def test_a_chain_by_its_matrix_moves_as_the_chain(where, method):
    """Contacts, series beside exact flight, implicit steps and energies: to rounding."""
    record = ps.Record("short", 0.02, motions()[0].acceleration[:30])
    axes = {"scale": [1.0, 1.5], "gaps": [[0.0005], [0.001]], "stiffness": [1e6, 4e5], "restitution": [0.5, 0.7]}
    results = [
        kernel(kind, SCENES[where], method).run(record, **{name: np.array(x) for name, x in axes.items()}, twin=True)
        for kind in (RowKernel, ByMatrices)
    ]
    chain, matrix = results
    assert chain["count"].sum() >= 2
    for name, values in chain.items():
        scale = np.abs(values).max(initial=1e-12)
        np.testing.assert_allclose(matrix[name], values, rtol=0.0, atol=1e-10 * scale, err_msg=name)


@pytest.mark.parametrize("where", SCENES)
def test_any_matrices_act_as_they_are(where):
    """Accelerations, powers, strain energy and the matrix of an implicit step."""
    draw = np.random.default_rng(3)
    root = draw.normal(size=(2, 2))
    stiff, damped = 1e4 * (root @ root.T + np.eye(2)), 50.0 * (root.T @ root + 0.1 * np.eye(2))
    row = kernel(ByMatrices, SCENES[where], "newmark")
    object.__setattr__(row, "others", (stiff, damped))
    building, group = row.scene.buildings[0], make_group(row.shape, None, LANES, row.constants())
    part = group.part((0, [0, 1]))
    moved = building.deformations  # of floors relative to the base, by all that moves
    mass, alpha = building.inertias, building.rayleigh[0]
    k, c = moved.T @ stiff @ moved, moved.T @ (damped + alpha * np.diag(building.masses)) @ moved
    if base := building.foundation:
        k[[2, 3], [2, 3]] += base.stiffnesses
        c[[2, 3], [2, 3]] += base.dashpots
    x, y = draw.normal(size=(2, len(mass), LANES))
    pushed = np.where(np.arange(len(mass)) == 3, 0.0, 1.0)[:, None]  # by the ground: no rotation
    a = accelerations(group, part, list(x), list(y), lambda b: 2.0, ())
    np.testing.assert_allclose(a, (-k @ x - c @ y) / mass[:, None] - 2.0 * pushed, rtol=1e-12)
    ((gained, lost),) = powers(group, part, list(y), lambda b: 2.0)
    np.testing.assert_allclose(gained, -2.0 * (mass[:, None] * pushed * y).sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(lost, np.einsum("in,ij,jn->n", y, c, y), rtol=1e-12)
    for i, value in zip(part.dofs, x, strict=True):
        group.state["u", i] = value
    np.testing.assert_allclose(strain(group, 0, [0, 1]), 0.5 * np.einsum("in,ij,jn->n", x, k, x), rtol=1e-12)
    be, ga = 2e-6, 1e-3
    solved = _solve_row(group, part, be, ga, [np.full(LANES, 1.0)] * len(mass))
    np.testing.assert_allclose(
        np.array(solved)[:, 0], np.linalg.solve(np.diag(mass) + ga * c + be * k, np.ones(len(mass))), rtol=1e-12
    )

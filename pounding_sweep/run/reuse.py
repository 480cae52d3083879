"""Results of an earlier cube as chunks of a sweep that has some of its scenarios."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import FilePath
from pounding_sweep.output import identity, scenario_rows
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE
from pounding_sweep.output.identity import check_one_study, installed, made_by, motions_of, recorded_sweep, source
from pounding_sweep.output.netcdf import SLAB_BYTES, open_cube, slabs
from pounding_sweep.output.results import table_type
from pounding_sweep.output.scenario_rows import places_of, planned_columns, read_rows, scenario_keys, varies_buildings
from pounding_sweep.plan.plan import Plan
from pounding_sweep.plan.scenarios import Chunk, chunk_key
from pounding_sweep.request.spec import to_json
from pounding_sweep.variables.registry import Status, cube_variables

#: Scenarios whose keys are worked out at once.
KEY_BLOCK = 2**18


class EarlierCube:
    """Results of an earlier cube, by what the scenarios are."""

    def __init__(self, path: FilePath, plan: Plan) -> None:
        self.path, self._plan = os.fspath(path), plan
        with open_cube(path) as cube:
            if not {"sweep", SOURCE_ATTRIBUTE} <= cube.attrs.keys() or "status" not in cube.data_vars:
                raise InputError(
                    f"{self.path!r} does not say what it needs to be extended: it has no status, or no attribute "
                    f"'sweep' or {SOURCE_ATTRIBUTE!r}, as a cube merged from those of several versions; give one made "
                    "by this version's 'pounding-sweep run', or run without it"
                )
            self._sweep = recorded_sweep(self.path, cube)
            self._new = json.loads(to_json(plan.spec))
            # what kept as small an error is as good, by whatever scheme and steps
            self._accuracies = self._sweep["accuracy"], plan.spec.accuracy
            accurate = None not in self._accuracies and self._accuracies[0] <= self._accuracies[1]
            chosen = {name for name in ("method", "precision") if self._new[name] is None} | {"accuracy"}
            free = dict.fromkeys({"force_unstable", *(chosen if accurate else ())})
            pairs = identity.differing_sweeps(self._sweep | free, self._new | free)
            check_one_study(repr(self.path), "this sweep", pairs, "Make them agree, or run the sweep without the cube")
            made, now = made_by(cube.attrs), installed()
            check_one_study(
                repr(self.path), "this sweep", [(key, made[key], now[key]) for key in now], identity.MAKERS_REMEDY
            )
            varied = varies_buildings(cube, self._sweep), len(plan.variants) > 1
            if not accurate and varied[0] != varied[1]:
                raise InputError(
                    f"{self.path!r} can't be extended: only one of the two sweeps varies building properties, which "
                    "runs in kernels of its own; run the sweep without it"
                )
            self.origin = source(self.path, cube.attrs)

    def chunks(self, wanted: np.ndarray) -> Iterator[tuple[Chunk, np.ndarray]]:
        """Go through the results that answer wanted rows of the plan, each row once; raises `OutputError`."""
        plan = self._plan
        if not len(wanted):
            return
        parts = np.split(wanted, range(KEY_BLOCK, len(wanted), KEY_BLOCK))
        keys = np.concatenate([scenario_keys(planned_columns(plan, rows)) for rows in parts])
        order = np.argsort(keys)
        keys, rows, missing = keys[order], wanted[order], np.ones(len(wanted), bool)
        has_flight = np.zeros(len(plan.uncoupled_runs), bool)
        has_flight[plan.uncoupled_to_run] = True
        kind = table_type(cube_variables(plan.outputs), plan.spec.scene)
        then, now = motions_of(self._sweep), motions_of(self._new)
        names = [name for name, motion in now.items() if then.get(name) == motion]
        with open_cube(self.path) as stored:
            cube = stored.assign_coords(record=stored["record"].where(stored["record"].isin(names), ""))
            sizes = {str(dim): size for dim, size in cube["status"].sizes.items()}
            for slab in slabs([*sizes.values()], max(1, SLAB_BYTES // kind.itemsize)):
                where: Any = dict(zip(sizes, slab, strict=True))
                places = places_of(
                    scenario_keys(scenario_rows.cube_columns(cube.isel(where), self._sweep, sizes)), keys
                )
                hits = np.flatnonzero((places >= 0) & missing[places])
                if not len(hits):
                    continue
                table, places = read_rows(self.path, cube, where, kind)[hits], places[hits]
                has_result = ~np.isin(table["status"], [Status.NOT_RUN, Status.BEYOND_STABILITY_LIMIT])
                if self._accuracies[0] != self._accuracies[1]:  # what did not settle to less may settle now
                    has_result &= table["status"] != Status.UNSETTLED
                # what never touched may be from the kernel without contacts, if this sweep has not run that
                has_result &= np.isfinite(table["steps_per_contact"]) | has_flight[plan.uncoupled_of[rows[places]]]
                places, first = np.unique(places[has_result], return_index=True)
                missing[places] = False
                table, answered = table[has_result][first], rows[places]
                kinds = np.stack([plan.unique.law[answered], plan.unique.record[answered]], axis=1)
                for law, record in np.unique(kinds, axis=0).tolist():
                    of_kind = (kinds == (law, record)).all(axis=1)
                    key = chunk_key(f"{plan.digest}:{self.origin['sweep_sha256']}:", answered[of_kind])
                    yield Chunk(key, law, record, answered[of_kind], 0), table[of_kind]

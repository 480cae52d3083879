"""What cannot be modelled is said: by keys that a user may try, and by plans of rows that are chains of storeys."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pytest

from pounding_sweep.base.errors import SceneError
from pounding_sweep.base.files import read_data
from pounding_sweep.model.building import Building, Foundation
from pounding_sweep.model.frames import typical_building
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Bumper, ContactProperties, Link, Scene
from pounding_sweep.records import Record
from pounding_sweep.request.build import Arguments
from pounding_sweep.run.simulate import simulate
from pounding_sweep.run.sweep import Sweep


def test_keys_of_what_cannot_be_modelled_are_not_keys_that_are_valid():
    valid = {
        name
        for cls in (Building, Scene, Link, Bumper, Foundation, Law, Record)
        for name in inspect.signature(cls).parameters
    }
    valid |= {*Arguments.model_fields, *inspect.signature(simulate).parameters}
    patterns = [topic["keys"] for topic in read_data("unmodelled.toml").values()]
    assert [name for name in sorted(valid) if any(re.match(pattern, name) for pattern in patterns)] == []
    with pytest.raises(
        SceneError, match=r"unknown key 'delay'.* cannot be modelled; take from the gap .*'What cannot be modelled'"
    ):
        Building("a", [1.0], [1.0], delay=0.1)


def test_a_plan_names_two_periods_of_tall_buildings():
    tall, low = Building("tall", [100.0] * 4, 1e5), Building("low", [100.0] * 3, 1e5)
    walls = typical_building("walls", 5, 0.4, 100.0)  # no chain
    rows = dict(Sweep(Scene([tall, low, walls], 0.01, ContactProperties(2e6)), "el_centro", "linear").plan().rows())
    w = 2.0 * np.sqrt(1e5 / 100.0) * np.sin(np.array([1, 3]) * np.pi / 18)  # a uniform chain of four
    first, second = 2.0 * np.pi / w
    assert rows["model"].endswith(
        f"compare its first two periods with the building's: tall {first:.3g} and {second:.3g} s"
    )
    assert "model" not in dict(Sweep(Scene([low]), "el_centro", "none").plan().rows())

"""A hand-vectorised C kernel of the paper's row: the bar for the arithmetic of the package's own.

Compiled when asked for, by the system's compiler, into a temporary folder.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record

SOURCE = Path(__file__).with_name("rk4_row.c")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-std=gnu11", "-shared", "-fPIC")
#: Doubles to a vector: which is fastest depends on the processor's registers, so all are tried.
WIDTHS = (4, 8)


def find_compiler() -> str | None:
    """Path of the system's C compiler (``CC``, else cc), or None."""
    return shutil.which(os.environ.get("CC", "cc"))


class _Row(ctypes.Structure):
    _fields_ = (
        ("inverse_mass", ctypes.c_double * 9),
        ("stiffness", ctypes.c_double * 9),
        ("alpha", ctypes.c_double * 3),
        ("beta", ctypes.c_double * 3),
    )


class CKernel:
    """The C kernel, compiled for one vector width."""

    def __init__(self, compiler: str, width: int) -> None:
        self.width = width
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "rk4_row.so"
            command = [compiler, *FLAGS, f"-DWIDTH={width}", str(SOURCE), "-o", str(library)]
            subprocess.run(command, check=True, capture_output=True, text=True)
            self._run = ctypes.CDLL(str(library)).run  # stays loaded when the file is gone
        self._run.restype = None

    def prepare(
        self, scene: Scene, record: Record, *, steps: int, scale: np.ndarray, gaps: np.ndarray, stiffness: np.ndarray
    ) -> Callable[[], dict[str, np.ndarray]]:
        """Return a function that runs whole groups of scenarios and returns their peaks; gaps have shape (n, 2)."""
        if [b.n_storeys for b in scene.buildings] != [3, 3, 3] or len(scene.contacts) != 6:
            raise ValueError("the C kernel is written for three buildings of three storeys that meet at every floor")
        groups, rest = divmod(len(scale), LANES)
        if rest:
            raise ValueError(f"{len(scale)} scenarios are no whole number of groups of {LANES}")
        row = _Row()
        row.inverse_mass[:] = [1.0 / m for b in scene.buildings for m in b.masses]
        row.stiffness[:] = [k for b in scene.buildings for k in b.storey_stiffnesses]
        row.alpha[:] = [b.rayleigh[0] for b in scene.buildings]
        row.beta[:] = [b.rayleigh[1] for b in scene.buildings]
        ground = np.ascontiguousarray(record.acceleration, float)

        def in_lanes(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(np.reshape(values, (groups, LANES, -1)).transpose(0, 2, 1), float)

        given = [in_lanes(scale), in_lanes(gaps), in_lanes(stiffness)]
        sizes = {"highest": 9, "lowest": 9, "force": 6, "onsets": 6}
        found = {name: np.empty((groups, size, LANES)) for name, size in sizes.items()}
        arguments = [
            ctypes.byref(row),
            *(ground.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(len(ground)), ctypes.c_double(record.dt)),
            *(ctypes.c_long(steps), ctypes.c_long(groups)),
            *(array.ctypes.data_as(ctypes.c_void_p) for array in (*given, *found.values())),
        ]

        def run() -> dict[str, np.ndarray]:
            assert given  # the kernel reads these arrays: they live as long as this function
            self._run(*arguments)
            return {name: array.transpose(0, 2, 1).reshape(len(scale), -1) for name, array in found.items()}

        return run

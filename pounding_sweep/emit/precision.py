"""Kernels in single precision: the text of the double-precision kernel with every number narrowed.

A literal such as ``0.5`` is a double, and would widen all it meets. Each one
becomes a named constant of the kernel's own type; the state, the scene's
constants and the ground are of that type already (``REAL``).
"""

from __future__ import annotations

import ast
import math
from typing import Any

#: Constants of the kernels that depend on how finely numbers are resolved.
TOLERANCES: dict[str, dict[str, float]] = {
    "float64": {
        "EXACT": 1e-15,  # relative width of a bracket, and distance (m), below which nothing is gained
        "SWEPT": 1e-13,  # relative change of contact forces at which sweeps over the contacts end
        "UNSWEPT": 1e-9,  # and above which they have failed
        "SAME_TIME": 1e-12,  # events this close (in steps) are simultaneous
        "AT_RELEASE": 1e-9,  # and this close to a release, part of it
        "AT_PEAK": 1e-7,  # as near to a peak (in steps) as its size asks for
        "DONE": 1e-13,  # remainder of a step (in steps) that is none
        "FAR": 1e300,
        "TINY": 1e-300,
        "SHORT": 1e-4,  # sub-steps below this (in steps) are too short for rates from differences
    },
    "float32": {
        "EXACT": 1e-7,
        "SWEPT": 1e-6,
        "UNSWEPT": 1e-3,
        "SAME_TIME": 1e-6,
        "AT_RELEASE": 1e-5,
        "AT_PEAK": 1e-3,
        "DONE": 1e-6,
        "FAR": 1e38,
        "TINY": 1e-37,
        "SHORT": 3e-2,
    },
}

_LARGEST, _SMALLEST = 1e38, 1e-37


class _Narrow(ast.NodeTransformer):
    def __init__(self) -> None:
        self.names: dict[float, str] = {}

    def visit_Constant(self, node: ast.Constant) -> Any:
        if type(node.value) is not float:
            return node
        value = node.value
        if value != 0.0 and math.isfinite(value):
            value = math.copysign(min(max(abs(value), _SMALLEST), _LARGEST), value)
        name = self.names.setdefault(value, f"N{len(self.names)}")
        return ast.copy_location(ast.Name(name, ast.Load()), node)


def narrow(text: str) -> str:
    """Return the text of a kernel module with every floating-point literal as a ``np.float32`` constant."""
    tree = ast.parse(text)
    transformer = _Narrow()
    tree = ast.fix_missing_locations(transformer.visit(tree))
    imports = [i for i, node in enumerate(tree.body) if isinstance(node, ast.Import | ast.ImportFrom)]
    constants = "\n".join(f"{name} = np.float32({value!r})" for value, name in transformer.names.items())
    tree.body[imports[-1] + 1 : imports[-1] + 1] = ast.parse(constants).body
    return ast.unparse(tree) + "\n"

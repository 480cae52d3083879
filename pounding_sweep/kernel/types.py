"""What signatures of kernels take and return: a kernel is traced, or runs on NumPy arrays."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

#: Numbers, or truths, one in each lane or one for all.
Lanes: TypeAlias = Any
Truths: TypeAlias = Any
#: A whole number that counts or tells a place: known as code is written, or at run time.
Index: TypeAlias = Any
#: Displacements, velocities or accelerations of all floors: the name of their rows, or values, or a function of floors.
ByFloor: TypeAlias = Any
#: An end of an element: a degree of freedom, or its place among some, whether the stretch grows (1) or falls (-1) with
#: it, and its share (None: all).
End: TypeAlias = tuple[Index, int, Lanes]
#: Forces on a degree of freedom, each after its sign: 1 to the right, -1 to the left.
Forces: TypeAlias = Sequence[tuple[int, Lanes]]
#: Acceleration of the ground (m/s2) at an instant, by the number of the building that stands on it.
Instant: TypeAlias = Callable[[Index], Lanes]
#: Keeps a row of a history, after so many steps; None: none is asked for.
Note: TypeAlias = Callable[[Index], None] | None

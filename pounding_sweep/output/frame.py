"""A labelled dataset as plain arrays: all that a cube takes to be written, xarray not loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr


@dataclass
class Array:
    """Values with names for their dimensions, attributes, and how they are stored in a file."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: dict[str, Any]
    encoding: dict[str, Any] = field(default_factory=dict)

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return self.values.dtype


@dataclass
class Frame:
    """Variables and coordinates by name, and global attributes; named as in an ``xarray.Dataset``."""

    data_vars: dict[str, Array]
    coords: dict[str, Array]
    attrs: dict[str, Any]

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Frame:
        """Return what a dataset holds."""

        def arrays(names: Mapping[Any, Any]) -> dict[str, Array]:
            found = {name: dataset.variables[name] for name in names}
            return {
                str(name): Array(tuple(map(str, v.dims)), v.values, dict(v.attrs), dict(v.encoding))
                for name, v in found.items()
            }

        return cls(arrays(dataset.data_vars), arrays(dataset.coords), dict(dataset.attrs))

    def to_dataset(self) -> xr.Dataset:
        """Return the dataset."""
        import xarray as xr

        data, coords = (
            {name: (each.dims, each.values, each.attrs) for name, each in part.items()}
            for part in (self.data_vars, self.coords)
        )
        dataset = xr.Dataset(data, coords=coords, attrs=self.attrs)
        for name, each in (self.data_vars | self.coords).items():
            dataset.variables[name].encoding = each.encoding
        return dataset

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each dimension."""
        return {
            dim: size
            for each in (*self.coords.values(), *self.data_vars.values())
            for dim, size in zip(each.dims, each.values.shape, strict=True)
        }

    def __contains__(self, name: str) -> bool:
        return name in self.data_vars or name in self.coords

    def __getitem__(self, name: str) -> Array:
        return self.data_vars[name] if name in self.data_vars else self.coords[name]

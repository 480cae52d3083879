"""How values are stored in an HDF5 file: blocks that the library would crash at, or take for those of another array."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from pounding_sweep.output.netcdf import wrongly_stored

WRONG = "blocks of the values of {!r} are missing, or without checksums"


@pytest.mark.parametrize(("size", "says"), [(1, WRONG), (4, WRONG), (5, None), (36, None)])
def test_a_block_has_room_for_its_checksum(tmp_path, size, says):
    """Four bytes behind the values: the library subtracts them from the size of the block, and reads so many bytes."""
    path = tmp_path / "block.nc"
    with h5py.File(path, "w") as file:
        values = file.create_dataset("force", (4,), "f8", chunks=(4,), fletcher32=True)
        values.id.write_direct_chunk((0,), bytes(size), filter_mask=0)
        assert values.id.get_chunk_info(0).size == size
    assert wrongly_stored(path) == (says and says.format("force"))


def test_two_arrays_do_not_share_a_block(tmp_path):
    """The block of one is found at the place of the other's, with the right checksum: its values would be those."""
    path = tmp_path / "shared.nc"
    given = {"force": np.arange(4.0), "speed": np.arange(4.0) + 10.0}
    with h5py.File(path, "w") as file:
        for name, values in given.items():
            file.create_dataset(name, data=values, chunks=(4,), fletcher32=True)
        places = {name: file[name].id.get_chunk_info(0).byte_offset.to_bytes(8, "little") for name in given}
    assert wrongly_stored(path) is None
    data = path.read_bytes()
    assert data.count(places["speed"]) == 1  # in the tree by which the block is found
    path.write_bytes(data.replace(places["speed"], places["force"]))
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["speed"][...], given["force"])
    assert wrongly_stored(path) == WRONG.format("speed")

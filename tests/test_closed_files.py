# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers close their files, also damaged ones, without waiting for a garbage collection."""

import gc

import numpy as np
import pytest

import warpvis as wv
from warpvis.sensors import RedwoodNoise, lidars

from support.recorded_warnings import recorded_warnings

READERS = {
    "points.npy": wv.io.read_points,
    "poses.npy": wv.io.read_poses,
    "poses.npz": wv.io.read_poses,
    "map.npz": wv.OccupancyMap.load,
    "avia.npy": lambda path: lidars.livox("avia", path),
    "distortion.npy": lambda path: RedwoodNoise(distortion=path),
}
CONTENTS = {
    "damaged archive": b"PK\x03\x04 no zip",
    "damaged array": b"\x93NUMPY\x01\x00",
    "text": b"no NumPy file",
    "archive": None,
}


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("name", READERS)
def test_files_of_numpy_are_closed(name, content, tmp_path):
    path = tmp_path / name
    if CONTENTS[content] is None:
        with path.open("wb") as file:
            np.savez(file, other=np.ones((3, 7)))
    else:
        path.write_bytes(CONTENTS[content])
    gc.collect()  # of other tests
    with recorded_warnings(category=ResourceWarning) as caught:
        with pytest.raises(wv.errors.FileFormatError, match=str(path)):
            READERS[name](path)
        gc.collect()
    assert not [str(item.message) for item in caught]

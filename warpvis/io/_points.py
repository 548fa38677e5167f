# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of points, and writers of lidar clouds.

Points are text, NumPy ``.npy`` or ``.ply``; clouds are KITTI's ``.bin``, ``.pcd``, ``.ply``, ``.las`` or
``.npy``.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, as_path, check_choice, check_text, check_whole, describe_exception, truncate
from warpvis.core.file_content import reading, require_content, require_package, writing
from warpvis.core.numpy_files import read_array
from warpvis.errors import ArrayError, FileFormatError
from warpvis.io._cloud_messages import check_cloud
from warpvis.io._files import read_rows
from warpvis.io._ply import straighten_ply

_LINE = "x y z"

# TYPE of a PCD field by the kind of a NumPy dtype.
_PCD_KINDS = {"f": "F", "i": "I", "u": "U"}

# Type of a PLY property by a NumPy dtype. Open3D reads uint16, but skips its synonym ushort.
_PLY_TYPES = {
    "i1": "char", "u1": "uchar", "i2": "short", "u2": "uint16",
    "i4": "int", "u4": "uint", "f4": "float", "f8": "double",
}  # fmt: skip

# Resolution of LAS coordinates.
_LAS_SCALE = 0.0001  # m


def read_points(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read points in the world's frame.

    A ``.npy`` file contains an array of shape ``(N, 3)``, a ``.ply`` file a point cloud or the vertices of a mesh.
    All other files are text with lines ``x y z``, separated by spaces or commas; empty lines, lines that begin with
    ``#``, and a header line ``x y z`` are skipped.

    Returns:
        Points in the file's order, shape ``(N, 3)``.

    Raises:
        FileFormatError: If the file is missing or contains no points, or a line or a row is malformed; the message
            names it.
    """
    path = as_path(path)
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    require_content(path, "a file of points", images=False)
    readers = {".npy": _read_npy, ".ply": _read_ply}
    points = readers.get(path.suffix.lower(), _read_text)(path)
    if not len(points):
        raise FileFormatError(f"{path}: holds no points")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise FileFormatError(f"{path}: points must be finite, and {len(bad)} are not, the first at index {bad[0]}")
    return points


def _read_text(path: Path) -> NDArray[np.float64]:
    rows: list[list[float]] = []
    for place, line in read_rows(path, _LINE):
        words = line.replace(",", " ").split()
        if words and (rows or [word.lower() for word in words] != ["x", "y", "z"]):
            rows.append(_parse_words(words, place))
    return np.array(rows).reshape(-1, 3)


def _parse_words(words: list[str], place: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise FileFormatError(f"{place}: expected three finite numbers '{_LINE}', got {truncate(' '.join(words))!r}")
    return values


def _read_npy(path: Path) -> NDArray[np.float64]:
    array = read_array(path)
    if array.dtype.kind not in "fiu" or array.ndim != 2 or array.shape[1] != 3:
        raise FileFormatError(
            f"{path}: expected an array of numbers of shape (N, 3), got {array.dtype} of shape {array.shape}"
        )
    return array.astype(np.float64)


def _read_ply(path: Path) -> NDArray[np.float64]:
    import trimesh

    with reading(path, "PLY"):
        loaded = trimesh.load(io.BytesIO(straighten_ply(path.read_bytes())), file_type="ply", process=False)
        return np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)


def save_cloud(path: str | os.PathLike[str], cloud: NDArray[np.void]) -> None:
    """Write a point cloud, in the format given by the file name's suffix.

    Args:
        path: ``.bin``, KITTI's: x, y, z and intensity, float32; ``.pcd``, the Point Cloud Library's, binary, all
            fields; ``.ply``, binary, all fields as properties; ``.las``, with `laspy` (``pip install
            'warpvis[lidar]'``): coordinates of 0.1 mm, intensity from 0 to 1 as 0 to 65535, time as ``gps_time``, and
            other fields as extra dimensions; ``.npy``, NumPy's, all fields.
        cloud: Points with named fields, as returned by `warpvis.sensors.point_clouds`. Points that are NaN are left out
            of all formats except ``.pcd`` and ``.npy``, which keep rows and columns.

    Raises:
        FileFormatError: If the format is unknown, or the file cannot be written.
    """
    path = as_path(path)
    write = _writer(path.suffix.lower(), "path")
    cloud = check_cloud(cloud)
    with writing(path):
        write(path, cloud)


def save_clouds(
    folder: str | os.PathLike[str], clouds: Iterable[NDArray[np.void]], suffix: str = ".bin", *, first: int = 0
) -> list[Path]:
    """Write point clouds as numbered files, ``000000.bin``, ``000001.bin`` and so on, as in KITTI.

    Args:
        folder: Output folder, which is created if it does not exist.
        clouds: Point clouds, as for `save_cloud`.
        suffix: The format, ``".bin"``, ``".pcd"``, ``".ply"``, ``".las"`` or ``".npy"``.
        first: Number of the first file.

    Returns:
        Paths of the files.

    Raises:
        FileFormatError: If the format is unknown, or a file cannot be written.
    """
    folder = as_path(folder, "folder")
    _writer(check_text(suffix, "suffix", FileFormatError), "suffix")
    number = check_whole(first, "first", minimum=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{folder}: cannot be created: {error.strerror}") from None
    written: list[Path] = []
    for cloud in clouds if isinstance(clouds, Iterator) else as_items(clouds, "clouds"):
        written.append(folder / f"{number + len(written):06d}{suffix}")
        save_cloud(written[-1], cloud)
    return written


def _writer(suffix: str, name: str) -> Callable[[Path, NDArray[np.void]], None]:
    writers = {
        ".bin": _write_kitti, ".pcd": _write_pcd, ".ply": _write_ply, ".las": _write_las, ".npy": _write_npy,
    }  # fmt: skip
    return writers[check_choice(suffix, f"the ending of {name}" if name == "path" else name, writers, FileFormatError)]


def _finite(cloud: NDArray[np.void]) -> NDArray[np.void]:
    flat = cloud.reshape(-1)
    return flat[np.isfinite(flat["x"])]


def _pack(cloud: NDArray[np.void]) -> NDArray[np.void]:
    """Return a cloud with little-endian fields and without padding."""
    packed = np.empty(
        cloud.shape, dtype=[(name, cloud.dtype[name].newbyteorder("<")) for name in cloud.dtype.names or ()]
    )
    for name in cloud.dtype.names or ():
        packed[name] = cloud[name]
    return packed


def _write_kitti(path: Path, cloud: NDArray[np.void]) -> None:
    points = _finite(cloud)
    columns = [points[name] for name in "xyz"]
    columns.append(points["intensity"] if "intensity" in (cloud.dtype.names or ()) else np.zeros(len(points)))
    path.write_bytes(np.stack(columns, axis=-1).astype("<f4").tobytes())


def _write_npy(path: Path, cloud: NDArray[np.void]) -> None:
    with path.open("wb") as file:
        np.save(file, cloud)


def _write_pcd(path: Path, cloud: NDArray[np.void]) -> None:
    """Write PCD 0.7, binary (pointclouds.org, "The PCD (Point Cloud Data) file format")."""
    packed = _pack(cloud.reshape(-1))
    names = packed.dtype.names or ()
    kinds = [packed.dtype[name] for name in names]
    rows, columns = cloud.shape if cloud.ndim == 2 else (1, cloud.size)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\n"
        "VERSION 0.7\n"
        f"FIELDS {' '.join(names)}\n"
        f"SIZE {' '.join(str(kind.itemsize) for kind in kinds)}\n"
        f"TYPE {' '.join(_PCD_KINDS[kind.kind] for kind in kinds)}\n"
        f"COUNT {' '.join('1' for _ in names)}\n"
        f"WIDTH {columns}\nHEIGHT {rows}\n"
        "VIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {cloud.size}\nDATA binary\n"
    )
    path.write_bytes(header.encode("ascii") + packed.tobytes())


def _write_ply(path: Path, cloud: NDArray[np.void]) -> None:
    """Write PLY 1.0, binary little-endian, with one property per field."""
    packed = _pack(_finite(cloud))
    properties = "".join(
        f"property {_PLY_TYPES[packed.dtype[name].str[1:]]} {name}\n" for name in packed.dtype.names or ()
    )
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(packed)}\n{properties}end_header\n"
    path.write_bytes(header.encode("ascii") + packed.tobytes())


def _write_las(path: Path, cloud: NDArray[np.void]) -> None:
    """Write LAS 1.4, point format 6, with laspy, an optional dependency."""
    laspy = require_package("laspy", f"{path}: LAS is written with laspy", "lidar")
    points = _finite(cloud)
    names = cloud.dtype.names or ()
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, _LAS_SCALE)
    extra = [name for name in names if name not in ("x", "y", "z", "intensity", "time")]
    for name in extra:
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=cloud.dtype[name].newbyteorder("<")))
    las = laspy.LasData(header)
    try:
        las.x, las.y, las.z = (points[name].astype(np.float64) for name in "xyz")
        if "intensity" in names:
            intensity = points["intensity"]
            if intensity.size and not 0.0 <= intensity.min() <= intensity.max() <= 1.0:
                got = f"{intensity.min():g} to {intensity.max():g}"
                raise ArrayError(f"{path}: intensity must be from 0 to 1 for LAS, got {got}")
            las.intensity = np.rint(intensity * np.float32(65535.0)).astype(np.uint16)
        if "time" in names:
            las.gps_time = points["time"].astype(np.float64)
        for name in extra:
            las[name] = points[name]
        las.write(path)
    except ArrayError:
        raise
    except (ValueError, OverflowError) as error:
        raise ArrayError(f"{path}: LAS does not hold this cloud: {describe_exception(error)}") from None

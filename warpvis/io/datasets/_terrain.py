# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rasters of elevations (GeoTIFF) as terrain in meters, read by rasterio."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import reading, require_content, require_package
from warpvis.core.labels import Label
from warpvis.errors import FileFormatError
from warpvis.scene import FileParts, Part
from warpvis.scene.lights import HEADLIGHT

_MAX_PIXELS = 16_000_000
"""Maximum number of elevations: their triangles take about 2 GiB while a scene is built."""
_METERS = {
    **dict.fromkeys(("", "m", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), 0.3048),
    **dict.fromkeys(("us-ft", "us survey foot", "us survey feet", "ussurveyfoot"), 1200 / 3937),
    **dict.fromkeys(("cm", "centimeter"), 0.01),
    **dict.fromkeys(("dm", "decimeter"), 0.1),
    **dict.fromkeys(("km", "kilometer"), 1000.0),
}
_MAX_LATITUDE = 84
"""Maximum latitude of UTM [degrees]."""
_WEB_MERCATOR, _EARTH = 3857, 6378137.0
"""EPSG code of Web Mercator, and its radius of the Earth [m]."""


def read_terrain(path: Path, *, search_path: Sequence[Path] = (), strict: bool = False) -> FileParts:
    """Read the elevations of a GeoTIFF as one mesh: x to the east, y to the north, z up, in meters.

    The origin is the center of the raster, at elevation 0. The part's metadata has it as ``"origin"``: x, y and z in
    meters of the coordinate system ``"crs"``.

    Args:
        path: The file.
        search_path: Unused.
        strict: Whether a missing coordinate system is an error.
    """
    require_content(path, "a raster of elevations", images=False)
    rasterio = require_package("rasterio", f"{path}: elevations are read by rasterio", "geo")
    with reading(path, "a GeoTIFF"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a raster without a coordinate system
        with rasterio.open(str(path), driver="GTiff") as source:
            _check_raster(path, source)
            factor, notes = _horizontal_unit(path, source, rasterio)
            if strict and notes:
                raise FileFormatError(notes[0])
            elevations = source.read(1, masked=True)
            transform = np.array(source.transform, dtype=np.float64).reshape(3, 3)[:2]
            height = _vertical_unit(path, source)
            scale, offset = source.scales[0], source.offsets[0]
            crs = "" if source.crs is None else str(source.crs)
    valid = ~np.ma.getmaskarray(elevations)
    z = (np.asarray(elevations.data, dtype=np.float64) * scale + offset) * height
    valid &= np.isfinite(z)
    rows, columns = z.shape
    center = factor * (transform @ (columns / 2, rows / 2, 1.0))
    mesh = _grid(z, valid, transform * factor, center)
    extras = {"origin": [*center.tolist(), 0.0], "crs": crs, "resolution": (factor * _spacing(transform)).tolist()}
    parts = []
    if len(mesh[1]):
        parts = [Part("terrain", mesh, Label.GROUND, category="terrain", extras=extras)]
    return FileParts(path, parts, up="z", defines_frame=True, warnings=tuple(notes), lights=(HEADLIGHT,))


def _check_raster(path: Path, source: Any) -> None:
    if source.count != 1:
        raise FileFormatError(f"{path}: must have one band of elevations, got {source.count} bands, as images have")
    if np.dtype(source.dtypes[0]).kind not in "iuf":
        raise FileFormatError(f"{path}: elevations must be real numbers, got {source.dtypes[0]}")
    pixels = source.width * source.height
    if pixels > _MAX_PIXELS:
        percent = max(1, math.floor(100 * math.sqrt(_MAX_PIXELS / pixels)))
        raise FileFormatError(
            f"{path}: must have at most {_MAX_PIXELS} elevations, got {source.width} x {source.height}; reduce it: "
            f"gdal_translate -r average -outsize {percent}% {percent}% {path.name} small.tif"
        )


def _horizontal_unit(path: Path, source: Any, rasterio: Any) -> tuple[float, list[str]]:
    """Return the length of a unit of the coordinate system [m], and warnings."""
    if source.crs is None:
        return 1.0, [f"{path}: has no coordinate system; its coordinates are read as meters"]
    west, south, east, north = source.bounds
    x, y = (west + east) / 2, (south + north) / 2
    if source.crs.is_geographic:
        zone = _utm(x, y)
        raise FileFormatError(
            f"{path}: coordinates must be in meters, got degrees of {source.crs}; reproject it: gdalwarp -t_srs {zone} "
            f"{path.name} meters.tif, or with rasterio: rio warp {path.name} meters.tif --dst-crs {zone}"
        )
    if source.crs.to_epsg() == _WEB_MERCATOR:
        stretch = math.cosh(y / _EARTH)
        return 1.0, [
            f"{path}: lengths in Web Mercator are {stretch:.2f} times too long here; reproject it to UTM for true ones"
        ]
    try:
        return float(source.crs.linear_units_factor[1]), []
    except rasterio.errors.CRSError:
        raise FileFormatError(f"{path}: the unit of its coordinate system {source.crs} is unknown") from None


def _utm(longitude: float, latitude: float) -> str:
    """Return the UTM zone of a place, or the polar stereographic projection beyond."""
    if abs(latitude) > _MAX_LATITUDE:
        return "EPSG:3413" if latitude > 0 else "EPSG:3031"
    zone = int((longitude + 180) // 6) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def _vertical_unit(path: Path, source: Any) -> float:
    """Return the length of a unit of elevations [m]."""
    unit = (source.units[0] or "").strip().lower().replace("metre", "meter")
    if unit not in _METERS:
        raise FileFormatError(f"{path}: the unit of elevations must be meters or feet, got {source.units[0]!r}")
    return _METERS[unit]


def _spacing(transform: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance between neighboring columns, and rows."""
    return np.linalg.norm(transform[:, :2], axis=0)


def _grid(
    z: NDArray[np.float64], valid: NDArray[np.bool_], transform: NDArray[np.float64], center: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return a mesh with a vertex at the center of each pixel, and two triangles between four of them.

    Triangles with an invalid corner are left out.
    """
    rows, columns = z.shape
    numbers = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
    a, b = numbers[:-1, :-1].reshape(-1), numbers[:-1, 1:].reshape(-1)
    c, d = numbers[1:, :-1].reshape(-1), numbers[1:, 1:].reshape(-1)
    # Rows go south in most files, so that columns, rows and z are left-handed.
    order = (0, 1, 2) if np.linalg.det(transform[:, :2]) < 0 else (0, 2, 1)
    pair = np.stack([np.stack([a, c, b], axis=1), np.stack([c, d, b], axis=1)], axis=1)
    faces = pair.reshape(-1, 3)[:, order]
    faces = faces[valid.reshape(-1)[faces].all(axis=1)]
    used, corners = np.unique(faces, return_inverse=True)
    row, column = used // columns, used % columns
    plane = np.stack([column + 0.5, row + 0.5, np.ones(len(used))], axis=1) @ transform.T - center
    return np.column_stack([plane, z.reshape(-1)[used]]), corners.reshape(-1, 3).astype(np.int32)

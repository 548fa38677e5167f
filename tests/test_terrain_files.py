# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain of GeoTIFF files: each row of the table of docs/scene_files/terrain.md, and invalid files."""

import warnings

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine, from_origin, xy

import warpvis as wv
from warpvis import Label, Scene
from warpvis.errors import FileFormatError, SceneError
from warpvis.io import read_parts
from warpvis.io.datasets import _terrain

Z = (300 + 20 * np.sin(np.arange(20)[:, None] / 3) * np.cos(np.arange(30)[None] / 4)).astype(np.float32)
UTM = {"crs": "EPSG:32633", "transform": from_origin(500000, 5400000, 10, 5)}


def write(path, z=Z, *, units=None, scale=None, bands=1, **options):
    """Write elevations by rasterio."""
    options = {**UTM, **options}
    profile = {
        "driver": "GTiff",
        "width": z.shape[1],
        "height": z.shape[0],
        "count": bands,
        "dtype": z.dtype,
        **options,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(path, "w", **profile) as file:
            for band in range(bands):
                file.write(z, band + 1)
            if units is not None:
                file.units = [units]
            if scale is not None:
                file.scales, file.offsets = [scale[0]], [scale[1]]
    return path


def expected(path, factor=1.0, height=1.0):
    """Return the places of pixels as rasterio defines them, relative to its center, shape (rows, columns, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(path) as file:
            rows, columns = np.indices(file.shape)
            x, y = (np.asarray(values) for values in xy(file.transform, rows.ravel(), columns.ravel()))
            center = file.transform @ (file.width / 2, file.height / 2)
            z = file.read(1) * height
    return np.column_stack([(x - center[0]) * factor, (y - center[1]) * factor, z.ravel()]).reshape(*z.shape, 3)


def only(scene):
    assert len(scene) == 1
    return scene["terrain"]


def test_elevations_in_meters(tmp_path):
    path = write(tmp_path / "dem.tif")
    scene = Scene.load(path)
    item = only(scene)
    assert (item.label, item.category, scene.up) == (Label.GROUND, "terrain", "z")
    points = expected(path)
    np.testing.assert_allclose(item.vertices.reshape(points.shape), points, atol=2e-5)  # float32 at 300 m
    assert len(item.faces) == 2 * 19 * 29
    a, b, c = np.moveaxis(item.vertices[item.faces], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    down = wv.look_at((0, 0, 500), (0, 0, 0), up=(0, 1, 0))
    depth = wv.render(scene, wv.Camera.from_fov(3, 3, hfov=0.1), down, outputs="depth").depth.numpy()[0, 1, 1]
    assert depth == pytest.approx(500 - Z[9:11, 14:16].mean(), abs=5)


def test_origin_in_the_metadata(tmp_path):
    extras = read_parts(write(tmp_path / "dem.tif")).parts[0].extras
    assert extras == {"origin": [500150.0, 5399950.0, 0.0], "crs": "EPSG:32633", "resolution": [10.0, 5.0]}


@pytest.mark.parametrize("value", [-9999.0, np.nan])
def test_cells_without_data_are_left_out(tmp_path, value):
    z = Z.copy()
    z[5:7, 10:12] = value
    z[0, 0] = value
    item = only(Scene.load(write(tmp_path / "dem.tif", z, nodata=None if np.isnan(value) else value)))
    assert len(item.vertices) == z.size - 5 and len(item.faces) == 2 * 19 * 29 - 16 - 1
    assert item.vertices[:, 2].min() > 200


@pytest.mark.parametrize("kind", ["mask", "nodata and mask"])
def test_masked_cells_are_left_out(tmp_path, kind):
    path = write(tmp_path / "dem.tif", nodata=None if kind == "mask" else -1.0)
    valid = np.full(Z.shape, 255, np.uint8)
    valid[5:7, 10:12] = 0
    with rasterio.open(path, "r+") as file:
        file.write_mask(valid)
    assert len(only(Scene.load(path)).faces) == 2 * 19 * 29 - 16


def test_other_metadata_is_ignored(tmp_path):
    """A vertical datum, a time, a color table and overviews change no vertex."""
    z = np.arange(30, dtype=np.uint8).reshape(5, 6)
    plain = only(Scene.load(write(tmp_path / "plain.tif", z)))
    path = write(tmp_path / "dem.tif", z, crs="EPSG:32633+5773")
    with rasterio.open(path, "r+") as file:
        file.update_tags(TIFFTAG_DATETIME="2024:01:02 03:04:05")
        file.write_colormap(1, {value: (value, 0, 0, 255) for value in range(256)})
        file.build_overviews([2], rasterio.enums.Resampling.average)
    item = only(Scene.load(path))
    np.testing.assert_array_equal(item.vertices, plain.vertices)
    np.testing.assert_array_equal(item.faces, plain.faces)
    assert item.appearance is None


@pytest.mark.parametrize(
    ("unit", "meters"),
    [("m", 1), ("metre", 1), ("ft", 0.3048), ("US survey foot", 1200 / 3937), ("cm", 0.01), ("dm", 0.1), ("km", 1000)],
)
def test_unit_of_elevations(tmp_path, unit, meters):
    path = write(tmp_path / "dem.tif", units=unit)
    item = only(Scene.load(path))
    np.testing.assert_allclose(item.vertices[:, 2], Z.reshape(-1) * meters, rtol=1e-6)
    np.testing.assert_allclose(item.vertices[:, :2], expected(path)[..., :2].reshape(-1, 2), atol=1e-5)


def test_scale_and_offset_of_the_band(tmp_path):
    z = np.arange(12, dtype=np.int16).reshape(3, 4)
    item = only(Scene.load(write(tmp_path / "dem.tif", z, scale=(0.5, 100.0))))
    np.testing.assert_allclose(item.vertices[:, 2], 100 + 0.5 * z.reshape(-1), atol=1e-5)


def test_coordinates_in_feet(tmp_path):
    path = write(tmp_path / "dem.tif", crs="EPSG:2263")  # New York Long Island (ftUS)
    item = only(Scene.load(path))
    points = expected(path, factor=1200 / 3937).reshape(-1, 3)
    np.testing.assert_allclose(item.vertices, points, atol=2e-5)


@pytest.mark.parametrize(
    "transform",
    [Affine.translation(5e5, 5e6) @ Affine.rotation(30) @ Affine.scale(2, -3), Affine(2, 0, 5e5, 0, 3, 5e6)],
)
def test_rotated_rasters_and_rows_to_the_north(tmp_path, transform):
    path = write(tmp_path / "dem.tiff", transform=transform)
    item = only(Scene.load(path))
    np.testing.assert_allclose(item.vertices, expected(path).reshape(-1, 3), atol=2e-5)
    a, b, c = np.moveaxis(item.vertices[item.faces], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_rasters_without_a_coordinate_system(tmp_path):
    path = write(tmp_path / "dem.tif", crs=None, transform=Affine(1, 0, 0, 0, -1, 0))
    with pytest.warns(UserWarning, match="has no coordinate system; its coordinates are read as meters"):
        item = only(Scene.load(path))
    np.testing.assert_allclose(item.vertices, expected(path).reshape(-1, 3), atol=2e-5)
    with pytest.raises(FileFormatError, match="has no coordinate system"):
        Scene.load(path, strict=True)


def test_web_mercator(tmp_path):
    path = write(tmp_path / "dem.tif", crs="EPSG:3857", transform=from_origin(1e6, 8399737.89, 10, 10))
    with pytest.warns(UserWarning, match=r"lengths in Web Mercator are 2.00 times too long here; reproject it to UTM"):
        only(Scene.load(path))


def test_reprojected_rasters(tmp_path):
    """The command of the message makes a file that can be read."""
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    degrees = from_origin(14.9, 48.75, 1e-4, 1e-4)
    path = write(tmp_path / "dem.tif", crs="EPSG:4326", transform=degrees)
    with pytest.raises(FileFormatError, match=r"gdalwarp -t_srs EPSG:32633 dem.tif meters.tif"):
        Scene.load(path)
    with rasterio.open(path) as source:
        transform, width, height = calculate_default_transform(source.crs, "EPSG:32633", 30, 20, *source.bounds)
        z = np.full((height, width), np.nan, np.float32)
        reproject(
            source.read(1),
            z,
            src_transform=degrees,
            src_crs=source.crs,
            dst_transform=transform,
            dst_crs="EPSG:32633",
            dst_nodata=np.nan,
            resampling=Resampling.bilinear,
        )
    item = only(Scene.load(write(tmp_path / "meters.tif", z, transform=transform, nodata=np.nan)))
    size = np.ptp(item.vertices, axis=0)
    np.testing.assert_allclose(size[:2], (220, 222), atol=15)


@pytest.mark.parametrize(
    ("longitude", "latitude", "code"),
    [(15, 48, 32633), (-179.9, 1, 32601), (179.9, -1, 32760), (0, 89, 3413), (0, -89, 3031)],
)
def test_zone_of_the_message(longitude, latitude, code):
    assert _terrain._utm(longitude, latitude) == f"EPSG:{code}"


INVALID = {
    "image": ({"bands": 3}, r"must have one band of elevations, got 3 bands, as images have"),
    "complex": ({"z": Z.astype(np.complex64)}, r"elevations must be real numbers, got complex64"),
    "degrees": (
        {"crs": "EPSG:4326", "transform": from_origin(15, 48, 0.001, 0.001)},
        r"coordinates must be in meters, got degrees of EPSG:4326; reproject it: gdalwarp -t_srs EPSG:32633 dem.tif",
    ),
    "unit": ({"units": "hPa"}, r"the unit of elevations must be meters or feet, got 'hPa'"),
    "empty": ({"z": np.full((3, 4), -1.0), "nodata": -1.0}, r"dem.tif: holds no triangles"),
    "narrow": ({"z": Z[:1]}, r"dem.tif: holds no triangles"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_rasters(tmp_path, case):
    options, message = INVALID[case]
    with pytest.raises((FileFormatError, SceneError), match=message):
        Scene.load(write(tmp_path / "dem.tif", **options))


@pytest.mark.parametrize("content", [b"", b"hello", b"II*\x00\x08\x00\x00\x00", b"<!doctype html><html></html>"])
def test_other_files(tmp_path, content):
    path = tmp_path / "dem.tif"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"dem.tif: (cannot be read|is an HTML page, not a raster)") as caught:
        Scene.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", ["asc", "hgt", "nc"])
def test_other_rasters_are_not_read(tmp_path, suffix):
    (tmp_path / f"dem.{suffix}").write_text("ncols 2")
    with pytest.raises(FileFormatError, match=rf"dem.{suffix}: '.{suffix}' is not a scene format"):
        Scene.load(tmp_path / f"dem.{suffix}")


def test_large_rasters(tmp_path, monkeypatch):
    monkeypatch.setattr(_terrain, "_MAX_PIXELS", 100)
    with pytest.raises(
        FileFormatError, match=r"at most 100 elevations, got 30 x 20; .* -outsize 40% 40% dem.tif small.tif"
    ):
        Scene.load(write(tmp_path / "dem.tif"))


def test_units_and_axes_are_fixed(tmp_path):
    path = write(tmp_path / "dem.tif")
    with pytest.raises(SceneError, match=r"the format defines the unit \(m\) and the vertical axis; leave out scale"):
        Scene.load(path, scale=2.0)
    assert np.ptp(Scene.load(path, up="y")["terrain"].vertices[:, 1]) == pytest.approx(np.ptp(Z), abs=1e-3)


def test_rasterio_is_optional(tmp_path, monkeypatch):
    path = write(tmp_path / "dem.tif")
    monkeypatch.setitem(__import__("sys").modules, "rasterio", None)
    with pytest.raises(
        FileFormatError, match=r"elevations are read by rasterio, which is missing: pip install 'warpvis\[geo\]'"
    ):
        Scene.load(path)

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray patterns of lidars, compared with manufacturers' formulas, tables and libraries."""

import json
import math

import numpy as np
import pytest

import warpvis as wv
from warpvis.sensors import lidars

from support.lidars import old_ouster_metadata, ouster_metadata

SPINNING = {
    "vlp16": lidars.vlp16,
    "vlp32c": lidars.vlp32c,
    "hdl32e": lidars.hdl32e,
    "hdl64e": lidars.hdl64e,
    "vls128": lidars.vls128,
    "pandar64": lidars.pandar64,
    "xt32": lidars.xt32,
    "qt128": lidars.qt128,
    "ouster": lambda rate: lidars.ouster("OS1-128", f"512x{rate}"),
    "even": lambda rate: lidars.even(4, rate=rate),
    "bpearl": lambda rate: lidars.bpearl(0.01, rate=rate),
}

# Directions and offsets of ouster-sdk 1.0.1's `XYZLut` for `SensorInfo.from_default(LidarMode._1024x10)`.
OS1_64 = {
    (0, 0): (
        [-0.9568069643596201, 0.05289077661276211, 0.28587234686521795],
        [-0.0006827091213318451, -0.0008359916151413141, 0.031661501685448366],
    ),
    (1, 255): (
        [0.011796428297887674, 0.960784142498171, 0.27704634233908787],
        [-0.00028343813844094144, 0.0006195483001907025, 0.031801005512988374],
    ),
    (31, 512): (
        [0.9984650416738222, 0.055193569279846165, 0.004607652921339913],
        [2.426155130356733e-05, -0.0008723895560372502, 0.0361071714379253],
    ),
    (63, 1023): (
        [-0.9564644210346107, -0.058760638123657255, -0.28587234686521795],
        [-0.000687825817643736, 0.0008317868534179946, 0.040698498314551634],
    ),
}


def angles(rays):
    """Return azimuths, counterclockwise, and elevations [deg]."""
    x, y, z = np.moveaxis(np.asarray(rays.directions), -1, 0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z))


@pytest.mark.parametrize("rate", [10, 20])
@pytest.mark.parametrize("name", SPINNING)
def test_times_increase_within_one_revolution(name, rate):
    rays = SPINNING[name](rate)
    times = np.asarray(rays.times)
    assert times.min() == 0 and times.max() < 1 / rate
    assert (np.diff(times, axis=1) > 0).all()
    assert times.max() > 0.99 / rate
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=-1), 1, atol=1e-14)


@pytest.mark.parametrize("name", ["vlp16", "vlp32c", "hdl32e", "hdl64e", "vls128"])
def test_velodyne_rotates_clockwise_at_its_rate(name):
    rays = SPINNING[name](10)
    azimuth, elevation = angles(rays)
    turned = np.unwrap(np.radians(azimuth), axis=1)
    slope = np.diff(turned, axis=1) / np.diff(rays.times, axis=1)
    np.testing.assert_allclose(slope, -2 * math.pi * 10, rtol=1e-6)
    assert (np.diff(elevation[:, 0]) <= 0).all()
    assert (np.asarray(rays.rings)[:, 0] == np.arange(len(elevation))[::-1]).all()


def test_vlp16_firing_order_matches_manual():
    rays = lidars.vlp16()
    azimuth, elevation = angles(rays)
    order = np.argsort(rays.times[:, 0])
    fired = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
    np.testing.assert_allclose(elevation[order, 0], fired, atol=1e-12)
    np.testing.assert_allclose(rays.times[order, 0], np.arange(16) * 2.304e-6, atol=1e-15)
    np.testing.assert_allclose(np.diff(rays.times, axis=1), 55.296e-6, atol=1e-12)
    assert rays.directions.shape == (16, 1808, 3)
    assert azimuth[15, 0] == 0 and azimuth[15, 1] == pytest.approx(-0.1990656, abs=1e-9)
    # The sensor's drawing gives 11.2 mm for the outermost lasers; beams intersect 41.91 mm ahead.
    heights = np.asarray(rays.origins)[:, 0, 2]
    assert heights[0] == pytest.approx(-0.0112, abs=5e-5) and heights[-1] == pytest.approx(0.0112, abs=5e-5)
    at = rays.origins[:, 0] + rays.directions[:, 0] * (0.04191 / np.cos(np.radians(elevation[:, 0])))[:, None]
    np.testing.assert_allclose(at[:, 2], 0, atol=1e-15)


def test_vlp32c_firing_pairs_and_azimuth_offsets():
    rays = lidars.vlp32c()
    times, counts = np.unique(np.round(rays.times[:, 0], 9), return_counts=True)
    assert (counts == 2).all() and len(times) == 16
    azimuth, elevation = angles(rays)
    left = azimuth[:, 0] + 3600 * rays.times[:, 0]
    assert set(np.round(left, 9)) == {-4.2, -1.4, 1.4, 4.2}
    assert elevation[0, 0] == pytest.approx(15) and elevation[-1, 0] == pytest.approx(-25)
    assert left[0] == pytest.approx(1.4) and left[-1] == pytest.approx(-1.4)


def test_hdl32e_firing_order_matches_manual():
    """Lasers of the lower and the upper half take turns, from the lowest of each."""
    rays = lidars.hdl32e()
    _, elevation = angles(rays)
    order = np.argsort(rays.times[:, 0])
    fired = elevation[order, 0]
    assert (np.diff(fired[::2]) > 0).all() and (np.diff(fired[1::2]) > 0).all()
    assert fired[:2] == pytest.approx([-30.67, -9.33]) and fired[-2:] == pytest.approx([-10.67, 10.67])
    np.testing.assert_allclose(np.diff(elevation[:, 0]), -4 / 3, atol=0.01)
    np.testing.assert_allclose(rays.times[order, 0], np.arange(32) * 1.152e-6, atol=1e-15)
    np.testing.assert_allclose(np.diff(rays.times, axis=1), 46.08e-6, atol=1e-12)
    assert 32 * rays.directions.shape[1] * 10 == pytest.approx(695e3, rel=0.01)  # points a second, by its data sheet
    assert not np.asarray(rays.origins).any()


def test_vls128_firing_groups_match_manual():
    """Pages 49 and 61: eight lasers in 2.665 us, a pause after the eighth group, 2,401,497.6 measurements a second."""
    rays = lidars.vls128()
    azimuth, elevation = angles(rays)
    times, counts = np.unique(np.round(rays.times[:, 0], 9), return_counts=True)
    assert (counts == 8).all()
    np.testing.assert_allclose(times, 2.665e-6 * np.delete(np.arange(17), 8), atol=1e-9)
    np.testing.assert_allclose(np.diff(rays.times, axis=1), 53.3e-6, atol=1e-12)
    assert 128 * rays.directions.shape[1] * 10 == pytest.approx(2_401_497.6, rel=1e-3)
    assert elevation[0, 0] == pytest.approx(15) and elevation[-1, 0] == pytest.approx(-25)
    assert np.diff(elevation[:, 0]).max() < -0.109  # at least 0.11 degrees apart
    left = (azimuth[:, 0] + 3600 * rays.times[:, 0]).reshape(-1)
    for time in times:
        group = np.abs(rays.times[:, 0] - time) < 1e-9
        np.testing.assert_allclose(
            np.sort(left[group]), [-6.354, -4.548, -2.732, -0.911, 0.911, 2.732, 4.548, 6.354], atol=1e-9
        )
    # Laser 36 of VLS128.yaml fires in the fifth group, the lowest one; laser 59 in the eighth.
    assert rays.times[-1, 0] == pytest.approx(4 * 2.665e-6) and rays.times[0, 0] == pytest.approx(7 * 2.665e-6)


def test_hdl64e_blocks_fire_simultaneously():
    rays = lidars.hdl64e()
    times, counts = np.unique(np.round(rays.times[:, 0], 9), return_counts=True)
    assert (counts == 2).all() and times[-1] == pytest.approx(7 * 7.2e-6 + 3.7e-6)
    assert 64 * rays.directions.shape[1] * 10 == pytest.approx(1.11e6, rel=0.01)  # points a second, by its data sheet
    # Every ray passes the axis at a distance of 26 mm.
    across = np.abs(rays.origins[..., 0] * rays.directions[..., 1] - rays.origins[..., 1] * rays.directions[..., 0])
    np.testing.assert_allclose(across / np.hypot(rays.directions[..., 0], rays.directions[..., 1]), 0.026, atol=1e-12)


def velodyne_file(path, count=16, **changes):
    lasers = [
        {"laser_id": n, "vert_correction": 0.01 * n, "rot_correction": 0.1, "vert_offset_correction": 0.2, **changes}
        for n in range(count)
    ]
    path.write_text(json.dumps({"lasers": lasers, "num_lasers": count}))  # JSON is YAML
    return path


def test_velodyne_calibration_is_read(tmp_path):
    rays = lidars.vlp16(calibration=velodyne_file(tmp_path / "a.yaml"))
    assert rays.directions[0, 0, 2] == pytest.approx(math.sin(0.15))
    heading = 0.1 - 2 * math.pi * 10 * rays.times[0, 0]
    assert math.atan2(*rays.directions[0, 0, 1::-1]) == pytest.approx(heading)
    ahead = -0.2 * math.sin(0.15)  # perpendicular to the beam
    expected = [ahead * math.cos(heading), ahead * math.sin(heading), 0.2 * math.cos(0.15)]
    np.testing.assert_allclose(rays.origins[0, 0], expected, atol=1e-15)


def velodyne_points(row, distance, azimuth):
    """Return the point that velodyne_pointcloud's ``RawData::unpack`` computes without distance corrections, in ROS
    axes.
    ros-drivers/velodyne, velodyne_pointcloud/src/lib/rawdata.cpp; `azimuth` is clockwise.
    """
    turned = azimuth - row["rot_correction"]
    cos_vert, sin_vert = math.cos(row["vert_correction"]), math.sin(row["vert_correction"])
    vert_offset, horiz_offset = row.get("vert_offset_correction", 0.0), row.get("horiz_offset_correction", 0.0)
    xy_distance = distance * cos_vert - vert_offset * sin_vert
    x = xy_distance * math.sin(turned) - horiz_offset * math.cos(turned)
    y = xy_distance * math.cos(turned) + horiz_offset * math.sin(turned)
    return y, -x, distance * sin_vert + vert_offset * cos_vert


def corrections(count, seed=3):
    """Return random lasers in the form of an HDL-64E calibration."""
    rng = np.random.default_rng(seed)
    elevation = np.sort(rng.uniform(-0.42, 0.05, count))[::-1]
    return [
        {
            "laser_id": n,
            "vert_correction": float(elevation[n]),
            "rot_correction": float(rng.uniform(-0.17, 0.17)),
            "vert_offset_correction": float(rng.uniform(0.14, 0.22)),
            "horiz_offset_correction": float(rng.choice([-0.026, 0.026])),
        }
        for n in range(count)
    ]


@pytest.mark.parametrize(
    ("make", "count"),
    [(lidars.vlp16, 16), (lidars.vlp32c, 32), (lidars.hdl32e, 32), (lidars.hdl64e, 64), (lidars.vls128, 128)],
)
def test_calibrated_velodyne_points_match_driver(tmp_path, make, count):
    rows = corrections(count)
    put(tmp_path / "calibration.yaml", {"lasers": rows, "num_lasers": count})
    rays = make(calibration=tmp_path / "calibration.yaml")
    for place, row in enumerate(rows):  # both list the highest laser first
        for column, distance in ((0, 1.0), (311, 7.5), (900, 60.0)):
            point = rays.origins[place, column] + distance * rays.directions[place, column]
            azimuth = 2 * math.pi * 10 * rays.times[place, column]
            np.testing.assert_allclose(point, velodyne_points(row, distance, azimuth), atol=1e-12)


def test_hdl64e_points_match_driver():
    """The built-in table contains the same corrections; using only heights, the lowest laser was off by 66 mm."""
    rays, table = lidars.hdl64e(), lidars._velodyne._HDL64E_S3
    number = min(range(64), key=lambda laser: table[laser][0])
    elevation, left, vertical = table[number]
    row = {"vert_correction": math.radians(elevation), "rot_correction": math.radians(left)}
    row |= {"vert_offset_correction": vertical / 1000, "horiz_offset_correction": 0.026 if number % 2 == 0 else -0.026}
    point = rays.origins[-1, 40] + 5.0 * rays.directions[-1, 40]
    expected = velodyne_points(row, 5.0, 2 * math.pi * 10 * rays.times[-1, 40])
    np.testing.assert_allclose(point, expected, atol=1e-12)
    assert abs(np.linalg.norm(rays.origins[-1, 40]) - math.hypot(vertical / 1000, 0.026)) < 1e-12


def put(path, fields):
    path.write_text(json.dumps(fields))
    return path


def test_ouster_matches_recorded_ouster_sdk_values():
    rays = lidars.ouster("OS1-64")
    assert rays.directions.shape == (64, 1024, 3)
    for place, (direction, offset) in OS1_64.items():
        np.testing.assert_allclose(rays.directions[place], direction, atol=1e-12)
        np.testing.assert_allclose(rays.origins[place], offset, atol=1e-12)
    np.testing.assert_allclose(rays.times[0], np.arange(1024) / 10240, atol=1e-15)
    assert (rays.times == rays.times[0]).all() and (rays.rings[:, 5] == np.arange(64)).all()


def test_ouster_matches_installed_ouster_sdk():
    core = pytest.importorskip("ouster.sdk.core")
    lut = core.XYZLut(core.SensorInfo.from_default(core.LidarMode._1024x10))
    rays = lidars.ouster("OS1-64")
    np.testing.assert_allclose(rays.directions.reshape(-1, 3), lut.direction * 1000, atol=1e-9)
    np.testing.assert_allclose(rays.origins.reshape(-1, 3), lut.offset, atol=1e-9)


@pytest.mark.parametrize("metadata", [ouster_metadata, old_ouster_metadata])
def test_ouster_metadata_of_all_firmwares_is_read(tmp_path, metadata):
    path = put(tmp_path / "os.json", metadata())
    rays, nominal = lidars.ouster(path), lidars.ouster("OS1-64")
    np.testing.assert_allclose(rays.directions, nominal.directions, atol=1e-15)
    np.testing.assert_allclose(rays.origins, nominal.origins, atol=1e-15)
    assert lidars.ouster(path, "512x20").directions.shape == (64, 512, 3)


@pytest.mark.parametrize(("window", "columns"), [((100, 200), range(100, 201)), ((1022, 1), (0, 1, 1022, 1023))])
def test_ouster_column_window_selects_columns(tmp_path, window, columns):
    fields = ouster_metadata(lidar_data_format={"column_window": list(window)})
    rays, whole = lidars.ouster(put(tmp_path / "os.json", fields)), lidars.ouster("OS1-64")
    np.testing.assert_allclose(rays.directions, whole.directions[:, list(columns)], atol=1e-15)
    np.testing.assert_allclose(rays.times, whole.times[:, list(columns)], atol=1e-15)


@pytest.mark.parametrize("name", ["OS0-128", "os-1-128", "OS2-128"])
def test_nominal_ouster_beams_are_even_in_groups_of_four(name):
    rays = lidars.ouster(name, "512x10")
    _, elevation = angles(rays)
    np.testing.assert_allclose(np.diff(elevation[:, 0]), -2 * elevation[0, 0] / 127, atol=1e-9)
    left = np.degrees(np.arctan2(rays.directions[:, 256, 1], rays.directions[:, 256, 0]))
    assert (np.abs(left - np.tile(left[:4], 32)) < 1e-9).all() and left[0] < 0 < left[3]


# Highest and lowest elevation, and azimuths of the middle beams, to the right [deg], of sensors whose metadata is in
# tests/metadata and tests/pcaps of ouster-sdk at 46b7bcee. An OS0's azimuths grow toward its outer beams.
UNIFORM = {
    "OS0-32": (43.9, -46.2, None),
    "OS1-32": (20.55, -21.48, (-4.25, -4.25)),
    "OS2-32": (10.87, -10.48, (-2.09, -2.07)),
    "OS1-64-U": (21.45, -20.92, (-4.22, 1.39)),
}


@pytest.mark.parametrize("model", UNIFORM)
def test_uniform_ouster_beams_are_near_those_of_sensors(model):
    rays = lidars.ouster(model, "512x10")
    _, elevation = angles(rays)
    highest, lowest, azimuth = UNIFORM[model]
    count = int(model[4:6])
    assert elevation.shape == (count, 512)
    np.testing.assert_allclose(elevation[[0, -1], 0], [highest, lowest], atol=0.5)
    middle = rays.directions[count // 2 - 1 : count // 2 + 1, 256]
    if azimuth is not None:
        np.testing.assert_allclose(np.degrees(np.arctan2(-middle[:, 1], middle[:, 0])), azimuth, atol=0.1)


@pytest.mark.parametrize("line", ["OS0", "OS1", "OS2"])
def test_uniform_ouster_beams_are_some_of_128(line):
    whole = lidars.ouster(f"{line}-128", "512x10")
    half = lidars.ouster("os-1-64-u" if line == "OS1" else f"{line}-64", "512x10")
    quarter = lidars.ouster(f"{line}-32", "512x10")
    for rays, rows in ((half, slice(1, None, 2)), (quarter, slice(3, None, 4))):
        np.testing.assert_array_equal(rays.directions, whole.directions[rows])
        np.testing.assert_array_equal(rays.origins, whole.origins[rows])
        assert (rays.rings[:, 0] == np.arange(len(rays.rings))).all()
        assert rays.times.min() == 0 and rays.times.max() < 0.1


LIVOX = np.array([[0.0, 0.1], [1.0, -0.2], [2.0, 0.3], [3.0, 0.0], [-1.0, 0.5]], dtype=np.float32)


def livox_csv(path):
    rows = [f"{t:.6f},{np.degrees(a):.9f},{90 - np.degrees(e):.9f}" for t, (a, e) in enumerate(LIVOX.astype(float))]
    path.write_text("\n".join(["Time/s,Azimuth/deg,Zenith/deg", *rows]) + "\n")
    return path


def livox_npy(path):
    np.save(path, LIVOX)
    return path


@pytest.mark.parametrize("file", [lambda p: livox_csv(p / "mid360.csv"), lambda p: livox_npy(p / "mid360.npy")])
def test_livox_frames_continue_the_pattern(tmp_path, file):
    pattern = lidars.livox("Mid-360", file(tmp_path))
    azimuth, elevation = LIVOX.T.astype(np.float64)
    wanted = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    frames = [pattern.frame(k, samples=3) for k in range(6)]
    seen = np.concatenate([frame.directions.reshape(-1, 3) for frame in frames])
    np.testing.assert_allclose(seen, np.tile(wanted, (4, 1))[:18], atol=1e-9)
    np.testing.assert_allclose(np.ravel(frames[0].times), [0, 1 / 30, 2 / 30], atol=1e-15)
    # Lasers fire in turn, one per sample of the pattern: four in a Mid-360, one in a Mid-40.
    assert np.concatenate([frame.rings for frame in frames]).tolist() == [0, 1, 2, 3, 0] * 3 + [0, 1, 2]
    assert pattern.lines == 4 and lidars.livox("mid40", file(tmp_path)).frame(0, samples=5).rings.tolist() == [0] * 5
    # Livox defines directions as Rz(azimuth) Ry(zenith - 90 degrees) x.
    turn = wanted[1]
    c, s = math.cos(-elevation[1]), math.sin(-elevation[1])
    np.testing.assert_allclose(turn[2], -s, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*turn[:2]), c, atol=1e-12)


@pytest.mark.parametrize(
    ("model", "rate", "ends"),
    [("mid360", 200_000, (0.1, 70)), ("HAP", 452_000, (0.5, 150)), ("avia", 240_000, (0, math.inf))],
)
def test_livox_rates_and_ranges_match_specifications(tmp_path, model, rate, ends):
    np.save(tmp_path / "a.npy", np.zeros((50_000, 2), dtype=np.float32))
    pattern = lidars.livox(model, tmp_path / "a.npy")
    frame = pattern.frame(3)
    assert len(frame) * 10 == rate and (frame.near, frame.far) == ends
    assert frame.times.min() == 0 and frame.times.max() < 0.1
    limited = pattern.frame(near=1.0, far=2.0)
    assert (limited.near, limited.far) == (1.0, 2.0)


def test_livox_matches_installed_mujoco_lidar():
    pytest.importorskip("mujoco_lidar")
    from mujoco_lidar.scan_gen import LivoxGenerator

    theta, phi = LivoxGenerator("mid360").sample_ray_angles()
    frame = lidars.livox("mid360").frame(samples=24000)
    azimuth, elevation = angles(frame)
    np.testing.assert_allclose(np.radians(elevation.ravel()), phi, atol=1e-7)
    np.testing.assert_allclose(np.cos(np.radians(azimuth.ravel()) - theta), 1, atol=1e-12)
    assert lidars.livox("mid360").frame().directions.shape[:-1] == (20_000,)


@pytest.mark.parametrize(("model", "lines"), [("mid360", 4), ("avia", 6), ("horizon", 6), ("tele", 6), ("HAP", 6)])
def test_livox_samples_of_one_line_are_close(model, lines):
    pytest.importorskip("mujoco_lidar")
    pattern = lidars.livox(model)
    assert pattern.lines == lines

    def step(apart):
        turn = np.angle(np.exp(1j * (pattern.azimuth[apart:] - pattern.azimuth[:-apart])))
        return np.median(np.hypot(turn, pattern.elevation[apart:] - pattern.elevation[:-apart]))

    assert step(lines) < 0.7 * min(step(apart) for apart in range(1, lines))


def test_even_lidar_matches_isaac_lab():
    """Isaac Lab's `lidar_pattern`: linspace of elevations, arange of azimuths without the end of a full revolution."""
    rays = lidars.even(5, (-0.5, 0.25), increment=math.radians(3))
    azimuth, elevation = angles(rays)
    np.testing.assert_allclose(elevation[::-1, 0], np.degrees(np.linspace(-0.5, 0.25, 5)), atol=1e-12)
    expected = np.deg2rad(np.arange(-180, 180, 3))
    np.testing.assert_allclose(np.cos(np.radians(azimuth[0]) - expected), 1, atol=1e-12)
    part = lidars.even(1, (0, 0), (0.0, 1.0), 0.25)
    np.testing.assert_allclose(np.radians(angles(part)[0]), [[0, 0.25, 0.5, 0.75, 1]], atol=1e-12)


def test_bpearl_elevations_match_isaac_lab():
    azimuth, elevation = angles(lidars.bpearl(math.radians(10)))
    isaac = [89.5, 86.6875, 83.875, 81.0625, 78.25, 75.4375, 72.625, 69.8125, 67.0, 64.1875, 61.375, 58.5625, 55.75,
             52.9375, 50.125, 47.3125, 44.5, 41.6875, 38.875, 36.0625, 33.25, 30.4375, 27.625, 24.8125, 22, 19.1875,
             16.375, 13.5625, 10.75, 7.9375, 5.125, 2.3125]  # fmt: skip
    np.testing.assert_allclose(elevation[:, 0], isaac, atol=1e-9)
    assert azimuth.shape == (32, 36)
    np.testing.assert_allclose(np.diff(azimuth[5]), 10, atol=1e-9)


def test_grid_matches_isaac_lab():
    rays = lidars.grid((1.6, 1.0), 0.1)
    x, y = np.meshgrid(np.arange(-0.8, 0.8 + 1e-9, 0.1), np.arange(-0.5, 0.5 + 1e-9, 0.1), indexing="xy")
    np.testing.assert_allclose(rays.origins, np.stack([x, y, 0 * x], axis=-1), atol=1e-12)
    assert (np.asarray(rays.directions) == [0, 0, -1]).all()
    slanted = lidars.grid((0, 0), 1, (0, 3, -4))
    np.testing.assert_allclose(slanted.directions, [[[0, 0.6, -0.8]]])


def test_laser_scan_angles_match_message():
    rays = lidars.laser_scan(-1.0, 1.0, 0.5, time_increment=0.001, near=0.1, far=9.0)
    np.testing.assert_allclose(np.radians(angles(rays)[0]).ravel(), [-1, -0.5, 0, 0.5, 1], atol=1e-12)
    np.testing.assert_allclose(np.ravel(rays.times), np.arange(5) * 0.001)
    assert (rays.near, rays.far) == (0.1, 9.0)
    np.testing.assert_allclose(
        np.radians(angles(lidars.laser_scan(1.0, -1.0, -1.0))[0]).ravel(), [1, 0, -1], atol=1e-12
    )


@pytest.mark.parametrize(
    ("model", "count", "rate", "ends"),
    [
        ("A1", 1454, 5.5, (0.15, 12)),
        ("a2", 800, 10, (0.15, 12)),
        ("A3", 1600, 10, (0.2, 25)),
        ("S2", 3200, 10, (0.05, 30)),
    ],
)
def test_rplidar_matches_data_sheet(model, count, rate, ends):
    """An A2 has 0.45 degrees, an A3 0.225 and an S2 0.1125 degrees at 10 Hz."""
    rays = lidars.rplidar(model)
    azimuth, elevation = angles(rays)
    assert azimuth.shape == (count,) and not elevation.any() and (rays.near, rays.far) == ends
    np.testing.assert_allclose(np.diff(np.unwrap(np.radians(azimuth))), -2 * math.pi * rate * rays.times[1], atol=1e-9)
    assert azimuth[0] == 0 and rays.times[0] == 0 and 0.998 / rate < rays.times[-1] < 1 / rate
    assert lidars.rplidar(model, 10.0, near=1.0, far=2.0).shape == ({"A1": 800}.get(model, count),)


BAD = {
    "an unknown RPLIDAR": (lambda p: lidars.rplidar("A9"), 'model must be "A1", "A2", "A3" or "S2", got .A9.'),
    "a rate that an RPLIDAR lacks": (lambda p: lidars.rplidar("A2", 4), "rate must be a number from 5 to 15, got 4"),
    "a rate out of range": (lambda p: lidars.vlp16(30), "rate must be a number from 5 to 20, got 30"),
    "no calibration": (
        lambda p: lidars.vlp16(calibration=put(p / "a.yaml", {})),
        "is not a calibration of velodyne_pointcloud: it has no list of lasers",
    ),
    "a calibration of another sensor": (
        lambda p: lidars.vlp32c(calibration=velodyne_file(p / "a.yaml")),
        "must have the 32 lasers of the sensor, got 16",
    ),
    "lasers without an angle": (
        lambda p: lidars.vlp16(calibration=velodyne_file(p / "a.yaml", vert_correction="up")),
        "vert_correction of a laser must be a finite number, got 'up'",
    ),
    "a laser twice": (
        lambda p: lidars.vlp16(calibration=velodyne_file(p / "a.yaml", laser_id=3)),
        "laser_id of its lasers must be 0 to 15, each once",
    ),
    "an unknown Ouster": (lambda p: lidars.ouster("OS1-16"), "or the metadata of a sensor, a JSON file, got 'OS1-16'"),
    "an unknown mode": (lambda p: lidars.ouster("OS1-128", "1024x11"), 'mode must be "512x10", .* got .1024x11.'),
    "metadata of another kind": (
        lambda p: lidars.ouster(put(p / "a.json", {"width": 3})),
        "is not metadata of an Ouster sensor: beam_altitude_angles is missing",
    ),
    "a list": (
        lambda p: lidars.ouster(put(p / "a.json", [1])),
        "is not metadata of an Ouster sensor: it must be a JSON object",
    ),
    "beams that are missing": (
        lambda p: lidars.ouster(
            put(p / "a.json", ouster_metadata(beam_intrinsics={"beam_altitude_angles": [1.0] * 63}))
        ),
        "has 63 beam altitudes, but 64 beam azimuths",
    ),
    "words for beams": (
        lambda p: lidars.ouster(
            put(p / "a.json", ouster_metadata(beam_intrinsics={"beam_altitude_angles": ["a"] * 64}))
        ),
        "beam_altitude_angles must be 64 finite numbers",
    ),
    "beams that are not there": (
        lambda p: lidars.ouster(
            put(p / "a.json", ouster_metadata(beam_intrinsics={"beam_altitude_angles": [1.0] * 32 + [0.0] * 32}))
        ),
        "must have the angles of all 64 beams, got 64, 32 of them 0",
    ),
    "another model's beams": (
        lambda p: lidars.ouster(put(p / "a.json", ouster_metadata(sensor_info={"prod_line": "OS-1-16-A0"}))),
        "has 64 beams, but is for an OS-1-16-A0",
    ),
    "a window outside": (
        lambda p: lidars.ouster(put(p / "a.json", ouster_metadata(lidar_data_format={"column_window": [0, 1024]}))),
        r"column_window must be two columns of the 1024 per frame, got \[0, 1024\]",
    ),
    "a window of another mode": (
        lambda p: lidars.ouster(
            put(p / "a.json", ouster_metadata(lidar_data_format={"column_window": [9, 99]})), "512x10"
        ),
        "mode must have 1024 columns because the file has a window from 9 to 99, got 512",
    ),
    "no rotation": (
        lambda p: lidars.ouster(
            put(p / "a.json", ouster_metadata(lidar_intrinsics={"lidar_to_sensor_transform": [2.0] * 16}))
        ),
        "lidar_to_sensor_transform must be a rotation and a translation",
    ),
    "an unknown Livox": (lambda p: lidars.livox("mid999"), "model must be one of mid360, avia.* got 'mid999'"),
    "a Livox file that is not there": (lambda p: lidars.livox("avia", p / "a.csv"), "cannot be read"),
    "a Livox file of other columns": (
        lambda p: lidars.livox("avia", put(p / "a.csv", [1])),
        "must begin with the line 'Time/s,Azimuth/deg,Zenith/deg'",
    ),
    "a Livox file of words": (
        lambda p: lidars.livox("avia", text(p / "a.csv", "Time/s,Azimuth/deg,Zenith/deg\n1,2,x\n")),
        "must contain three numbers per line",
    ),
    "Livox angles in degrees": (
        lambda p: lidars.livox("avia", array(p / "a.npy", np.full((9, 2), 45.0))),
        "elevations from -90 to 90 degrees",
    ),
    "a Livox array of another shape": (
        lambda p: lidars.livox("avia", array(p / "a.npy", np.zeros((9, 3)))),
        r"floats of shape \(samples, 2\), got float64 of \(9, 3\)",
    ),
    "a frame longer than the pattern": (
        lambda p: lidars.livox("avia", livox_npy(p / "a.npy")).frame(),
        "samples must be at most the 5 samples of the pattern, got 24000",
    ),
    "increments that lead away": (
        lambda p: lidars.laser_scan(0.0, 1.0, -0.1),
        "angle_increment must lead from 0 to 1, got -0.1",
    ),
    "elevations the wrong way round": (
        lambda p: lidars.even(3, (0.5, 0.1)),
        "elevation must be two angles, the lower one first, got 0.5 and 0.1",
    ),
    "more than a turn": (
        lambda p: lidars.even(3, azimuth=(0, 6.5)),
        "azimuth must be within one turn, got 6.5 radians",
    ),
    "no resolution": (lambda p: lidars.grid((1, 1), 0), "resolution must be more than 0 m, got 0"),
    "no direction": (lambda p: lidars.grid((1, 1), 1, (0, 0, 0)), "direction must not be zero"),
    "a grid without end": (lambda p: lidars.grid((1e9, 1e9), 0.1), "a grid may have at most 67108864 rays"),
}


def text(path, words):
    path.write_text(words)
    return path


def array(path, values):
    np.save(path, values)
    return path


@pytest.mark.parametrize("name", BAD)
def test_invalid_input_raises_one_line_errors(tmp_path, name):
    call, message = BAD[name]
    with pytest.raises(wv.WarpvisError, match=message) as found:
        call(tmp_path)
    assert "\n" not in str(found.value)


def test_livox_requires_file_without_mujoco_lidar(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(wv.WarpvisError, match=r"path must be given, .* because mujoco-lidar, .* is not installed"):
        lidars.livox("mid360")

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Hesai lidars, compared with the tables and the formulas of Hesai's SDK."""

import math

import numpy as np
import pytest

from warpvis.sensors import lidars

# Channel: elevation, azimuth to the right [deg], and firing times after the first laser of a cycle [us]. From
# pandarGeneral_internal.cc of HesaiLidar_General_SDK, and the correction files of HesaiLidar_SDK_2.0 at ea7f86f.
TABLES = {
    "pandar64": {
        1: (14.882, -1.042, [31.488]), 7: (1.86, 1.042, [43.224]), 8: (1.688, 3.125, [7.872]),
        10: (1.351, -5.208, [17.712]), 12: (1.013, -1.042, [0]), 18: (0, -1.042, [1.968]),
        44: (-4.385, 3.125, [31.488]), 53: (-5.898, -3.125, [41.92]), 54: (-6.061, -1.042, [38.008]),
        61: (-12.974, -1.042, [51.048]), 64: (-24.897, -1.042, [41.92]),
    },
    "xt32": {1: (15, 0, [0]), 2: (14, 0, [1.512]), 16: (0, 0, [22.68]), 32: (-16, 0, [46.872])},
    "qt128": {
        1: (-52.627, 10.108, [112.823]), 5: (-46.695, 8.833, [166.679]), 32: (-19.191, 6.25, [134.999]),
        33: (-18.331, -6.217, [27.056]), 64: (7.094, -5.938, [49.232]), 65: (7.910, 5.949, [0.856, 111.111]),
        96: (35.549, 7.327, [23.032, 133.287]), 97: (19.191, -6.25, [25.344, 137.311]),
        99: (20.926, -6.323, [0, 111.967]), 128: (52.627, -10.108, [47.52, 159.487]),
    },
    "at128": {
        1: (12.883, -2.4, [0]), 2: (12.684, 0.65, [0]), 3: (12.485, -2.4, [8.24]), 17: (9.695, 2.4, [0]),
        18: (9.496, -0.65, [0]), 33: (6.507, -2.4, [2.504]), 64: (0.33, -0.65, [13.28]), 128: (-12.423, -0.65, [8.264]),
    },
}  # fmt: skip

# Of the same files: the optical center, to the right and forward of the axis [m], and points per second.
CENTERS = {"pandar64": (-0.012, 0.03873), "xt32": (-0.013, 0.0315), "qt128": (0.0072, 0.0354), "at128": (0, 0)}
RATES = {"pandar64": 1_152_000, "xt32": 640_000, "qt128": 864_000, "at128": 1_536_000}


@pytest.fixture(params=list(TABLES))
def name(request):
    return request.param


def azimuths(rays):
    """Return azimuths clockwise from y, Hesai's 0 [deg]."""
    return np.degrees(np.arctan2(rays.directions[..., 0], rays.directions[..., 1]))


def test_points_per_second_and_times(name):
    rays = getattr(lidars, name)()
    assert rays.directions[..., 0].size * 10 == RATES[name]
    assert rays.times.min() == 0 and rays.times.max() < 0.1 and (np.diff(rays.times, axis=1) > 0).all()
    elevation = np.degrees(np.arcsin(rays.directions[..., 2]))
    assert (np.diff(elevation[:, 0]) < 1e-9).all() and (np.ptp(elevation, axis=1) < 1e-9).all()
    assert set(rays.rings.ravel()) == set(range(int(name[-3:].strip("rt"))))


def test_channels_match_tables_of_the_sdk(name):
    rays = getattr(lidars, name)()
    speed = 3600.0 if name != "at128" else 0.0  # degrees per second; all lasers of an AT128 share the azimuth
    for channel, (elevation, azimuth, times) in TABLES[name].items():
        rows = np.flatnonzero(rays.rings[:, 0] == channel - 1)
        found = np.sort(rays.times[rows, 0]) * 1e6
        np.testing.assert_allclose(found, times, atol=2e-3)
        for row in rows:
            assert np.degrees(np.arcsin(rays.directions[row, 0, 2])) == pytest.approx(elevation, abs=6e-4)
            left = azimuths(rays)[row, 0] - speed * rays.times[row, 0]
            first = 0.0 if name != "at128" else 30.05
            assert left - first == pytest.approx(azimuth if name != "at128" else -azimuth, abs=1e-3)


@pytest.mark.parametrize("spinning", ["pandar64", "xt32", "qt128"])
def test_points_match_distance_correction_of_the_sdk(spinning):
    """`GeneralParser::GetDistanceCorrection` moves points, in the frame of the rotor, to the optical center."""
    rays = getattr(lidars, spinning)()
    for row in range(0, len(rays.rings), 7):
        elevation, azimuth, _ = TABLES[spinning].get(rays.rings[row, 0] + 1, (None, None, None))
        if elevation is None:
            continue
        for column in (0, 17, 400):
            heading = 2 * math.pi * 10 * rays.times[row, column]
            e, a = math.radians(elevation), math.radians(azimuth)
            right, forward = CENTERS[spinning]
            x, y = 8 * math.cos(e) * math.sin(a) + right, 8 * math.cos(e) * math.cos(a) + forward
            x, y = x * math.cos(heading) + y * math.sin(heading), y * math.cos(heading) - x * math.sin(heading)
            point = rays.origins[row, column] + 8 * rays.directions[row, column]
            np.testing.assert_allclose(point, [x, y, 8 * math.sin(e)], atol=2e-4)


def test_pairs_of_a_pandar64_fire_together():
    _, counts = np.unique(np.round(lidars.pandar64().times[:, 0], 10), return_counts=True)
    assert (counts == 2).all() and len(counts) == 32


def test_sequences_of_a_qt128_alternate():
    rays = lidars.qt128()
    first = rays.times[:, 0] < 1 / 9000
    assert first.sum() == 96
    assert set(rays.rings[first, 0]) == set(range(32, 128)) and set(rays.rings[~first, 0]) == {
        *range(32),
        *range(64, 128),
    }


def test_at128_covers_120_degrees_ahead():
    rays = lidars.at128()
    middle = np.degrees(np.arctan2(rays.directions[..., 1], rays.directions[..., 0])).reshape(64, 2, 1200).mean(1)
    assert middle.max() == pytest.approx(59.95 + 0.875) and middle.min() == pytest.approx(-59.95 - 0.875)
    np.testing.assert_allclose(np.diff(middle, axis=1), -0.1, atol=1e-9)
    assert rays.times.max() < 0.0501

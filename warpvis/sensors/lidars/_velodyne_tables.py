# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Default calibrations of Velodyne lidars.

The tables of the VLP-16 and VLP-32C are from the driver velodyne_decoder (``calib_db.cpp`` at 08ddf97), which uses the
values of the user manuals. The table of the HDL-64E is that of one calibrated S3: ``HDL-64.xml`` of LidarView, as in
the same driver.
"""

from __future__ import annotations

VLP16_ELEVATION = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""Elevation of each laser, in firing order [deg]."""

VLP32C = (
    (-25, -1.4), (-1, 4.2), (-1.667, -1.4), (-15.639, 1.4), (-11.31, -1.4), (0, 1.4), (-0.667, -4.2), (-8.843, 1.4),
    (-7.254, -1.4), (0.333, 4.2), (-0.333, -1.4), (-6.148, 1.4), (-5.333, -4.2), (1.333, 1.4), (0.667, -4.2), (-4, 1.4),
    (-4.667, -1.4), (1.667, 4.2), (1, -1.4), (-3.667, 4.2), (-3.333, -4.2), (3.333, 1.4), (2.333, -1.4), (-2.667, 1.4),
    (-3, -1.4), (7, 1.4), (4.667, -1.4), (-2.333, 4.2), (-2, -4.2), (15, 1.4), (10.333, -1.4), (-1.333, 1.4),
)  # fmt: skip
"""Elevation and correction of the azimuth, to the left, of each laser [deg]."""

VLP16_FOCAL = 0.04191
VLP32C_FOCAL = 0.0424
"""Distance from the axis at which all beams intersect [m]. Beams start on the axis, at -focal * tan(elevation)."""

HDL64E_S3 = (
    (-6.29, -4.55, 215), (-5.89, -2.46, 214), (1.15, 3.3, 205), (1.52, 5.52, 205),
    (-5.61, -0.23, 214), (-5.29, 2.05, 213), (-7.63, -1.01, 216), (-7.26, 1.22, 216),
    (-4.96, 4.05, 213), (-4.57, 6.29, 212), (-7, 3.26, 215), (-6.64, 5.54, 215),
    (-2.22, -4.55, 209), (-1.84, -2.28, 209), (-4.26, -5.31, 212), (-3.84, -3.09, 211),
    (-1.55, -0.26, 209), (-1.18, 2.01, 208), (-3.58, -1.04, 211), (-3.2, 1.21, 211),
    (-0.88, 4.01, 208), (-0.52, 6.23, 207), (-2.91, 3.23, 210), (-2.53, 5.46, 210),
    (1.86, -4.58, 204), (2.19, -2.32, 204), (-0.15, -5.35, 207), (0.23, -3.09, 206),
    (2.51, -0.28, 203), (2.81, 1.95, 203), (0.48, -1.1, 206), (0.89, 1.18, 205),
    (-21.77, -7.45, 159), (-21.28, -3.99, 158), (-10.67, 5.01, 146), (-9.99, 8.21, 145),
    (-20.91, -0.51, 158), (-20.34, 2.96, 157), (-23.95, -1.82, 162), (-23.44, 1.69, 161),
    (-19.74, 6.43, 156), (-19.14, 9.79, 156), (-22.82, 5.23, 160), (-22.27, 8.7, 160),
    (-15.58, -7.27, 151), (-15.15, -3.8, 151), (-18.72, -8.63, 155), (-18.19, -5.1, 155),
    (-14.72, -0.46, 150), (-14.16, 2.86, 150), (-17.77, -1.75, 154), (-17.3, 1.69, 153),
    (-13.73, 6.13, 149), (-13.13, 9.49, 149), (-16.71, 5.01, 153), (-16.2, 8.43, 152),
    (-9.37, -7, 144), (-9.15, -3.76, 144), (-12.37, -8.3, 148), (-12.05, -4.98, 147),
    (-8.65, -0.45, 144), (-8.11, 2.65, 143), (-11.59, -1.71, 147), (-11.12, 1.54, 146),
)  # fmt: skip
"""Elevation and azimuth correction, to the left [deg], and vertical offset, perpendicular to the beam [mm]. The first
32 lasers are the upper block."""

HDL64E_SIDE = 0.026
"""Distance at which beams pass the axis [m]: to the left for lasers with even numbers, to the right for the others."""

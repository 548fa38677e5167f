# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""All lens models, with realistic coefficients."""

from warpvis.cameras import lenses

INTRINSICS = (300.0, 310.0, 161.0, 119.0)
WIDTH, HEIGHT = 320, 240
OPENCV = (-0.3, 0.1, 0.001, -0.002, 0.01, 0.05, 0.05, 0.001, 0.01, 0.002, -0.003, 0.001, 0.05, -0.03)
FISHEYE = (0.01, 0.002, -0.003, 0.0004)
THIN_PRISM = (0.01, 0.02, 0.001, 0.002, 0.003, 0.001, 0.002, 0.003)
MEI = (-0.2, 0.05, 0.001, -0.002)
ARIA = (0.01, 0.02, 0.003, 0.004, 0.001, 0.0005, 0.001, 0.002, 0.003, 0.004, 0.005, 0.006)

LENSES = {
    **{f"opencv {count}": lenses.OpenCVPinhole(*INTRINSICS, OPENCV[:count]) for count in (4, 5, 8, 12, 14)},
    "opencv radial": lenses.OpenCVPinhole(*INTRINSICS, (-0.3, 0.1, 0, 0, 0.01)),
    "opencv wide": lenses.OpenCVPinhole(60, 60, 160, 120, (-0.28, 0.07, 0.0003, -0.0002)),
    "opencv folded": lenses.OpenCVPinhole(*INTRINSICS, (-0.9, 0, 0.05, -0.04)),
    "azure kinect": lenses.OpenCVPinhole(252, 252, 160, 120, (4.9, 2.5, 1e-4, -5e-5, 0.12, 5.2, 3.8, 0.68)),
    "fisheye": lenses.KannalaBrandt(100, 110, 160, 120, FISHEYE),
    "fisheye folded": lenses.KannalaBrandt(100, 110, 160, 120, (-0.1, -0.02, 0, 0)),
    "thin prism": lenses.ThinPrismFisheye(100, 110, 160, 120, THIN_PRISM),
    "thin prism, radial": lenses.ThinPrismFisheye(100, 110, 160, 120, (0.01, 0.02, 0, 0, 0.003, 0.001, 0, 0)),
    "aria": lenses.RadTanThinPrismFisheye(100, 110, 160, 120, ARIA),
    "double sphere": lenses.DoubleSphere(100, 100, 160, 120, -0.2, 0.6),
    "double sphere 2": lenses.DoubleSphere(100, 100, 160, 120, 0.3, 0.4),
    "eucm": lenses.EUCM(100, 100, 160, 120, 0.6, 1.1),
    "ucm": lenses.EUCM(100, 100, 160, 120, 0.4),
    "fov": lenses.FOV(150, 150, 160, 120, 0.9),
    "division": lenses.Division(100, 100, 160, 120, -0.2),
    "division, pincushion": lenses.Division(200, 200, 160, 120, 0.2),
    "ftheta": lenses.FTheta(160, 120, (0.01, 1e-7, -1e-9)),
    "ftheta, forward": lenses.FTheta(160, 120, (100, -3, 1, 0.2), "angle_to_radius"),
    "mei": lenses.Mei(300, 310, 161, 119, 0.9, MEI),
    "mei, fisheye": lenses.Mei(300, 310, 161, 119, 1.45, MEI),
    "mei, parabolic": lenses.Mei(120, 120, 161, 119, 1.0, (-0.01, 0.0, 0.001, -0.002)),
    "mei, radial": lenses.Mei(120, 120, 161, 119, 0.9, (*MEI[:2], 0, 0)),
    "mei, rim": lenses.Mei(80, 80, 161, 119, 1.45, MEI),
    "scaramuzza": lenses.Scaramuzza(160, 120, (-110, 0, 2e-3, -3e-6, 6e-9), (0.9999, 0.001, -0.002, 1.0)),
    "scaramuzza, long": lenses.Scaramuzza(160, 120, (-90, 0.01, 2e-3, 0, 0, 1e-11)),
    "equirectangular": lenses.Equirectangular(WIDTH, HEIGHT),
    "cylindrical": lenses.Cylindrical(50, 50, 160, 120),
}

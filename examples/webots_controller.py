# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A Webots controller that maps what its robot's range finder sees; elsewhere, the same for a world without Webots.

In Webots: copy it to controllers/webots_controller/ and give the robot `controller "webots_controller"` and
`supervisor TRUE`.
"""

import sys
from importlib import resources

import warpvis as wv
from warpvis.webots import DepthEye, load_webots, render_range

BOUNDS = ((-2, -2), (2, 2))

try:
    from controller import Supervisor  # Webots' own package, which only its controllers can import
except ImportError:
    path = resources.files("warpvis.scenes") / "webots" / "experiment_3_R2023b.wbt"
    world = load_webots(path)
    device = world.devices["range-finder"]
    depth = render_range(world, "range-finder", exclude_body=True)
    labels = wv.classify(depth, device.camera, device.pose)
    points = wv.back_project(depth, device.camera, device.pose)
    floor = wv.floor_map(points, labels, bounds=BOUNDS)
    print(f"no Webots here; of {path.name} the robot sees {floor.area(wv.Label.GROUND)[0]:.1f} m^2 of the floor")
    sys.exit()

robot = Supervisor()
step = int(robot.getBasicTimeStep())
range_finder = robot.getDevice("range-finder")
range_finder.enable(step)
eye = DepthEye(range_finder, robot=robot)
robot.step(step)
while robot.step(step) != -1:
    floor = eye.floor_map(bounds=BOUNDS)
    print(f"ground in view: {floor.area(wv.Label.GROUND)[0]:.2f} m^2")

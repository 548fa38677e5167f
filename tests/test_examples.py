# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The example scripts run unchanged and print the expected results."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
SAYS = {
    "gymnasium_depth.py": r"(Fetch|Pusher)[\w-]+: observations have .*depth, .*\nafter 50 steps show \d+% of object.*\n"
    r"4 environments: depth \(4, 64, 64\) float32",
    "gymnasium_rgbd.py": r"NatureCNN \(12, 64, 64\)\n(\d+ steps, \d+ s: episodes of \d+ steps\n){5}",
    "active_camera.py": r"shaped, seed 0: (9\d|100)% of the mug visible at the end, (.|\n)*"
    r"shaped, seed 1: (9\d|100)% of the mug(.|\n)*sparse, seed 0: [0-4]?\d% of the mug",
    "torch_depth.py": r"a tensor \(32, 64, 64\) on (cpu|cuda:0), of the same memory\n"
    r"the error fell from 0\.\d+ to 0\.0[01]\d, of shares of 0\.09",
    "aloha_perspective.py": r"spoon +object +hidden by pot +hidden by pot +neither\n"
    r"the collaborator may mean the (pot|lid): 4\d%(.|\n)*the salt: 1\d%\nthe teleoperator must move to see: salt\n",
    "ros2_node.py": r'cup: {"status": "visible", "fraction": 0\.1\d+, "pixels": \d+, "hidden_by": "arm"}\n'
    r'bowl: {"status": "visible", "fraction": 1\.0, .*\nlamp: {"status": "out_of_view"',
    "ros2_watch.py": r'robot: {"cup": {"status": "visible", "visible": 1\.0.*\nanna: {"cup": {"status": "occluded"'
    r'.*\nben: {"cup": {"status": "unknown"',
    "webots/controllers/visibility/visibility.py": r"experiment_3.wbt: depth image: the ball; the robot sees the ball; "
    r"both see the low obstacle; both see the high obstacle\nexperiment_4.wbt: depth image: the person; neither sees",
    "depth_holes.py": r"one decision per pixel: .*, \d{4} holes\n(.|\n)*realsense_d435: \d\.\d% lost, \d{2,3} holes\n"
    r"(.|\n)*MatchedStereo: \d\.\d% lost, \d{2,3} holes",
    "depth_sensors.py": r"realsense_d415: VALID \d+\.\d%, .*, SHADOW .*, BAND (.|\n)*structure: .*RANGE .*median",
    "expected_depth.py": r"vanished 'cup' at .*\nmoved 'box' at .* by \([+-]0\.00, -0\.1[12], [+-]0\.00\) m "
    r"(.|\n)*appeared something",
    "depth_noise.py": r"NguyenNoise +\d\.\d mm.*\nKhoshelhamNoise +\d\.\d mm(.|\n)*"
    r"SimKinect +\d(.|\n)*Corruptions.*lost",
    "learned_noise.py": r"27756 weights learn from 128 images(.|\n)*loss -2\.\d\d\ndepth \[m\](.|\n)*"
    r"\d\d% of the holes are imitated",
    "lens.py": r"pinhole: 51\.9% of the image shows the room(.|\n)*lens: 43\.2% of",
    "hand_eye_calibration.py": r"overhead camera, before: 50\.00 mm, 5\.000 degrees\n(.|\n)*11 images: 0\.\d+ mm, 0\.0"
    r"(.|\n)*wrist camera, before: 50\.00 mm, 5\.000 degrees\n(.|\n)*11 images: 1\.\d+ mm, 0\.[01]",
    "lidar_to_map.py": r"start: 500\.0 mm, 5\.000 degrees\nregistered: [01]\.\d mm, 0\.0\d+ degrees\n"
    r"384 starts: [2-3]\d end within (.|\n)*best: [01]\.\d mm, .* 99\.\d% inliers",
    "lidar.py": r"131072 points, 425\d\d of beams between",
    "measured_floor.py": r"height 1\.(29|30)\d m instead of 1\.300 m, confidence 0\.(.|\n)* 1\.100 m(.|\n)* 1\.400 m",
    "measured_experiments.py": r"experiment_1\n  floor: 0\.\d\d degrees, [+-]\d mm\n  floor map: 9\d\.\d% of (.|\n)*"
    r"robot: visible, measured visible \d+%\n  ball for the human: visible, measured visible \d+%\nexperiment_2(.|\n)*"
    r"robot: occluded, measured occluded\n  ball for the human: visible, measured unknown 100%\nexperiment_3(.|\n)*"
    r"robot: visible, measured visible \d+%\n.*out of view\nexperiment_4(.|\n)*robot: occluded, measured occluded\n",
    "motion.py": r"de-skewing 65536 points moves them by up to 2\.7\d m",
    "sample_views.py": r"\d+ places of the mug tried, \d+ accepted; most failed by the status of 'mug' for 'robot'\n"
    r"\d+ cameras tried, \d+ accepted, \d+ of them refined",
    "sensor_fit.py": r"6 walls; f b (.|\n)*sigma of disparity +0\.0(79|80)\d* px\nstep of disparity +0\.031",
    "time_of_flight.py": r"least coherence 0\.9: 4\.3% of the pixels say nothing(.|\n)*least coherence 0\.0: 4\.0%",
    "mujoco_depth.py": r"the bob shows on \d+ pixels, 2\.\d+ m away.*\nof 512 views the bob shows in 512",
    "mujoco_rollout.py": r"160 depth images of 8 rollouts\nwhere the bob is in the first rollout, in columns: \[\d+, ",
    "place_cameras.py": r"1584 candidates, 6150 targets, 120 worlds\n"
    r"chosen: \[3, .*objective 0\.89\d, at most 0\.96\d\ntwo cameras see 8\d",
    "move_into_view.py": r" 7\d% of the mug visible, .*\n"
    r"(  0% of the mug visible, (9[5-9]|100)% after a move of 0\.[4-6]\d m\n){7}",
    "refine_pose.py": r"before +5\.0\d degrees +50\.0 mm\nAdam +0\.[0-3]\d degrees +\d\.\d mm\n"
    r"wv.register +0\.[01]\d degrees +[0-5]\.\d mm",
    "calibrate_intrinsics.py": r"(?s)fx +56.0000 +58.8000 +5\d\.\d{4} +\d\.\de-0[4-7].*fy .* \d\.\de-0[4-7] "
    r".*k2 +0\.0300 +0\.0285 ",
    "rooms.py": r"6 rooms in rooms\.png",
    "people.py": r"16 people in people\.png",
    "randomized_worlds.py": r"12 worlds in randomized_worlds\.png",
    "mujoco_warp_depth.py": r"the ball is seen in 64 of 64 worlds\nits top is in row 35 of the first, 0 of the last",
}


def test_every_example_is_tested():
    assert {path.relative_to(EXAMPLES).as_posix() for path in EXAMPLES.rglob("*.py")} == set(SAYS)


_FAST = {"depth_sensors.py"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name if name in _FAST else pytest.param(name, marks=pytest.mark.slow) for name in SAYS]
)
def test_examples_run(name, tmp_path):
    for module in ("mujoco_warp", "gymnasium", "torch", "stable_baselines3"):
        needs = re.search(rf"(import|from) {module}", (EXAMPLES / name).read_text())
        if needs and importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    done = subprocess.run([sys.executable, EXAMPLES / name], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(SAYS[name], done.stdout), done.stdout

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""For any argument, a public function succeeds or raises a `WarpvisError` that describes the problem."""

import math

import numpy as np
import pytest
import warp as wp
from fuzz_calls import call_once

import warpvis as wv

from support.garbage import cases, files_for_cases, public_callables

BAD = {
    "None": None,
    "a word": "big",
    "no word": "",
    "bytes": b"big",
    "NaN": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "minus one": -1,
    "half": 0.5,
    "zero": 0,
    "True": True,
    "a complex number": 1j,
    "a number beyond floats": 10**400,
    "a whole number beyond all memory": 10**18,
    "next to nothing": 1e-300,
    "nearly all": 1e300,
    "nothing": [],
    "a list of one": [1],
    "ragged lists": [[1], [2, 3]],
    "words": ["big", "small"],
    "a mapping": {"big": None},
    "a set": {1, 2},
    "an object": object(),
    "a function": len,
    "a type": int,
    "an array": np.full((2, 3), np.nan),
    "an empty array": np.zeros((0, 7)),
    "an array of objects": np.array([None, {}]),
    "an array of words": np.array(["a", "b"]),
    "a Warp array": wp.zeros(3, dtype=wp.vec3, device="cpu"),
}


# Results of calls, not meant to be constructed by users, and lists of constants.
RESULTS = {
    "SdfSensor",
    "Snapshot",
    "BatchSummary",
    "BatchRenderer",
    "Exposure",
    "Frame",
    "OutputSpec",
    "BatchViews",
    "BodyVisibility",
    "BestViews",
    "Candidate",
    "ConstraintCheck",
    "Coverage",
    "DepthComparison",
    "Registration",
    "Device",
    "Lidar",
    "Experiment",
    "FloorFit",
    "FloorMap",
    "FrameDataset",
    "MujocoScene",
    "Node",
    "ObjectFractions",
    "ObjectVisibility",
    "OccupancyGrid",
    "Perspective",
    "SceneCamera",
    "PlanVisibility",
    "Placement",
    "Posture",
    "Proposal",
    "Livox",
    "MeasuredFrame",
    "Recognized",
    "Recording",
    "Returns",
    "LineOfSight",
    "Sight",
    "Track",
    "Watched",
    "SampledPoses",
    "Samples",
    "SceneChange",
    "SceneObject",
    "ScenePreset",
    "Term",
    "Version",
    "Views",
    "VoxelMap",
    "WebotsWorld",
    "WorldPoses",
    "VisibilityMargins",
    "Opening",
    "Room",
    "RoomItem",
    "Seat",
    "SupportPlace",
    "Moment",
    "Participant",
    "Question",
    "Shortcut",
    "ShortcutReport",
    "Situation",
    "Thing",
}

# Drawing is slow: only some of the bad values are used.
DRAWN = {
    "view",
    "Viewer",
    "Viewer.save_html",
    "WatchPage",
    "save_rerun",
    "save_depth",
    "save_map",
    "save_overview",
    "save_perspective",
    "save_point_sightings",
    "save_sightings",
    "view_from_outside",
}
FEW = ("None", "a word", "NaN", "minus one", "an object", "an array")


# Internal entry points, whose arguments are validated before.
OURS = {
    "Situation.from_dict",  # of records of files, which `open_situations` checks
    "Figure.posed",
    "Posture.apply",
    "Posture.rotated",
    "Posture.value",
    "ViewerState.colors",
    "MujocoStage.set_joint",
    "MujocoStage.value",
    "MujocoStage.can_place",
    "MujocoStage.place",
    "MujocoStage.eyes",
    "AnyCamera.device_struct",
    "AnyCamera.ray_range",
    "AnyCamera.prepared",
    "RayCamera.device_struct",
    "RayCamera.prepare_in",
    "RayCamera.prepared",
    "RayCamera.rays_at",
    "Camera.device_struct",
    "OrthographicCamera.device_struct",
    "Scene.bvh",
    "WatchPage.say",
    "WatchPage.show",
    "WatchPage.wait_for",
    "Scene.device_lights",
    "Scene.device_alternatives",
    "Scene.device_materials",
    "Scene.device_skies",
    "Scene.movable_poses",
    "Scene.replace_objects",
    "Scene.require_planes",
    "Scene.triangles",
    "Scene.add_parts",
    "BoxRegion.place",
    "ShellRegion.place",
    "Scene.use_labels",
    "FractionMeter.follow_scene",
    "FractionMeter.measure_parsed",
    "MarginMeter.measure_parsed",
    "Renderer.render_parsed",
    "register_output",  # changes the table of all tests; `test_plugins` tests bad arguments
    "DepthSensor.check",
    "DepthSensor.depth_sigma",  # raises; those of models are tested
    "DepthSensor.measure",
    "Exposure.cast_at",
    "Exposure.cast_images_at",
    "Exposure.launch",
    "Exposure.measure_some",
    "Corruptions.check",
    "Corruptions.measure",
    "KhoshelhamNoise.measure",
    "LearnedDepth.check",
    "LearnedDepth.measure",
    "LidarNoise.check",
    "LidarNoise.measure",
    "MatchedStereo.check",
    "MatchedStereo.measure",
    "NguyenNoise.measure",
    "RedwoodNoise.measure",
    "SimKinect.measure",
    "Randomized.check",
    "Randomized.measure",
    "StereoDepth.check",
    "StereoDepth.measure",
    "TimeOfFlight.check",
    "TimeOfFlight.measure",
    "FieldOfView.faces",
    "FrameRenderer.render",
    "Frames.take",
    "Frames.world_of",
    "Perspective.cell",
    "Agent.face_poses",
    "Agent.angles_to",
    # Arguments of Gymnasium.
    "DepthObservation.reset",
    "PoseObservation.reset",
    "VectorDepthObservation.reset",
    "VectorDepthObservation.step",
    "VectorVisibilityReward.reset",
    "VectorVisibilityReward.step",
    "VectorVisibleFractions.reset",
    "VectorVisibleFractions.step",
    "VisibilityReward.reset",
    "VisibilityReward.step",
    "VisibleFractions.reset",
    "VisibleFractions.step",
}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    folder = files_for_cases(tmp_path_factory.mktemp("files"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder / "out")  # a path that is a plain word must not create a file in the checkout
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, path: None)  # only drawing is tested
        yield cases(folder)


def test_all_public_names_are_covered(table):
    """A new function, class or method needs an entry above."""
    names = {
        name.partition(",")[0].partition(" of ")[0].removeprefix("mujoco.").removeprefix("gymnasium.") for name in table
    }
    missing = {name for name in public_callables() if name not in names} - RESULTS - OURS
    assert not {name for name in missing if name.partition(".")[0] not in {"Node", "ScenePreset", "Experiment"}}


def test_valid_arguments_are_accepted(table):
    """Otherwise the tests of bad arguments would be meaningless."""
    for function, arguments in table.values():
        function(**arguments)


NAMES = (
    "Agent agent_ Camera Field Floor Frames Label Perspective Renderer Scene Voxel back_ classify floor_ look_ object_ "
    "persp point_ read_frames render voxel Frame verify warmup load_ read_po read_model save_ Sphere plan_ Batch "
    "compare Kinematics Mujoco mujoco World camera_ geom_ scene_ Best Coverage best_ clearance coverage minimum pose_ "
    "Constraint check_ Box Shell Support sample_ visible_ Fraction Visibility visibility_ Margin "
    "propose standing surface along frames_ grid looks orbit random sphere view_ Depth Lens Version add_ distort "
    "place_ Placement unknown_ Measured Occupancy read_tracks read_sensors Track Watch Randomized Reference "
    "Ortho gym open_ framing depth_ from_image to_image from_color to_color to_compressed to_point to_occ find_ quanti "
    "range_ recog segm Li bpearl even hdl vl pandar64 xt32 qt128 at128 rplidar "
    "Motion Rolling deskew laser_ livox ouster gather_ measure_ reflect spread_ to_laser Rays Wide Rangef "
    "lights_ line_ robot_ register to_livox Matched Stereo realsense_ gemini_ zed_ oak_ kinect_ structure fit "
    "read_depth TimeOf azure_ femto_ pmd_ Nguyen Khoshelham Corruptions SimKinect Redwood Latency Learned sensor_ "
    "Viewer view MujocoStage read_scene Webots "
    "Body Colors Figure Person at_ in_circle in_queue read_figure crouching looking_ pointing posed reaching sitting "
    "stature walking generate_ Room Situation Stage parameter_ with_ ray_jac origin_jac "
).split()


@pytest.mark.parametrize("begin", [pytest.param(n, marks=pytest.mark.slow) if n == "save_" else n for n in NAMES])
@pytest.mark.filterwarnings("ignore")
def test_bad_arguments_are_accepted_or_raise(table, begin):
    """For names with this prefix, every parameter accepts each bad value or raises an error with a message."""
    chosen = [name for name in table if name.startswith(begin)]
    assert chosen
    failures = []
    for name in chosen:
        function, arguments = table[name]
        for parameter in arguments:
            for what in FEW if name in DRAWN else BAD:
                try:
                    function(**{**arguments, parameter: BAD[what]})
                except wv.WarpvisError as error:
                    if not str(error):
                        failures.append(f"{name}({parameter}={what}) says nothing")
                except Exception as error:
                    failures.append(f"{name}({parameter}={what}): {type(error).__name__}: {error}")
    assert not failures, "\n".join(failures)


@pytest.mark.filterwarnings("ignore")
def test_random_calls_succeed_or_raise(table):
    """`make fuzz` makes a hundred thousand calls."""
    failures = [call_once(table, seed) for seed in range(300)]
    assert not [failure for failure in failures if failure[2] is not None]


def test_every_name_has_a_prefix(table):
    assert not [name for name in table if not name.startswith(tuple(NAMES))]

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics of joint trees, compared with Pinocchio, and the joints of a scene."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.core.labels import LabelRules
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import PoseError, SceneError
from warpvis.scene import FileParts, Part, move_with_links, solids
from warpvis.scene.joints import Joint, JointTree, Mimic

ONES = np.array([0.1, -0.2, 0.3, 0.5, 0.5, 0.5, 0.5])


def pose(*row):
    return poses_to_matrices(np.array(row, dtype=np.float64))


def chain():
    """Return a tree with a joint of each kind, and one that follows another."""
    lift = pose(0, 0, 1, 0, 0, 0, 1)
    return JointTree(
        [
            Joint("knee", "revolute", "b", "c", lift, axis=(0, 3, 0), limits=(-1, 2)),
            Joint("turn", "continuous", "a", "b", lift, axis=(0, 0, 1)),
            Joint("slide", "prismatic", "c", "d", lift, axis=(1, 0, 0), limits=(0, 0.5)),
            Joint("weld", "fixed", "d", "e", pose(*ONES)),
            Joint("drift", "planar", "e", "f", axis=(0, 0, 1)),
            Joint("fly", "floating", "a", "g", lift),
            Joint("finger", "revolute", "d", "h", lift, axis=(0, 1, 0), mimic=Mimic("knee", -2.0, 0.1)),
        ]
    )


def test_each_kind_moves_its_child():
    tree = chain()
    assert tree.names == ("knee", "turn", "slide", "drift", "fly") and len(tree) == 7
    rest = tree.link_poses()
    np.testing.assert_allclose(rest["d"][0], pose(0, 0, 3, 0, 0, 0, 1), atol=1e-15)
    angles = np.linspace(-1, 2, 7)
    found = tree.link_poses({"knee": angles, "turn": 0.5, "slide": 0.25, "drift": (1, 2, 0.5), "fly": ONES})
    assert {rows.shape for rows in found.values()} == {(7, 4, 4)}
    turned = trimesh.transformations.rotation_matrix(0.5, (0, 0, 1))
    for angle, d, h, f, e in zip(angles, found["d"], found["h"], found["f"], found["e"], strict=True):
        knee = trimesh.transformations.rotation_matrix(angle, (0, 1, 0))
        expected = rest["a"][0] @ pose(0, 0, 1, 0, 0, 0, 1) @ turned @ pose(0, 0, 1, 0, 0, 0, 1) @ knee
        expected = expected @ pose(0.25, 0, 1, 0, 0, 0, 1)
        np.testing.assert_allclose(d, expected, atol=1e-15)
        finger = trimesh.transformations.rotation_matrix(0.1 - 2 * angle, (0, 1, 0))
        np.testing.assert_allclose(h, d @ pose(0, 0, 1, 0, 0, 0, 1) @ finger, atol=1e-15)
        drift = pose(1, 2, 0, 0, 0, 0, 1) @ turned
        np.testing.assert_allclose(f, e @ drift, atol=1e-15)
    np.testing.assert_allclose(found["g"][3], pose(0, 0, 1, 0, 0, 0, 1) @ pose(*ONES), atol=1e-15)


def test_initial_values_and_frames_of_children():
    joint = Joint("j", "revolute", "a", "b", axis=(0, 0, 1), initial=0.5, child_origin=pose(1, 0, 0, 0, 0, 0, 1))
    tree = JointTree([joint], {"a": pose(0, 0, 7, 0, 0, 0, 1)})
    np.testing.assert_allclose(tree.link_poses()["b"][0, :3, 3], [np.cos(0.5), np.sin(0.5), 7])
    np.testing.assert_allclose(tree.link_poses({"j": 0})["b"][0, :3, 3], [1, 0, 7])


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, -1), (1, 2, 3)])
def test_planar_joint_moves_perpendicularly_to_its_axis(axis):
    joint = Joint("j", "planar", "a", "b", axis=axis)
    moved = joint.child_poses(np.array([[0.3, -0.7, 0.4]]))[0]
    unit = np.array(axis) / np.linalg.norm(axis)
    assert moved[:3, 3] @ unit == pytest.approx(0) and np.linalg.norm(moved[:3, 3]) == pytest.approx(np.hypot(0.3, 0.7))
    np.testing.assert_allclose(moved[:3, :3], trimesh.transformations.rotation_matrix(0.4, axis)[:3, :3], atol=1e-15)


def random_tree(rng, joints=20):
    """Return a random tree, its URDF, and random values of its joints."""
    items, lines, values = [], ['<robot name="r"><link name="link_0"/>'], {}
    kinds = ("revolute", "continuous", "prismatic", "fixed")
    for number in range(1, joints + 1):
        kind, parent = kinds[rng.integers(4)], f"link_{rng.integers(number)}"
        xyz, rpy, axis = rng.normal(size=3), rng.uniform(-3, 3, 3), rng.normal(size=3)
        origin = trimesh.transformations.euler_matrix(*rpy)
        origin[:3, 3] = xyz
        items.append(Joint(f"joint_{number}", kind, parent, f"link_{number}", origin, axis=axis, limits=(-3, 3)))
        rows = [" ".join(map(repr, row.tolist())) for row in (xyz, rpy, axis / np.linalg.norm(axis))]
        lines.append(
            f'<link name="link_{number}"/><joint name="joint_{number}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="link_{number}"/><origin xyz="{rows[0]}" rpy="{rows[1]}"/><axis xyz="{rows[2]}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
        if kind != "fixed":
            values[f"joint_{number}"] = rng.uniform(-3, 3, 5)
    return JointTree(items), "".join(lines) + "</robot>", values


@pytest.mark.parametrize("seed", range(3))
def test_random_trees_match_pinocchio(seed):
    pinocchio = pytest.importorskip("pinocchio")
    tree, text, values = random_tree(np.random.default_rng(seed))
    model = pinocchio.buildModelFromXML(text)
    data, found = model.createData(), tree.link_poses(values)
    for world in range(5):
        q = pinocchio.neutral(model)
        for name, rows in values.items():
            joint = model.joints[model.getJointId(name)]
            angle = [np.cos(rows[world]), np.sin(rows[world])]
            q[joint.idx_q : joint.idx_q + joint.nq] = [rows[world]] if joint.nq == 1 else angle
        pinocchio.framesForwardKinematics(model, data, q)
        for link in tree.links:
            expected = data.oMf[model.getFrameId(link)].homogeneous
            np.testing.assert_allclose(found[link][world], expected, atol=1e-12)


def arm_parts(**options):
    """Return the parts of a robot: a base, an arm of two boxes, one welded, and a ball on a slide."""
    box = trimesh.creation.box((0.1, 0.1, 1))
    tree = JointTree(
        [
            Joint("turn", "revolute", "base", "arm", axis=(0, 1, 0), limits=(-2, 2)),
            Joint("weld", "fixed", "arm", "tip", pose(0, 0, 1, 0, 0, 0, 1)),
            Joint("slide", "prismatic", "tip", "ball", axis=(0, 0, 1)),
        ]
    )
    links = tree.link_poses()
    meshes = {"base": box, "arm": box, "tip": box, "ball": solids.sphere(0.2)}
    shapes = {name: mesh if name == "ball" else (mesh.vertices, mesh.faces) for name, mesh in meshes.items()}
    parts = [Part(name, shape, pose=links[name][0], link=name) for name, shape in shapes.items()]
    return FileParts(Path("arm.urdf"), move_with_links(parts, tree), up="z", defines_frame=True, joints=tree)


def arm(movable=True, up="z"):
    scene = wv.Scene(up=up)
    scene.add_parts(arm_parts(), LabelRules(), movable=movable)
    return scene


@pytest.mark.parametrize("up", ["z", "y"])
def test_poses_of_a_scene_move_its_objects(up):
    scene = arm(up=up)
    assert [scene.objects[index].name for index in scene.movable] == ["arm", "ball"]
    assert scene["tip"].parent == scene.index("arm") and scene["ball"].solid is not None
    initial = scene.joints.poses()
    expected = poses_to_matrices([scene["arm"].pose, scene["ball"].pose])
    np.testing.assert_allclose(poses_to_matrices(initial[0]), expected, atol=1e-6)
    found = scene.joints.poses({"turn": [0, np.pi / 2], "slide": 0.5})
    assert found.shape == (2, 2, 7) and found.dtype == np.float32
    ahead = [1.5, 0, 0]
    np.testing.assert_allclose(found[1, 1, :3], ahead, atol=1e-6)
    upright = [0, 0, 1.5] if up == "z" else [0, 1.5, 0]
    np.testing.assert_allclose(found[0, 1, :3], upright, atol=1e-6)


def test_every_part_may_be_movable_by_itself():
    scene = arm(movable=["*"])
    assert len(scene.movable) == 4
    together, separate = arm().joints.poses({"turn": 1.0}), scene.joints.poses({"turn": 1.0})
    np.testing.assert_allclose(separate[0, [1, 3]], together[0], atol=1e-6)
    np.testing.assert_allclose(separate[0, 0], [0, 0, 0, 0, 0, 0, 1])


def test_objects_of_the_user_stay():
    scene = arm()
    scene.add(trimesh.creation.box((1, 1, 1)), name="cup", movable=True, pose=(9, 0, 0, 0, 0, 0, 1))
    np.testing.assert_allclose(scene.joints.poses({"turn": [0, 1, 2]})[:, 2], [[9, 0, 0, 0, 0, 0, 1]] * 3)


def test_sweep_renders_all_worlds():
    scene = arm()
    angles = np.linspace(-1.5, 1.5, 100)
    camera, view = wv.Camera.from_fov(48, 48, hfov=0.8), wv.look_at((0, -6, 0.5), (0, 0, 0.5))
    options = {"object_poses": scene.joints.poses({"turn": angles}), "outputs": ("segmentation",)}
    views = wv.render(scene, camera, np.tile(view, (100, 1)), **options)
    seen = views.segmentation.numpy() == scene.index("ball")
    columns = [np.flatnonzero(image.any(axis=0)).mean() for image in seen]
    assert columns[0] < columns[50] < columns[99]


@pytest.mark.parametrize("copied", [lambda scene: scene.to("cpu"), lambda scene: pickle.loads(pickle.dumps(scene))])
def test_copies_keep_joints(copied):
    scene = arm()
    values = {"turn": [0.3, 0.4]}
    np.testing.assert_array_equal(copied(scene).joints.poses(values), scene.joints.poses(values))


def test_scene_without_joints_has_initial_poses():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)), name="cup", movable=True, pose=ONES)
    assert len(scene.joints) == 0
    np.testing.assert_allclose(scene.joints.poses()[0, 0], ONES, atol=1e-7)
    with pytest.raises(PoseError, match="values of 'turn' fit no joint; there are no joints"):
        scene.joints.poses({"turn": 1})


BAD_VALUES = {
    "unknown": ({"elbow": 1}, "values of 'elbow' fit no joint; the joints are 'knee', 'turn', 'slide', 'drift', 'fly'"),
    "too large": ({"knee": [0, 2.5]}, "values of 'knee' must be from -1 to 2 rad, got 2.5 at index 1; check_limits="),
    "too small": ({"slide": -0.1}, "values of 'slide' must be from 0 to 0.5 m, got -0.1 at index 0"),
    "fixed": ({"weld": 0}, "joint 'weld' is fixed and has no value"),
    "follows": ({"finger": 0}, "joint 'finger' follows 'knee'; give the values of that one"),
    "shape": ({"knee": np.zeros((2, 2))}, r"values of 'knee' must have shape \(\) or \(W,\), got \(2, 2\)"),
    "planar": ({"drift": [1, 2]}, r"values of 'drift' must have shape \(3,\) or \(W, 3\), got \(2,\)"),
    "floating": ({"fly": [1, 2]}, r"values of 'fly' must have shape \(V, 7\)"),
    "NaN": ({"turn": np.nan}, "values of 'turn' must be finite"),
    "text": ({"turn": "far"}, "values of 'turn' must be an array of numbers"),
    "worlds": (
        {"turn": [1, 2], "slide": 0, "knee": [0, 1, 2]},
        "same number of worlds, got 2 for 'turn' and 3 for 'kn",
    ),
    "no mapping": ([1, 2], "values must be a mapping"),
}


@pytest.mark.parametrize("case", BAD_VALUES)
def test_bad_values_raise_one_sentence(case):
    values, message = BAD_VALUES[case]
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        chain().link_poses(values)
    assert "\n" not in str(caught.value)


def test_limits_may_be_ignored():
    assert len(chain().link_poses({"knee": [0, 9]}, check_limits=False)["a"]) == 2


def two(first=(), **second):
    base = {"name": "i", "kind": "revolute", "parent": "b", "child": "c"}
    return [
        Joint(**{"name": "j", "kind": "revolute", "parent": "a", "child": "b", **dict(first)}),
        Joint(**base | second),
    ]


BAD_TREES = {
    "kind": (lambda: two(kind="screw"), SceneError, "kind of joint 'i' must be \"fixed\", .* got 'screw'"),
    "axis": (lambda: two(axis=(0, 0, 0)), SceneError, "axis of joint 'i' must not be zero"),
    "limits": (lambda: two(limits=(1, 0)), SceneError, "limits of joint 'i' must be in ascending order, got 1, 0"),
    "origin": (lambda: two(origin=np.eye(4) * 2), PoseError, "origin of joint 'i' must"),
    "name": (lambda: JointTree(two(name="j")), SceneError, "names of joints must be different, got 'j' twice"),
    "child": (lambda: JointTree(two(child="b")), SceneError, "link 'b' is the child of two joints, 'j' and 'i'"),
    "circle": (lambda: JointTree(two(child="a")), SceneError, "joint 'j' is in a circle of joints: link 'b' is below"),
    "leader": (lambda: JointTree(two(mimic=Mimic("k"))), SceneError, "joint 'i' follows 'k', which is no joint"),
    "itself": (lambda: JointTree(two(mimic=Mimic("i"))), SceneError, "joint 'i' follows itself"),
    "planar": (lambda: two(kind="planar", mimic=Mimic("j")), SceneError, "'i' is planar and must not follow"),
    "root": (lambda: JointTree(two(), {"b": ONES}), SceneError, "link 'b' has a pose, but is moved by the joint 'j'"),
    "no joint": (lambda: JointTree([1]), SceneError, "joints must be Joints"),
    "missing": (lambda: JointTree(two())["k"], SceneError, "no joint is named 'k'; the joints are 'j', 'i'"),
}


@pytest.mark.parametrize("case", BAD_TREES)
def test_bad_trees_raise_one_sentence(case):
    make, error, message = BAD_TREES[case]
    with pytest.raises(error, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)

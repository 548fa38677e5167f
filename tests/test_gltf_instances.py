# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""glTF instances (EXT_mesh_gpu_instancing) and nodes of one mesh share it in the scene."""

import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter

import warpvis as wv
from warpvis.errors import FileFormatError
from warpvis.io import _gltf
from warpvis.scene.acceleration import traversal_plan

from support import instances as instance_scenes
from support.many_objects import calls_of

PART = trimesh.creation.icosphere(subdivisions=1)  # an ellipsoid away from its origin
PART.vertices = PART.vertices * (0.2, 0.3, 0.5) + (0.1, 0.2, 0)
COUNT = 40
CAMERA = wv.Camera.from_fov(80, 60, hfov=1.0)
POSES = np.array([wv.look_at(eye, (0, 0, 0)) for eye in ((6, 1, 2), (-4, 5, -3))], dtype=np.float32)
SHEARED = {"matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}

few_share = instance_scenes.shared  # a fixture


def rotation(quaternion):
    """Return the matrix of a unit quaternion ``x y z w``."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rows_of(count, sizes=((1, 1, 1),)):
    """Return positions, rotations and scales of instances."""
    rng = np.random.default_rng(0)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    places = rng.uniform(-2.5, 2.5, (count, 3))
    return np.float32(places), np.float32(turns), np.float32([sizes[number % len(sizes)] for number in range(count)])


def write(path, rows, mesh=PART, **node):
    """Write a file with one node with instances."""
    writer = GltfWriter(extensionsUsed=["EXT_mesh_gpu_instancing"])
    keys = ("TRANSLATION", "ROTATION", "SCALE")
    attributes = {key: writer.accessor(values) for key, values in zip(keys, rows, strict=True)}
    many = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    writer.node(writer.primitive(mesh.vertices, mesh.faces), name="part", extensions=many, **node)
    path.write_bytes(writer.bytes())
    return path


def flattened(rows, mesh=PART, above=None, **options):
    """Return the equivalent scene of separate meshes in world coordinates, y up."""
    scene, above = wv.Scene(up="y", **options), np.eye(4) if above is None else above
    for number, (place, turn, size) in enumerate(zip(*map(np.float64, rows), strict=True)):
        linear = rotation(turn / np.linalg.norm(turn)) * size
        corners = (mesh.vertices @ linear.T + place) @ above[:3, :3].T + above[:3, 3]
        mirrored = np.linalg.det(above[:3, :3] @ linear) < 0
        scene.add((corners, mesh.faces[:, ::-1] if mirrored else mesh.faces), name=f"part_{number}")
    return scene


def assert_alike(scene, twin, **options):
    """Check equal vertices, and images equal up to rounding."""
    assert [item.name for item in scene] == [item.name for item in twin]
    for item in twin:
        there = scene[item.name]
        np.testing.assert_allclose(there.vertices[there.faces], item.vertices[item.faces], atol=2e-6)
    outputs = ("depth", "segmentation", "labels")
    views, others = (wv.render(each, CAMERA, POSES, outputs=outputs, **options) for each in (scene, twin))
    depth, other = views.depth.numpy(), others.depth.numpy()
    same = np.isclose(depth, other, rtol=0, atol=1e-4)
    assert np.isfinite(other).mean() > 0.05
    assert same.mean() > 0.998
    assert (views.segmentation.numpy() == others.segmentation.numpy())[same].mean() > 0.998
    assert (views.labels.numpy()[same] == others.labels.numpy()[same]).mean() > 0.998


def meshes_of(scene):
    return {id(item.shared_mesh) for item in scene if item.shared_mesh is not None}


@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_instances_share_a_mesh_and_a_tree(few_share, tmp_path, device, cull_backfaces):
    turn = [0.5, 0.5, -0.5, 0.5]
    path = write(tmp_path / "many.glb", rows_of(COUNT), translation=[0.5, 0, 0], rotation=turn, scale=[1.5, 1.5, 1.5])
    scene = wv.Scene.load(path, up="y", device=device)
    assert len(meshes_of(scene)) == 1
    assert len(traversal_plan.plan_traversal(scene._objects, scene.device).instances) == COUNT
    assert not scene.movable
    above = np.eye(4)
    above[:3, :3], above[0, 3] = 1.5 * rotation(turn), 0.5
    assert_alike(scene, flattened(rows_of(COUNT), above=above, device=device), cull_backfaces=cull_backfaces)


SIZES = [(1, 1, 1), (2, 1, 0.5), (1, -1, 1), (1, 1, 1), (-2, -1, -0.5)]


def test_mesh_is_stored_once_per_size(few_share, tmp_path):
    """Mirrored instances count as separate sizes and face outwards."""
    scene = wv.Scene.load(write(tmp_path / "many.glb", rows_of(COUNT, SIZES)), up="y")
    assert len({id(item.faces) for item in scene}) == len(meshes_of(scene)) == 4
    assert_alike(scene, flattened(rows_of(COUNT, SIZES)), cull_backfaces=True)
    for item in scene:
        assert trimesh.Trimesh(item.vertices, item.faces, process=False).volume > 0


def test_sheared_and_flat_instances_share_no_mesh(tmp_path):
    above = np.array(SHEARED["matrix"]).reshape(4, 4).T
    scene = wv.Scene.load(write(tmp_path / "many.glb", rows_of(COUNT), **SHEARED), up="y")
    assert not meshes_of(scene)
    assert_alike(scene, flattened(rows_of(COUNT), above=above))
    rows = rows_of(COUNT, [(1, 1, 0), (1, 1, 1)])
    scene = wv.Scene.load(write(tmp_path / "flat.glb", rows), up="y")
    assert len(meshes_of(scene)) == 1
    assert_alike(scene, flattened(rows))


@pytest.mark.parametrize("scale", [0.1, (1, 2, 0.5)])
def test_instances_with_up_axis_and_scale(tmp_path, scale):
    """The whole file is scaled, not only each mesh."""
    scene = wv.Scene.load(write(tmp_path / "many.glb", rows_of(COUNT)), scale=scale)
    assert len(meshes_of(scene)) == (1 if scale == 0.1 else 0)
    for item, twin in zip(scene, flattened(rows_of(COUNT)), strict=True):
        x, y, z = twin.vertices.T
        np.testing.assert_allclose(item.vertices, np.stack([x, -z, y], axis=1) * scale, atol=2e-6)


def test_movable_instances_start_at_their_poses_in_the_file(tmp_path, device):
    rows = rows_of(COUNT)
    scene = wv.Scene.load(write(tmp_path / "many.glb", rows), up="y", movable=["part_1*"], device=device)
    moving = [number for number in range(COUNT) if str(number).startswith("1")]
    assert scene.movable == tuple(moving)
    np.testing.assert_allclose(scene.movable_poses().numpy()[0, :, :3], rows[0][moving], atol=1e-6)
    assert len({id(item.faces) for item in scene}) == 1
    assert_alike(scene, flattened(rows, device=device))


def test_names_and_labels_of_instances(tmp_path):
    path = write(tmp_path / "many.glb", rows_of(12), extras={"label": "human"})
    labels = {"part_1*": "object", "part_11": 40}
    scene = wv.Scene.load(path, labels=labels, label_names={40: "toy"})
    assert [item.name for item in scene] == [f"part_{number}" for number in range(12)]
    assert [int(item.label) for item in scene] == [4, 3, *[4] * 8, 3, 40]


def shared_by_nodes():
    """Return two nodes of one mesh, one of another, and one more of the first that deforms it."""
    writer = GltfWriter()
    move = np.ones_like(PART.vertices, dtype=np.float32)
    part = writer.primitive(PART.vertices, PART.faces, targets=[{"POSITION": writer.accessor(move)}])
    writer.node(part, name="one", translation=[1, 0, 0])
    writer.node(name="two", translation=[0, 2, 0], rotation=[0, 0, 0.5**0.5, 0.5**0.5], scale=[1, 1, -1])
    writer.node(writer.primitive(PART.vertices, PART.faces), name="other", translation=[0, 0, 3])
    writer.node(name="three", translation=[-1, 0, 0])
    writer.node(name="bent", weights=[0.5])
    for number in (1, 3, 4):
        writer.content["nodes"][number]["mesh"] = 0
    return writer


@pytest.mark.parametrize("movable", [False, "t*"])
def test_static_nodes_of_one_mesh_share_it(tmp_path, movable):
    """A movable node has the identity pose where the file places it, as if no other node shared its mesh."""
    (tmp_path / "nodes.glb").write_bytes(shared_by_nodes().bytes())
    scene = wv.Scene.load(tmp_path / "nodes.glb", up="y", movable=movable)
    x, y, z = PART.vertices.T
    wanted = {
        "one": PART.vertices + (1, 0, 0),
        "two": np.stack([-y, x + 2, -z], axis=1),
        "other": PART.vertices + (0, 0, 3),
        "three": PART.vertices - (1, 0, 0),
        "bent": PART.vertices + 0.5,
    }
    assert [item.name for item in scene] == list(wanted)
    for name, corners in wanted.items():
        np.testing.assert_allclose(scene[name].vertices, corners, atol=1e-6)
        assert trimesh.Trimesh(scene[name].vertices, scene[name].faces, process=False).volume > 0
    if movable:
        assert scene.movable == (1, 3)
        np.testing.assert_array_equal(scene.movable_poses().numpy()[0], [[0, 0, 0, 0, 0, 0, 1]] * 2)
    else:
        assert scene["three"].faces is scene["one"].faces
        assert scene["other"].faces is not scene["one"].faces


def test_node_transforms_are_split_in_one_call(tmp_path, monkeypatch):
    """Splitting them one by one takes a quarter of a millisecond each."""
    calls, whole = [], _gltf.split
    monkeypatch.setattr(_gltf, "split", lambda matrices: calls.append(len(matrices)) or whole(matrices))
    (tmp_path / "nodes.glb").write_bytes(shared_by_nodes().bytes())
    wv.Scene.load(tmp_path / "nodes.glb")
    assert calls == [3]


def test_instance_quaternions_are_computed_in_few_calls(tmp_path):
    """Includes instances of several sizes, which are added one by one."""
    path = write(tmp_path / "many.glb", rows_of(COUNT, SIZES))
    assert calls_of("_quaternions", lambda: wv.Scene.load(path)) < 5


def test_exported_instances_share_their_mesh(few_share, tmp_path):
    scene = wv.Scene.load(write(tmp_path / "many.glb", rows_of(COUNT)))
    scene.export(tmp_path / "again.glb")
    again = wv.Scene.load(tmp_path / "again.glb")
    assert len(meshes_of(again)) == 1
    assert len(traversal_plan.plan_traversal(again._objects, again.device).instances) == COUNT
    assert_alike(again, scene)


@pytest.mark.slow
def test_one_hundred_thousand_instances_share_one_mesh(tmp_path):
    """The former limit was 100 million vertices, and each vertex was read."""
    rng, count = np.random.default_rng(0), 100_000
    rows = rng.uniform(-50, 50, (count, 3)), np.tile([0, 0, 0, 1], (count, 1)), np.ones((count, 3))
    mesh = trimesh.creation.icosphere(subdivisions=4)
    scene = wv.Scene.load(write(tmp_path / "many.glb", list(map(np.float32, rows)), mesh))
    assert scene.triangle_count == count * len(mesh.faces)
    plan = traversal_plan.plan_traversal(scene._objects, scene.device)
    assert len(plan.instances) == count
    assert len(plan.meshes) == 1
    np.testing.assert_allclose(plan.instance_poses[7, :3], rows[0][7][[0, 2, 1]] * (1, -1, 1), atol=1e-5)


def test_instances_of_too_many_sizes_raise(tmp_path, monkeypatch):
    monkeypatch.setattr("warpvis.io._gltf._MAX_CORNERS", 10 * len(PART.vertices))
    path = write(tmp_path / "many.glb", rows_of(COUNT, [(size, 1, 1) for size in range(1, 12)]))
    with pytest.raises(FileFormatError, match="the 40 instances of node 0 have more than"):
        wv.Scene.load(path)
    wv.Scene.load(write(tmp_path / "few.glb", rows_of(COUNT, [(size, 1, 1) for size in range(1, 11)])))


def test_part_without_joints_keeps_the_skinned_nodes_transform(tmp_path):
    """After a skinned part, whose node transform is ignored, it was once placed at the origin too."""
    writer = GltfWriter()
    writer.node(name="joint", translation=[0, 0, 5])
    writer.content["skins"] = [{"joints": [0]}]
    skinned = writer.primitive(PART.vertices, PART.faces)
    count = len(PART.vertices)
    skinned["attributes"] |= {
        "JOINTS_0": writer.accessor(np.zeros((count, 4), np.uint8)),
        "WEIGHTS_0": writer.accessor(np.tile(np.float32([1, 0, 0, 0]), (count, 1))),
    }
    plain = writer.primitive(PART.vertices, PART.faces)
    writer.node(skinned, plain, name="arm", skin=0, translation=[100, 0, 0])
    (tmp_path / "arm.glb").write_bytes(writer.bytes())
    scene = wv.Scene.load(tmp_path / "arm.glb", up="y")
    np.testing.assert_allclose(scene["arm_0"].vertices, PART.vertices + (0, 0, 5), atol=1e-5)
    np.testing.assert_allclose(scene["arm_1"].vertices, PART.vertices + (100, 0, 0), atol=1e-5)

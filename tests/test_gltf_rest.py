# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""glTF skins and morph targets in the unanimated state, which differs from the stored vertices."""

import warnings

import numpy as np
import pytest
from gltf_files import GltfWriter

import warpvis as wv
from warpvis.errors import FileFormatError

from support.gltf_rest import FIRST, ROWS, SECOND, WHOLE, skinned


def load(path, writer, **options):
    path.write_bytes(writer.bytes(**options))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(path, up="y")


@pytest.mark.parametrize("weights", [WHOLE, np.uint8(255 * WHOLE), np.uint16(65535 * WHOLE), 3 * WHOLE])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_skins_with_one_joint_per_vertex(tmp_path, weights, kind):
    scene = load(tmp_path / "a.glb", skinned(FIRST, weights, kind=kind), roots=[0, 2])
    np.testing.assert_allclose(scene["arm"].vertices, ROWS + (0, 0, 5), atol=1e-6)
    scene = load(tmp_path / "a.glb", skinned(SECOND, weights, kind=kind), roots=[0, 2])
    # Rotation about (0, 2, 0): (x, y) maps to (-(y - 2), x + 2).
    np.testing.assert_allclose(scene["arm"].vertices, [(2, 2, 5), (2, 3, 5), (0, 2, 5)], atol=1e-6)


def test_weights_of_several_joints_and_sets(tmp_path):
    joints, weights = np.array([[0, 1, 0, 0]] * 3), np.float32([[0.25, 0.25, 0, 0], [0, 0, 0, 0], [0.5, 0, 0, 0]])
    more = {
        "JOINTS_1": np.uint8([[1, 0, 0, 0]] * 3),
        "WEIGHTS_1": np.float32([[0.5, 0, 0, 0], [0] * 4, [0.5, 0, 0, 0]]),
    }
    scene = load(tmp_path / "a.glb", skinned(joints, weights, **more), roots=[0, 2])
    still, turned = ROWS + (0, 0, 5), np.array([(2, 2, 5), (2, 3, 5), (0, 2, 5)])
    wanted = [0.25 * still[0] + 0.75 * turned[0], ROWS[1], 0.5 * still[2] + 0.5 * turned[2]]
    np.testing.assert_allclose(scene["arm"].vertices, wanted, atol=1e-6)


def test_skins_without_matrices_and_meshes_without_joints(tmp_path):
    scene = load(tmp_path / "a.glb", skinned(SECOND, WHOLE, inverse=False), roots=[0, 2])
    np.testing.assert_allclose(scene["arm"].vertices, [(0, 2, 5), (0, 3, 5), (-2, 2, 5)], atol=1e-6)
    writer = skinned(SECOND, WHOLE)
    writer.content["meshes"][0]["primitives"][0]["attributes"].pop("JOINTS_0")
    np.testing.assert_allclose(load(tmp_path / "a.glb", writer)["arm"].vertices, ROWS + (100, 0, 0), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda content: content["nodes"][1].update(children=[0]), "node 0 is below itself"),
        (lambda content: content["skins"][0].update(joints=[0]), "a vertex moves with joint 1 of 1"),
        (lambda content: content["skins"][0].update(joints=[0, 9]), "it references nodes 9 of 3"),
        (
            lambda content: content["skins"][0].update(inverseBindMatrices=0),
            "a skin of 2 joints needs as many",
        ),
        (lambda content: content["nodes"][2].update(skin=3), "it references skins 3 of 1"),
        (
            lambda content: content["accessors"][2].update(count=2),
            "a skin needs 4 joints and weights of 3 vertices",
        ),
    ],
    ids=["loop", "few joints", "no node", "few matrices", "no skin", "few weights"],
)
def test_invalid_skins_raise(tmp_path, change, wanted):
    writer = skinned(SECOND, WHOLE)
    change(writer.content)
    with pytest.raises(FileFormatError, match=f"cannot be read as GLB: {wanted}"):
        load(tmp_path / "a.glb", writer, roots=[2])


def test_morph_target_weights(tmp_path):
    writer = GltfWriter()
    move = [np.float32(step * np.ones((3, 3))) for step in (1, 10, 100)]
    targets = [{"POSITION": writer.accessor(rows)} for rows in move] + [{"NORMAL": 0}]
    part = writer.primitive(ROWS, targets=targets)
    writer.node(part, mesh={"weights": [0.5, 0, 0.25, 1]}, name="mesh")
    writer.node(name="node", weights=[0, 2.0, 0, 0])
    writer.content["nodes"][1]["mesh"] = 0
    writer.node(part, name="rest")
    scene = load(tmp_path / "a.glb", writer)
    for name, off in (("mesh", 25.5), ("node", 20.0), ("rest", 0.0)):
        np.testing.assert_allclose(scene[name].vertices, ROWS + off, atol=1e-5)


def test_invalid_morph_targets_raise(tmp_path):
    writer = GltfWriter()
    targets = [{"POSITION": writer.accessor(np.zeros((2, 3), np.float32))}]
    writer.node(writer.primitive(ROWS, targets=targets), mesh={"weights": [1]}, name="mesh")
    with pytest.raises(
        FileFormatError, match=r"cannot be read as GLB: a morph target must move 3 vertices, got \(2, 3\)"
    ):
        load(tmp_path / "a.glb", writer)


def test_skin_of_a_compressed_mesh(tmp_path):
    """Joints and weights may be compressed with the positions or not."""
    DracoPy = pytest.importorskip("DracoPy")
    writer = skinned(SECOND, WHOLE)
    places = writer.content["meshes"][0]["primitives"][0]["attributes"]
    data = DracoPy.encode(ROWS.astype(np.float64), [[0, 1, 2]], quantization_bits=16, compression_level=0)
    packed = {"bufferView": writer.view(data), "attributes": {"POSITION": 0}}
    writer.content["accessors"][places["POSITION"]].pop("bufferView")
    writer.content["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": packed}
    scene = load(tmp_path / "a.glb", writer, roots=[0, 2])
    found = {tuple(corner) for corner in np.round(scene["arm"].vertices, 2) + 0.0}
    assert found == {(2.0, 2.0, 5.0), (2.0, 3.0, 5.0), (0.0, 2.0, 5.0)}

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""PLY files with an image, which a comment names, as MeshLab writes them."""

import numpy as np
import pytest
from PIL import Image

import warpvis as wv
from warpvis.errors import FileFormatError

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
FACES = [(0, 1, 2), (0, 2, 3)]
COLORS = [(200, 0, 0, 255), (0, 200, 0, 255), (0, 0, 200, 255), (9, 9, 9, 255)]
UV = np.array([(0.1, 0.1), (0.9, 0.2), (0.8, 0.7), (0.3, 0.6)])


def write(folder, *, image=True, names=("texture_u", "texture_v"), corners=None, binary=False):
    """Write a square with normals, colors, and coordinates of its vertices, or of its corners."""
    fields = [(name, "f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    fields += [(name, "u1") for name in ("red", "green", "blue", "alpha")]
    fields += [] if corners is not None else [(name, "f4") for name in names]
    rows = np.zeros(4, dtype=fields)
    for number, (point, color, uv) in enumerate(zip(POINTS, COLORS, UV, strict=True)):
        rows[number] = (*point, 0, 0, 1, *color, *(uv if corners is None else ()))
    kinds = [("count", "u1"), ("face", "i4", 3)] + ([("length", "u1"), ("uv", "f4", 6)] if corners is not None else [])
    faces = np.zeros(2, dtype=kinds)
    faces["count"], faces["face"] = 3, FACES
    if corners is not None:
        faces["length"], faces["uv"] = 6, np.reshape(corners, (2, 6))
    head = f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\n"
    head += "comment TextureFile wood board.png\n" * image + "element vertex 4\n"
    head += "".join(f"property {'float' if kind == 'f4' else 'uchar'} {name}\n" for name, kind in fields)
    head += "element face 2\nproperty list uchar int vertex_indices\n"
    head += "property list uchar float texcoord\n" * (corners is not None) + "end_header\n"
    body = rows.tobytes() + faces.tobytes()
    if not binary:
        lines = [" ".join(f"{value:g}" for item in row for value in np.ravel(item)) for row in (*rows, *faces)]
        body = "\n".join([*lines, ""]).encode()
    (folder / "a.ply").write_bytes(head.encode() + body)
    Image.new("RGB", (2, 2), (10, 200, 30)).save(folder / "wood board.png")
    return folder / "a.ply"


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("names", [("texture_u", "texture_v"), ("u", "v"), ("s", "t")])
def test_coordinates_of_vertices(tmp_path, names, binary):
    item = wv.Scene.load(write(tmp_path, names=names, binary=binary))["a"]
    shown = item.appearance
    assert (shown.materials[0].texture.image == (10, 200, 30)).all() and shown.vertex_colors is None
    np.testing.assert_allclose(shown.corner_uv(item.faces), UV[FACES], atol=1e-6)
    np.testing.assert_array_equal(item.faces, FACES)
    np.testing.assert_allclose(shown.normals, np.tile((0, 0, 1), (4, 1)))


@pytest.mark.parametrize("binary", [False, True])
def test_coordinates_of_corners_may_differ_at_a_vertex(tmp_path, binary):
    corners = np.stack([UV[list(FACES[0])], UV[list(FACES[1])] + 0.05])
    item = wv.Scene.load(write(tmp_path, corners=corners, binary=binary))["a"]
    np.testing.assert_allclose(item.appearance.corner_uv(item.faces), corners, atol=1e-6)
    np.testing.assert_allclose(item.vertices[item.faces], np.array(POINTS)[FACES])
    assert (item.appearance.materials[0].texture.image == (10, 200, 30)).all()


@pytest.mark.parametrize("corners", [None, np.zeros((2, 3, 2))])
def test_coordinates_without_an_image_keep_colors_of_vertices(tmp_path, corners):
    item = wv.Scene.load(write(tmp_path, image=False, corners=corners))["a"]
    np.testing.assert_array_equal(item.appearance.vertex_colors, COLORS)


def test_missing_images_are_a_warning(tmp_path):
    path = write(tmp_path)
    (tmp_path / "wood board.png").unlink()
    with pytest.warns(UserWarning, match=r"a.ply: left out the texture wood board.png, which was not found"):
        item = wv.Scene.load(path)["a"]
    np.testing.assert_array_equal(item.appearance.vertex_colors, COLORS)
    with pytest.raises(FileFormatError, match="wood board"):
        wv.Scene.load(path, strict=True)

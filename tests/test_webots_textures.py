# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of textures of Webots' shapes and their coordinates (src/wren/StaticMesh.cpp and TextureTransform.cpp)."""

import numpy as np
import pytest
from PIL import Image

from support.appearance_files import IMAGE, load
from support.webots_textures import ROUND, SHAPES


def by_place(scene, name):
    """Return texture coordinates with the position of each corner of an object's triangles."""
    item = scene[name]
    corners = item.vertices[item.faces].reshape(-1, 3)
    return list(zip(np.round(corners, 6).tolist(), item.appearance.corner_uv(item.faces).reshape(-1, 2), strict=True))


@pytest.mark.parametrize(("version", "info"), [("R2023b", ""), ("R2021b", 'coordinateSystem "NUE"')])
def test_webots_textures(tmp_path, version, info):
    (tmp_path / "a.wbt").write_text(SHAPES % (version, info))
    Image.fromarray(IMAGE).save(tmp_path / "tex.png")
    scene = load(tmp_path / "a.wbt")

    def upright(place):  # undo the rotation of older files
        x, y, z = place
        return place if scene.up == "z" else [x, -z, y]

    textured, plain = scene["old"].appearance.materials
    assert (textured.base_color, textured.alpha_mode) == ((1, 1, 1, 0.5), "blend")  # a texture replaces the color
    assert (textured.texture.wrap_u, textured.texture.wrap_v, textured.texture.filter) == ("clamp", "repeat", "nearest")
    np.testing.assert_array_equal(textured.texture.image, IMAGE)
    assert plain.texture is None
    rows = by_place(scene, "old")
    for place, uv in rows[: len(rows) // 2]:
        x, y, _ = upright(place)
        np.testing.assert_allclose(uv, [x / 4 + 0.5, y / 2 + 0.5], atol=1e-6)
    for place, uv in by_place(scene, "moved"):
        x, y, _ = upright(place)
        u, v = x + 0.5 + 0.125 + 0.5, y + 0.5 + 0.25
        np.testing.assert_allclose(uv, [-2 * v - 0.5, 4 * u - 0.25], atol=1e-6)
    sides = {
        (0, 1, 0): lambda x, y, z: (-x, z),
        (-1, 0, 0): lambda x, y, z: (-y, z),
        (0, 0, -1): lambda x, y, z: (x, -y),
        (0, -1, 0): lambda x, y, z: (x, z),
        (1, 0, 0): lambda x, y, z: (y, z),
        (0, 0, 1): lambda x, y, z: (x, y),
    }
    item = scene["box"]
    for places, uvs in zip(item.vertices[item.faces] / np.array([1, 2, 3]), item.appearance.uv, strict=True):
        flat = int(np.ptp(places, axis=0).argmin())
        side = tuple(round(part) for part in upright((np.eye(3)[flat] * np.sign(places[0, flat])).tolist()))
        for place, uv in zip(places, uvs, strict=True):
            np.testing.assert_allclose(uv, 0.5 + np.array(sides[side](*upright(place.tolist()))), atol=1e-6)
    with pytest.warns(UserWarning, match=r"no\.png: cannot be read as an image \(no such file\)"):
        assert scene["missing"].appearance.materials[0].texture.image.shape == (1, 1, 3)


def test_textures_of_round_shapes_and_face_sets(tmp_path):
    shapes = {
        "Cylinder": "radius 2 height 3 subdivision 8",
        "Cone": "bottomRadius 2 height 3 subdivision 8",
        "Sphere": "radius 2 subdivision 3",
        "ElevationGrid": "xDimension 3 yDimension 2 height [ 0 1 0 0 0 0 ]",
    }
    look = 'appearance PBRAppearance { baseColorMap ImageTexture { url "tex.png" } }'
    solids = [
        f'Solid {{ name "{n}" children [ Shape {{ {look} geometry {n} {{ {f} }} }} ] }}' for n, f in shapes.items()
    ]
    (tmp_path / "a.wbt").write_text(ROUND % "\n".join(solids))
    Image.fromarray(IMAGE).save(tmp_path / "tex.png")
    scene = load(tmp_path / "a.wbt")
    for name in ("Cylinder", "Cone", "Sphere"):
        item = scene[name]
        uv = item.appearance.uv
        assert np.ptp(uv[..., 0], axis=1).max() <= 0.51  # no triangle spans the whole image
        for (x, y, z), (u, v) in by_place(scene, name):
            if name == "Sphere":
                assert v == pytest.approx(0.5 + np.arcsin(z / 2) / np.pi, abs=1e-5)
                if np.hypot(x, y) > 1e-4:
                    assert (u - np.arctan2(-x, y) / (2 * np.pi) + 0.5) % 1 == pytest.approx(0.5, abs=1e-5)
        if name == "Cylinder":
            rows = [(place, uv) for place, uv in zip(item.vertices[item.faces], uv, strict=True)]
            side = [row for row in rows if np.ptp(row[0][:, 2]) > 0]
            assert len(side) == 16
            for places, uvs in side:
                np.testing.assert_allclose(uvs[:, 1], places[:, 2] / 3 + 0.5, atol=1e-6)
    for (x, y, _), uv in by_place(scene, "ElevationGrid"):
        np.testing.assert_allclose(uv, [x / 2, y], atol=1e-6)
    # A quad gives two triangles; one with a repeated point gives only one.
    assert len(scene["set"].faces) == 3
    triangle = [uv.tolist() for place, uv in by_place(scene, "set") if place[2] == 1 or uv.tolist() == [5, 6]]
    assert triangle == [[5, 6], [1, 0]]
    for (x, y, z), uv in by_place(scene, "set"):
        if z == 0 and uv.tolist() not in ([5, 6], [0, 0]):
            np.testing.assert_allclose(uv, [x, y])
    assert scene["torn"].appearance.uv is None


def test_textures_of_mirrored_shapes(tmp_path):
    shape = (
        'Shape { appearance PBRAppearance { baseColorMap ImageTexture { url "tex.png" } } geometry Plane { size 2 2 } }'
    )
    solid = f'Transform {{ scale -1 1 1 children [ Solid {{ name "mirrored" children [ {shape} ] }} ] }}'
    (tmp_path / "a.wbt").write_text(ROUND % solid)
    for (x, y, _), uv in by_place(load(tmp_path / "a.wbt"), "mirrored"):
        np.testing.assert_allclose(uv, [0.5 - x / 2, 0.5 + y / 2], atol=1e-6)

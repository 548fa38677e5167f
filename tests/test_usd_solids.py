# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Round shapes of USD stages that move are exact where their transform allows it."""

import numpy as np
import pytest

import warpvis as wv

from support import usd_stages as stages

pytest.importorskip("pxr")

SIZES = "double radius = 0.5\n    double height = 1.5\n"
BODY = '(prepend apiSchemas = ["PhysicsRigidBodyAPI"])'


def body(name, kind, *ops, more="", apis=BODY):
    """Return the text of a rigid body that is a round shape about z, with operations as for `stages.placed`."""
    sizes = SIZES if kind != "Sphere" else SIZES.splitlines()[0]
    axis = "" if kind == "Sphere" or "axis" in more else 'uniform token axis = "Z"'
    text = stages.placed(name, *ops, inner=f"    {sizes}\n    {axis}\n    {more}\n")
    return text.replace(f'def Xform "{name}"', f'def {kind} "{name}" {apis}')


def depth(scene, height=4.0):
    """Return an image from a point next to the object, of 64x64 pixels."""
    camera = wv.Camera.from_fov(64, 64, hfov=0.6)
    pose = wv.look_at((height, 0.3, 1.2), (0, 0, 0))
    return wv.render(scene, camera, pose, outputs=("depth", "points"))


def distance(kind, points, factors):
    """Return how far points of a scaled shape are from its surface before it was scaled."""
    points = points / factors
    if kind == "Sphere":
        return np.abs(np.linalg.norm(points, axis=-1) - 0.5)
    across, along = np.hypot(points[:, 0], points[:, 1]), np.abs(points[:, 2])
    if kind == "Capsule":
        return np.abs(np.hypot(across, np.maximum(along - 0.75, 0)) - 0.5)
    return np.minimum(np.abs(across - 0.5) + np.maximum(along - 0.75, 0), np.abs(along - 0.75))


@pytest.mark.parametrize("scale", [(2, 2, 2), (-1, 1, 1), (1, 0.5, 2)], ids=str)
@pytest.mark.parametrize("kind", ["Sphere", "Cylinder", "Capsule"])
def test_moving_round_shapes_are_exact(tmp_path, kind, scale):
    """Points of images lie on the true surface, also if the shape is mirrored or scaled along its axes."""
    text = body("ball", kind, ("float3", "scale", f"{scale}"))
    scene = stages.load(tmp_path, text, movable=True)
    points = depth(scene).points.numpy().reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    assert scene["/ball"].solid is not None and len(points) > 100
    assert distance(kind, points, scale).max() < 5e-6
    triangles = stages.load(tmp_path, text)
    one, other = depth(scene).depth.numpy(), depth(triangles).depth.numpy()
    both = np.isfinite(one) & np.isfinite(other)
    assert triangles["/ball"].solid is None and np.median(np.abs(one[both] - other[both])) < 2e-3


def test_static_round_shapes_are_their_triangles(tmp_path):
    """The triangles and normals of a solid are those of the same shape that has no exact surface."""
    text = body("a", "Cylinder", apis="") + body("b", "Cylinder", more='uniform token axis = "Y"', apis="")
    one, other = stages.load(tmp_path, text)
    np.testing.assert_allclose(one.vertices[:, [1, 2, 0]], other.vertices, atol=1e-6)
    np.testing.assert_allclose(one.appearance.normals[..., [1, 2, 0]], other.appearance.normals, atol=1e-6)


SHEAR = "( (1, 0, 0, 0), (0.5, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"
TRIANGLES = {
    "shear": body("a", "Sphere", ("matrix4d", "transform", SHEAR)),
    "axis": body("a", "Cylinder", more='uniform token axis = "X"'),
    "cone": body("a", "Cone"),
    "two shapes": stages.placed("a", inner=body("one", "Sphere", apis="") + body("two", "Sphere", apis="")).replace(
        'Xform "a"', f'Xform "a" {BODY}'
    ),
    "no radius": body("a", "Sphere").replace("radius = 0.5", "radius = 1e-30"),
    "no height": body("a", "Cylinder").replace("height = 1.5", "height = 0"),
    "tapered": body("a", "Cylinder_1").replace("double radius", "double radiusTop"),
}


@pytest.mark.parametrize("case", TRIANGLES)
def test_other_moving_shapes_are_triangles(tmp_path, case):
    scene = stages.load(tmp_path, TRIANGLES[case], movable=True)
    assert len(scene.movable) == 1
    assert all(item.solid is None for item in scene)


def test_shapes_that_are_movable_by_their_name_are_exact(tmp_path):
    scene = stages.load(tmp_path, body("a", "Sphere", apis="") + stages.mesh("b"), movable=["/a"])
    assert scene["/a"].solid is not None and [scene.objects[index].name for index in scene.movable] == ["/a"]


def test_welded_bodies_are_one_object(tmp_path):
    """A ball that is welded to another body is attached to it, as triangles."""
    text = f'def Xform "arm" {BODY} {{\n{stages.mesh("m")}}}\n' + body("ball", "Sphere")
    text += 'def PhysicsFixedJoint "weld" {\n    rel physics:body0 = </arm>\n    rel physics:body1 = </ball>\n}\n'
    scene = stages.load(tmp_path, text, movable=True)
    assert [scene.objects[index].name for index in scene.movable] == ["/arm/m"]
    assert scene["/ball"].solid is None and scene["/ball"].parent is not None


@pytest.mark.parametrize("scale", [3.0, (1, 2, 3)], ids=str)
def test_solids_follow_the_scale_and_the_axis_of_the_scene(tmp_path, scale):
    """The bounds are those of the static scene; a scale that is not uniform is along the scene's axes."""
    ops = ("double3", "translate", "(1, 2, 3)"), ("float", "rotateX", "30")
    text = body("a", "Capsule", *ops)
    path = stages.write(tmp_path, text, header=stages.METERS.replace('"Z"', '"Y"'))
    static, moving = (wv.Scene.load(path, scale=scale, movable=movable) for movable in (False, True))
    np.testing.assert_allclose(moving["/a"].bounds, static["/a"].bounds, atol=1e-5)
    assert (moving["/a"].solid is None) == (scale != 3.0)


def test_instances_of_bodies_share_a_solid(tmp_path):
    text = f"""
def PointInstancer "balls"
{{
    rel prototypes = [</balls/ball>]
    int[] protoIndices = [0, 0, 0]
    point3f[] positions = [(0, 0, 0), (2, 0, 0), (4, 0, 0)]
    {body("ball", "Sphere")}
}}
"""
    scene = stages.load(tmp_path, text, movable=True)
    assert [item.name for item in scene] == [f"/balls/{number}/ball" for number in range(3)]
    assert len({id(item.mesh) for item in scene}) == 1 and len(scene.movable) == 3
    assert all(item.solid is not None for item in scene)
    np.testing.assert_allclose(scene["/balls/2/ball"].pose[:3], (4, 0, 0))


def test_exact_shapes_have_their_color(tmp_path):
    color = "color3f[] primvars:displayColor = [(1, 0, 0)]"
    scene = stages.load(tmp_path, body("a", "Sphere", more=color), movable=True)
    camera, pose = wv.Camera.from_fov(8, 8, hfov=0.1), wv.look_at((4, 0, 0), (0, 0, 0))
    red, green, blue = wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0, 4, 4, :3].tolist()
    assert red > 200 and green == blue == 0

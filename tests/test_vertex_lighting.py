# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Light at vertices (`lighting="vertex"`), compared with a double-precision reference and MuJoCo's pictures."""

import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import reference_vertex_lighting
import trimesh

import warpvis as wv
import warpvis.rendering._renderer as rendering
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import BatchRenderer, Renderer
from warpvis.scene.lights import Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.solids import capsule, cylinder, sphere

CAMERA = wv.Camera.from_fov(40, 30, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
OUTPUTS = ("color", "points", "normals", "segmentation")
GLOSSY = Material(base_color=(0.7, 0.5, 0.3), specular=(0.5, 0.6, 0.7), shininess=12.0, emission=(0.02, 0.0, 0.05))
SPOT = Light("spot", position=(0.8, -1.0, 2.0), direction=(-0.8, 1.0, -2.0), exponent=8.0, outer_angle=0.6)
HEADLIGHT = Light("headlight", color=(0.5, 0.5, 0.4), ambient=(0.3, 0.3, 0.3), specular=(0.3, 0.3, 0.3))
BRIGHT = Light("point", position=(0.4, -0.8, 1.2), color=(3.0, 2.0, 1.0), attenuation=(0.4, 0.3, 0.2))
LINEAR = Light("directional", direction=(0.2, 0.6, -1), color_space="linear", falloff="gltf", intensity=2.5)
MIXES = {"spot": (SPOT, HEADLIGHT), "bright": (BRIGHT, HEADLIGHT), "linear": (SPOT, LINEAR)}


def placed(mesh, pose=(0, 0, 0, 0, 0, 0, 1)):
    """Return the corners of a mesh's triangles in the world, (m, 3, 3)."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float64))
    return np.asarray(mesh.vertices)[mesh.faces] @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("mix", MIXES)
def test_triangles_match_reference(mix, device):
    """A flat box, a static floor, and a moved ball with smooth normals."""
    box, floor, ball = (
        trimesh.creation.box((1.2, 1, 0.5)),
        trimesh.creation.box((6, 6, 0.1)),
        trimesh.creation.icosphere(1),
    )
    place, pose = (0, 0, -0.6, 0, 0, 0, 1), np.array([0.3, 0.2, 0.7, 0.0, 0.6, 0.0, 0.8])
    scene = wv.Scene(device=device)
    scene.lights = MIXES[mix]
    scene.add(box, name="box", appearance=GLOSSY)
    scene.add(floor, name="floor", pose=place, appearance=GLOSSY)
    ball.apply_scale(0.5)
    scene.add(ball, name="ball", movable=True, appearance=Appearance((GLOSSY,), normals=ball.vertices))
    views = wv.render(scene, CAMERA, POSE, outputs=OUTPUTS, lighting="vertex", shadows=False, object_poses=pose[None])
    corners = placed(ball, pose)
    normals = corners - pose[:3]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    triangles = [(placed(box), None), (placed(floor, place), None), (corners, normals)]
    expected = reference_vertex_lighting.shade_vertex_lit_colors(MIXES[mix], [GLOSSY] * 3, POSE, views, triangles)
    error = np.abs(views.color.numpy() - expected).max(axis=-1)
    seen = views.segmentation.numpy()
    assert all((seen == number).sum() > 20 for number in range(3))
    assert (error <= 1).mean() > 0.995  # others are at edges, where the nearest triangle may be another one
    pixels = wv.render(scene, CAMERA, POSE, outputs=("color",), shadows=False, object_poses=pose[None])
    assert np.abs(pixels.color.numpy().astype(int) - views.color.numpy()).max() > 20


@pytest.mark.parametrize("count", [2, 7, 8])
def test_shadows_are_those_of_pixels(count, device, monkeypatch):
    """Each light with shadows is interpolated by itself, and blocked at pixels.

    On CPU cores, light at corners is cached with up to 7 such lights.
    """
    box, floor, place = (
        trimesh.creation.box((0.6, 0.6, 0.6)),
        trimesh.creation.box((4, 4, 0.1)),
        (0, 0, -0.6, 0, 0, 0, 1),
    )
    scene = wv.Scene(device=device)
    dim = [replace(BRIGHT, color=(0.1, 0.2, 0.3), position=(0.3 * k - 1, 0.4, 1.5)) for k in range(count - 2)]
    scene.lights = (SPOT, BRIGHT, *dim, HEADLIGHT)
    scene.add(box, name="box", appearance=GLOSSY)
    scene.add(floor, name="floor", pose=place, appearance=GLOSSY)
    found, cast_shadows = [], rendering.cast_shadows
    monkeypatch.setattr(rendering, "cast_shadows", lambda *inputs: found.append(cast_shadows(*inputs)) or found[0])
    views = wv.render(scene, CAMERA, POSE, outputs=OUTPUTS, lighting="vertex")
    shadows = found[0].numpy()
    assert len(shadows) == count and 0.05 < (shadows == 0).mean() < 0.9
    triangles = [(placed(box), None), (placed(floor, place), None)]
    expected = reference_vertex_lighting.shade_vertex_color_rows(
        scene.lights, [GLOSSY] * 2, POSE, views, triangles, shadows
    )
    assert (np.abs(views.color.numpy() - expected).max(axis=-1) <= 1).mean() > 0.995


def test_texture_multiplies_interpolated_light(device):
    corners, faces = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    gray, colors = Texture(np.full((2, 2, 3), 102, dtype=np.uint8)), []
    for texture in (None, gray):
        scene = wv.Scene(device=device)
        material = Material(base_color=(0.9, 0.8, 0.5), texture=texture)
        scene.add(
            (np.array(corners, dtype=float), np.array(faces)), appearance=Appearance((material,), uv=np.zeros((4, 2)))
        )
        scene.lights = (BRIGHT,)
        views = wv.render(scene, CAMERA, POSE, outputs=OUTPUTS, lighting="vertex")
        colors.append(views.color.numpy()[views.segmentation.numpy() == 0].astype(float))
    assert len(colors[0]) > 50 and np.ptp(colors[0][:, 0]) > 10
    assert np.abs(colors[0] * 0.4 - colors[1]).max() <= 1


def quads(edges_u, edges_v, of):
    """Return the triangles of cells, split as by OpenGL: from the second to the last corner."""
    corners = []
    for u in itertools.pairwise(edges_u):
        for v in itertools.pairwise(edges_v):
            a, b, c, d = (np.array(of(u[i], v[j])) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
            corners += [(a, b, d), (b, c, d)]
    return np.array(corners, dtype=float)


BOX_SIDES = [
    lambda u, v, s: (u * s[0], v * s[1], s[2]),
    lambda u, v, s: (s[0], u * s[1], v * s[2]),
    lambda u, v, s: (u * s[0], -s[1], v * s[2]),
    lambda u, v, s: (u * s[0], -v * s[1], -s[2]),
    lambda u, v, s: (-s[0], u * s[1], -v * s[2]),
    lambda u, v, s: (u * s[0], s[1], -v * s[2]),
]


def box_cells(half, count):
    """Return the triangles of a box as `makeBuiltin` of MuJoCo's render_context.c lists them: top, right, front, ..."""
    edges = np.linspace(-1, 1, count + 1)
    return np.concatenate([quads(edges, edges, lambda u, v, side=side: side(u, v, half)) for side in BOX_SIDES])


@pytest.mark.parametrize("case", ["static", "moved", "scaled", "below"])
def test_cells_of_boxes_match_reference(case, device):
    """A box of MuJoCo is lit at the corners of 5x5 cells on each side."""
    joint = "" if case == "static" else "<freejoint/>"
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <visual><quality numquads="5"/><headlight active="0"/></visual><worldbody>
      <light type="spot" pos=".8 -1 2" dir="-.8 1 -2" exponent="8" cutoff="34"/>
      <light type="spot" pos=".8 -1 -2" dir="-.8 1 2" cutoff="34" exponent="3" diffuse=".3 .5 .7"/>
      <body pos=".2 .1 .1" euler="20 -10 30">{joint}
        <geom name="box" type="box" size=".6 .5 .4" rgba=".7 .6 .5 1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    half, options = np.array([0.6, 0.5, 0.4]), {}
    if case == "scaled":
        half = np.array([0.9, 0.4, 0.3])
        options = {"model": {"geom_size": half[None, None].astype(np.float32)}}
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = (0.2, 0.1, 0.1), 2.5
    camera.azimuth, camera.elevation = 130, 35 if case == "below" else -35
    batch = BatchRenderer(
        model,
        height=30,
        width=40,
        outputs=OUTPUTS,
        lighting="vertex",
        shadows=False,
        resizable="all" if case == "scaled" else (),
        device=device,
    )
    views = batch.render(data, cameras=[camera], **options)
    seen = views.segmentation.numpy() == 0
    assert seen.sum() > 200
    corners = box_cells(half, 5) @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    pose = pose_of(camera)
    material = batch.scene["box"].appearance.materials[0]
    expected = reference_vertex_lighting.shade_vertex_lit_colors(
        batch.scene.lights, [material], pose, views, [(corners, None)]
    )
    error = np.abs(views.color.numpy() - expected).max(axis=-1)[seen]
    assert (error <= 1).mean() > 0.98 and np.ptp(views.color.numpy()[seen]) > 40


def pose_of(camera):
    """Return the pose of a free camera, x right, y down, z forward."""
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    target = np.array(camera.lookat)
    return wv.look_at(target - camera.distance * forward, target)


SOLIDS = {
    "ball": (sphere(0.8), [1.0, 1.0, 1.0]),
    "ellipsoid": (sphere(0.8), [1.2, 0.7, 0.6]),
    "cylinder": (cylinder(0.6, 0.4), [1.0, 1.0, 1.0]),
    "capsule": (capsule(0.4, 0.5), [1.1, 1.1, 1.1]),
}


def revolved_cells(kind, slices=28, stacks=16):
    """Return triangles of a round solid of unit size, and their normals, as MuJoCo's render_context.c lists them."""
    around = np.linspace(0, 2 * np.pi, slices + 1)
    round_, flat = [], []

    def add(edges, of, normal_of):
        round_.append(quads(around, edges, of))
        flat.append(quads(around, edges, normal_of))

    if kind == "cylinder":
        half = 0.4 / 0.6
        add(
            np.linspace(-half, half, stacks + 1),
            lambda u, z: (np.cos(u), np.sin(u), z),
            lambda u, z: (np.cos(u), np.sin(u), 0),
        )
        radii = np.linspace(1, 0, stacks // 2 + 1)
        add(radii, lambda u, r: (r * np.cos(u), r * np.sin(u), half), lambda u, r: (0, 0, 1))
        add(radii[::-1], lambda u, r: (r * np.cos(u), r * np.sin(u), -half), lambda u, r: (0, 0, -1))
    else:
        half = 0.5 / 0.4 if kind == "capsule" else 0.0
        angles = np.linspace(0, np.pi / 2, stacks // 2 + 1)
        if half:
            heights = np.linspace(-half, half, stacks + 1)
            add(heights, lambda u, z: (np.cos(u), np.sin(u), z), lambda u, z: (np.cos(u), np.sin(u), 0))
        for edges, middle in ((angles, half), (-angles[::-1], -half)):
            add(
                edges,
                lambda u, v, middle=middle: (np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v) + middle),
                lambda u, v: (np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)),
            )
    corners, normals = np.concatenate(round_), np.concatenate(flat)
    is_whole = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1) > 1e-9
    return corners[is_whole], normals[is_whole]


@pytest.mark.parametrize("kind", SOLIDS)
def test_cells_of_round_solids_match_reference(kind, device):
    """Movable solids are lit at the corners of 28 slices and 16 stacks; their pixels are on the exact surface."""
    solid, scales = SOLIDS[kind]
    pose = np.array([0.1, 0.2, 0.2, 0.3, 0.2, 0.1, 0.9])
    pose[3:] /= np.linalg.norm(pose[3:])
    scene = wv.Scene(device=device)
    scene.add(solid, name="solid", movable=True, appearance=GLOSSY)
    scene.lights = MIXES["spot"]
    options = {} if kind in ("ball", "cylinder") else {"object_scales": np.array([scales])}
    options |= {"object_poses": pose[None], "shadows": False, "outputs": OUTPUTS}
    views = wv.render(scene, CAMERA, POSE, lighting="vertex", **options)
    factors = solid.radii * scales
    corners, normals = revolved_cells(kind)
    rotation = poses_to_matrices(pose)[:3, :3]
    normals = normals / factors @ rotation.T
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    triangles = [(corners * factors @ rotation.T + pose[:3], normals)]
    expected = reference_vertex_lighting.shade_vertex_lit_colors(scene.lights, [GLOSSY], POSE, views, triangles)
    seen = views.segmentation.numpy() == 0
    error = np.abs(views.color.numpy() - expected).max(axis=-1)[seen]
    # Surfaces differ by 0.6 % of the radius, and weights are linear in angles.
    assert seen.sum() > 100 and np.quantile(error, 0.95) <= 3
    pixels = wv.render(scene, CAMERA, POSE, **options).color.numpy()
    assert trimmed(np.abs(pixels[seen] - expected[seen]).max(axis=-1)) > 1.2 * trimmed(error)


SPOTS = """<mujoco><visual><map zfar="8"/><quality numquads="{quads}" numslices="20" numstacks="14" offsamples="0"/>
  <global offwidth="120" offheight="90"/></visual><statistic extent="2"/><asset>
  <mesh name="wedge" vertex="0 0 0  .5 0 0  .5 .5 0  0 .5 0  0 .3 .4  .5 .3 .4"/>
  <material name="floor" specular="1" shininess=".3" texrepeat="3 2"/></asset><worldbody>
  <light type="spot" pos=".3 -.4 1.4" dir="-.2 .3 -1.4" cutoff="40" exponent="5" specular=".6 .6 .6"/>
  <light pos="-1 -1 2" dir="1 1 -2" type="directional" diffuse=".2 .3 .4" castshadow="false"/>
  <camera name="eye" pos=".2 -1.7 1.5" xyaxes="1 .1 0 -.07 .7 .7"/>{geom}</worldbody></mujoco>"""
GEOMS = {
    "box": '<body euler="5 10 20"><freejoint/><geom type="box" size=".6 .5 .2"/></body>',
    "plane": '<geom type="plane" size="1 .9 .13" euler="0 5 20"/>',
    "endless": '<geom type="plane" size="0 0 .1" material="floor"/>',
    "half endless": '<geom type="plane" size="0 .8 .1"/>',
    "sphere": '<geom type="sphere" size=".6"/>',
    "ellipsoid": '<geom type="ellipsoid" size=".7 .5 .3"/>',
    "capsule": '<geom type="capsule" size=".3 .4" euler="20 70 0"/>',
    "cylinder": '<geom type="cylinder" size=".6 .2" euler="10 0 0"/>',
    "mesh": '<geom type="mesh" mesh="wedge" euler="0 0 20"/>',
}


@pytest.mark.gl
@pytest.mark.parametrize("kind", GEOMS)
def test_pictures_match_mujoco(kind):
    """Away from silhouettes, flat geoms have MuJoCo's colors, and round ones almost."""
    model = mujoco.MjModel.from_xml_string(SPOTS.format(quads=3, geom=GEOMS[kind]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shadow = int(mujoco.mjtRndFlag.mjRND_SHADOW)
    with mujoco.Renderer(model, 90, 120) as renderer:
        for _ in range(2):  # an endless plane is moved to the position of the camera before
            renderer.update_scene(data, "eye")
        renderer.scene.flags[shadow] = 0
        wanted = renderer.render().astype(int)
    errors = {}
    for lighting in ("vertex", "pixel"):
        renderer = Renderer(model, 90, 120, lighting=lighting) if lighting == "pixel" else Renderer(model, 90, 120)
        renderer.update_scene(data, "eye")
        renderer.scene.flags[shadow] = 0
        shown = renderer.render().astype(int)
        seen = eroded((shown.max(axis=-1) > 0) & (wanted.max(axis=-1) > 0))
        errors[lighting] = np.abs(shown - wanted).max(axis=-1)[seen]
    assert len(errors["vertex"]) > 300
    is_round = kind in ("sphere", "ellipsoid", "capsule", "cylinder")  # of 20 slices; here, surfaces are exact
    assert trimmed(errors["vertex"]) < (1.8 if is_round else 0.1)
    assert trimmed(errors["pixel"]) > (1.2 if is_round else 4) * trimmed(errors["vertex"])


def trimmed(errors):
    """Return the mean without the largest tenth, which are at edges within a geom."""
    return np.sort(errors, axis=None)[: int(0.9 * errors.size)].mean()


def eroded(mask, reach=2):
    """Return the pixels whose neighborhood is in a mask."""
    padded, inside = np.pad(mask, reach), mask.copy()
    for dy in range(2 * reach + 1):
        for dx in range(2 * reach + 1):
            inside &= padded[dy : dy + mask.shape[0], dx : dx + mask.shape[1]]
    return inside


def test_resized_boxes_keep_cells():
    """Cells follow `geom_size`, which makes a new object, and then changes its vertices."""
    model = mujoco.MjModel.from_xml_string(SPOTS.format(quads=3, geom=GEOMS["box"]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, 60, 80)
    for size in ((0.6, 0.5, 0.2), (0.5, 0.6, 0.3), (0.7, 0.4, 0.25)):
        model.geom_size[0] = size
        renderer.update_scene(data, "eye")
        other = Renderer(model, 60, 80)
        other.update_scene(data, "eye")
        np.testing.assert_allclose(renderer.render().astype(int), other.render(), atol=1)


def test_lighting_is_chosen_explicitly():
    scene = wv.Scene()
    scene.add(trimesh.creation.box(), name="box")
    scene.lights = (SPOT,)
    assert wv.Renderer(scene, CAMERA).lighting == "pixel"
    with pytest.raises(wv.WarpvisError, match='lighting must be "pixel" or "vertex", got \'corner\''):
        wv.Renderer(scene, CAMERA, lighting="corner")
    default = wv.render(scene, CAMERA, POSE, outputs=("color",)).color.numpy()
    np.testing.assert_array_equal(default, wv.render(scene, CAMERA, POSE, outputs=("color",), lighting="pixel").color)
    assert (default != wv.render(scene, CAMERA, POSE, outputs=("color",), lighting="vertex").color.numpy()).any()


def test_materials_of_other_shadings_are_refused():
    scene = wv.Scene()
    scene.add(trimesh.creation.box(), name="box", appearance=Material("tin", shading="pbr"))
    scene.lights = (SPOT,)
    with pytest.raises(wv.WarpvisError, match='lighting must be "pixel" for materials of the shadings "pbr"'):
        wv.render(scene, CAMERA, POSE, outputs=("color",), lighting="vertex")

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Skies behind surfaces and haze, compared with a double-precision reference and MuJoCo's pictures."""

import pickle

import mujoco
import numpy as np
import pytest
import reference_sky
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.cameras import LensCamera, OrthographicCamera, Rays, WideCamera
from warpvis.cameras.lenses import KannalaBrandt, OpenCVPinhole
from warpvis.errors import FileFormatError, SceneError
from warpvis.mujoco import camera_from_mujoco, camera_poses, scene_from_mujoco
from warpvis.scene.lights import Background, Haze, read_light
from warpvis.scene.materials import Texture
from warpvis.scene.world_appearances import WorldAppearances

RNG = np.random.default_rng(5)
FACES = tuple(Texture(RNG.integers(0, 256, (13, 13, 3), dtype=np.uint8)) for _ in range(6))
TURN = tuple(map(tuple, Rotation.from_euler("xyz", (0.4, 1.1, -0.7)).as_matrix().tolist()))
HAZE = Haze((0.9, 0.5, 0.3), radius=14.0, width=0.6, position=(0, 0, -1.5), normal=(0.05, -0.02, 1.0))
SKIES = {
    "cube": Background(sky=FACES, world_to_cube=TURN),
    "linear cube": Background(sky=tuple(Texture(face.image, color_space="linear") for face in FACES)),
    "panorama": Background(panorama=Texture(RNG.integers(0, 256, (11, 30, 3), dtype=np.uint8)), world_to_cube=TURN),
    "light": Background(panorama=RNG.uniform(0, 5, (16, 32, 3)) ** 2, exposure=0.1, world_to_cube=TURN),
    "gradient": Background(gradient=((0.1, 0.2, 0.8), (0.9, 0.8, 0.7), (0.2, 0.1, 0.0)), world_to_cube=TURN),
    "linear gradient": Background(gradient=((0.1, 0.2, 0.8), (0.9, 3.0, 0.0)), color_space="linear"),
    "haze": Background(sky=FACES, world_to_cube=TURN, haze=HAZE),
}
POSE = np.array(wv.look_at((2.5, -2.0, 1.2), (0.0, 0.0, 0.3)))
PINHOLE = wv.Camera(24, 18, 19.0, 21.0, 11.5, 8.2)
AXES = np.eye(3)


def scene_with(background, device):
    """Return a scene of a box above a ground of 40 m."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1.0, 1.2, 0.9)), name="box", appearance=(0.9, 0.3, 0.2))
    scene.add(trimesh.creation.box((60, 60, 0.1)), pose=(0, 0, -1.55, 0, 0, 0, 1), appearance=(0.2, 0.6, 0.3))
    scene.background = background
    return scene


def adjacent(camera, rays):
    """Return the rays of adjacent pixels: of a pinhole; or at the same angle in all directions; or all parallel."""
    size = camera.pixel_size()
    if camera.ray_model == "pinhole":
        return [rays + size[k] * AXES[k] for k in (0, 1)]
    if camera.ray_model == "parallel":
        return [rays, rays]
    away = np.where(np.abs(rays[..., 1:2]) < 0.9, AXES[1], AXES[0])
    right = np.cross(rays, away)
    right = right / np.linalg.norm(right, axis=-1, keepdims=True)
    return [rays + size[0] * right, rays + size[1] * np.cross(rays, right)]


def check_views(camera, background, device, poses, *, exclude=None):
    """Compare the color and albedo of all views with the reference, and return the colors."""
    scene, outputs = scene_with(background, device), ("color", "albedo", "segmentation", "points")
    views = wv.render(scene, camera, poses, outputs=outputs, exclude=exclude)
    scene.background = Background()
    plain = wv.render(scene, camera, poses, outputs=("color",), exclude=exclude).color.numpy()
    rays = camera.rays.reshape(camera.height, camera.width, 3)
    if camera.ray_model == "table":
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    steps = adjacent(camera, rays)
    shown = views.color.numpy()
    for view, pose in enumerate(poses):
        images = [
            getattr(views, name).numpy()[view].reshape(*rays.shape[:2], *tail)
            for name, tail in (("segmentation", ()), ("points", (3,)))
        ]
        before = plain[view].reshape(rays.shape)
        expected = reference_sky.paint_sky(background, pose, rays, steps, *images, before)
        error = np.abs(shown[view].reshape(rays.shape) - expected).max(axis=-1)
        assert np.quantile(error, 0.99) <= 1, error.max()
        assert error.max() <= 4  # texels whose levels or places differ by rounding
        is_empty = images[0] < 0
        assert 0.05 < is_empty.mean() < 1
        if background.haze is None:
            np.testing.assert_array_equal(shown[view].reshape(rays.shape)[~is_empty], before[~is_empty])
    np.testing.assert_array_equal(views.albedo.numpy(), shown)  # without lights
    return shown


@pytest.mark.parametrize("name", SKIES)
def test_sky_matches_reference(name, device):
    other = wv.look_at((-3.0, 1.0, 4.0), (0.0, 9.0, 2.0))
    shown = check_views(PINHOLE, SKIES[name], device, np.array([POSE, other]))
    assert np.unique(shown.reshape(-1, 3), axis=0).shape[0] > 10


CAMERAS = {
    "lens": LensCamera(OpenCVPinhole(15.0, 16.0, 9.5, 7.0, (-0.2, 0.05, 0.01, -0.02, 0.0)), 20, 15),
    "panorama": WideCamera(24, 12, 6.28),
    "rays": Rays(Rotation.random(60, rng=3).apply([1.0, 0, 0]).reshape(6, 10, 3)),
    "list": Rays(Rotation.random(40, rng=4).apply([1.0, 0, 0])),
    "origins": Rays(
        Rotation.random(40, rng=4).apply([1.0, 0, 0]).reshape(4, 10, 3), origins=RNG.uniform(-0.2, 0.2, (4, 10, 3))
    ),
    "body axes": Rays(Rotation.random(60, rng=3).apply([1.0, 0, 0]).reshape(6, 10, 3), axes="ros_body"),
}


@pytest.mark.smoke("*-lens", "*-list")
@pytest.mark.parametrize("name", CAMERAS)
def test_sky_of_every_camera(name, device):
    check_views(CAMERAS[name], SKIES["cube"], device, POSE[None])
    check_views(CAMERAS[name], SKIES["light"], device, POSE[None])


def test_parallel_rays_see_one_point_of_the_sky(device):
    camera = OrthographicCamera.from_extent(16, 12, across=3.0)
    pose = np.array(wv.look_at((0.0, -3.0, 0.5), (0.0, 0.0, 0.5)))
    shown = check_views(camera, SKIES["cube"], device, pose[None], exclude=["object_1"])[0]
    assert len(np.unique(shown[0], axis=0)) == 1


def test_sky_at_image_points(device):
    scene = scene_with(SKIES["cube"], device)
    lens = LensCamera(KannalaBrandt(9.0, 9.0, 12.0, 9.0, (0.0,) * 4), 24, 18)
    for camera in (PINHOLE, lens):
        renderer = wv.Renderer(scene, camera, outputs=("color",))
        whole = renderer.render(POSE).color.numpy()[0]
        y, x = np.mgrid[:18, :24]
        points = np.stack([x, y], axis=-1).reshape(1, -1, 2) + 0.5
        same = renderer.render_at(POSE, points).color.numpy()[0].reshape(whole.shape)
        np.testing.assert_array_equal(same, whole)
        outside = renderer.render_at(POSE, [[[-3.0, 4.0], [np.nan, 1.0], [3.0, 4.0]]]).color.numpy()[0]
        assert (outside[:2] == 0).all()
        assert outside[2].any()


def test_pixels_without_a_ray_stay_black(device):
    with pytest.warns(wv.errors.IntrinsicsWarning):
        camera = LensCamera(KannalaBrandt(6.0, 6.0, 12.0, 9.0, (0.0,) * 4), 40, 30)
    assert camera.mask.any()
    shown = wv.render(scene_with(SKIES["gradient"], device), camera, POSE, outputs=("color",)).color.numpy()[0]
    assert (shown[camera.mask] == 0).all()
    assert (shown[~camera.mask] != 0).any(axis=-1).all()


def test_worlds_and_exclude(device):
    scene = scene_with(SKIES["cube"], device)
    scene.add(trimesh.creation.icosphere(), name="ball", pose=(0, 0, 1, 0, 0, 0, 1), movable=True)
    worlds = np.tile([0, 0, 1, 0, 0, 0, 1.0], (2, 1, 1))
    worlds[1, 0, :3] = 0, 0, -50
    shown = wv.render(scene, PINHOLE, np.tile(POSE, (2, 1)), object_poses=worlds, outputs=("color", "segmentation"))
    away = wv.render(scene, PINHOLE, POSE, exclude=["ball"], outputs=("color",)).color.numpy()[0]
    np.testing.assert_array_equal(shown.color.numpy()[1], away)
    is_ball = shown.segmentation.numpy()[0] == 2
    assert is_ball.sum() > 20
    np.testing.assert_array_equal((shown.color.numpy()[0] == away).all(axis=-1), ~is_ball)


def test_edges_of_cubes_are_seamless(device):
    """A cube map of a smooth function of the direction has no steps, also where its texels are larger than pixels."""
    size = 6
    at = (2 * np.arange(size) + 1) / size - 1
    right, down = np.meshgrid(at, at)
    faces = []
    for side in range(6):
        forward = np.cross(reference_sky.DOWN[side], reference_sky.RIGHT[side])
        rays = forward + right[..., None] * reference_sky.RIGHT[side] + down[..., None] * reference_sky.DOWN[side]
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        faces.append(Texture(np.rint(127.5 * (rays + 1)).astype(np.uint8)))
    scene = scene_with(Background(sky=tuple(faces)), device)
    camera = wv.Camera.from_fov(160, 120, hfov=1.6)
    poses = [
        wv.look_at((0, 0, 40.0), np.array([0, 0, 40.0]) + way) for way in ((1, 1, 0.9), (-1, 1, 0.1), (1, -0.1, 1))
    ]
    for shown in wv.render(scene, camera, np.array(poses), outputs=("color",)).color.numpy().astype(int):
        steps = [np.abs(np.diff(shown[:60], axis=axis)).max() for axis in (0, 1)]
        assert 1 <= max(steps) <= 3  # with images of their own, up to 20


def test_skies_of_worlds(device):
    """Each world has the sky that a scene with its background has; -1 is the scene's own."""
    skies = [SKIES["cube"], SKIES["light"], Background((0.2, 0.5, 0.9)), SKIES["haze"], SKIES["linear gradient"]]
    poses, chosen = np.tile(POSE, (7, 1)), np.array([3, -1, 0, 1, 2, 4, 0], dtype=np.int32)
    for own in (SKIES["panorama"], Background((0.7, 0.1, 0.2)), None):
        scene = scene_with(own, device)
        appearances = WorldAppearances(skies=skies, world_skies=chosen)
        shown = wv.render(scene, PINHOLE, poses, outputs=("color",), appearances=appearances).color.numpy()
        turned = WorldAppearances(skies=skies, world_skies=chosen[::-1].copy())
        index = np.arange(7, dtype=np.int32)[::-1].copy()
        same = wv.render(scene, PINHOLE, poses, outputs=("color",), appearances=turned, world_index=index)
        np.testing.assert_array_equal(same.color.numpy(), shown)
        for world, number in enumerate(chosen):
            scene.background = own if number < 0 else skies[number]
            alone = wv.render(scene, PINHOLE, POSE, outputs=("color",)).color.numpy()[0]
            np.testing.assert_array_equal(shown[world], alone)
            scene.background = own
    assert len(np.unique(shown.reshape(7, -1), axis=0)) == 6


def test_sky_of_all_worlds_and_colors_of_others(device):
    scene = scene_with(SKIES["panorama"], device)
    colors = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], dtype=np.float32)
    poses = np.tile(POSE, (2, 1))

    def render(**fields):
        return wv.render(
            scene, PINHOLE, poses, outputs=("color",), appearances=WorldAppearances(**fields)
        ).color.numpy()

    one = render(skies=[SKIES["cube"]], world_skies=[0])
    scene.background = SKIES["cube"]
    np.testing.assert_array_equal(one, wv.render(scene, PINHOLE, poses, outputs=("color",)).color.numpy())
    mixed = render(skies=[SKIES["light"]], world_skies=[-1, 0], backgrounds=colors)
    np.testing.assert_array_equal(mixed[0], render(backgrounds=colors)[0])
    scene.background = SKIES["light"]
    np.testing.assert_array_equal(mixed[1], wv.render(scene, PINHOLE, POSE, outputs=("color",)).color.numpy()[0])


@pytest.mark.parametrize("name", ["cube", "light", "haze"])
def test_same_bytes_for_all_numbers_of_threads(name):
    scene = scene_with(SKIES[name], "cpu")
    camera = wv.Camera.from_fov(301, 97, hfov=1.3)
    expected = wv.Renderer(scene, camera, outputs=("color",), threads=1).render(POSE).color.numpy()
    for threads in (2, 5):
        renderer = wv.Renderer(scene, camera, outputs=("color",), threads=threads)
        for _ in range(3):
            np.testing.assert_array_equal(renderer.render(POSE).color.numpy(), expected)


def test_sky_can_change_and_travels_with_the_scene():
    scene = scene_with(SKIES["gradient"], "cpu")
    first = wv.render(scene, PINHOLE, POSE, outputs=("color",)).color.numpy()
    scene.background = SKIES["haze"]
    second = wv.render(scene, PINHOLE, POSE, outputs=("color",)).color.numpy()
    assert (first != second).any()
    for same in (scene.to("cpu"), pickle.loads(pickle.dumps(scene))):
        np.testing.assert_array_equal(wv.render(same, PINHOLE, POSE, outputs=("color",)).color.numpy(), second)


def test_bright_light_is_clipped_after_filtering():
    """A sun of one texel keeps its share of the light where several texels meet in a pixel."""
    light = np.zeros((64, 128, 3), dtype=np.float32)
    light[32, 64] = 640.0
    scene = scene_with(Background(panorama=light), "cpu")
    pose = wv.look_at((0, 0, 40.0), (100.0, 0.0, 40.0))  # along x, the center of the panorama
    camera = wv.Camera.from_fov(5, 5, hfov=1.2)
    shown = wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0]
    assert (shown[2, 2] == 255).all()  # a pixel covers about 25 texels, with a mean above 1
    assert (shown[0, 0] == 0).all()


def rgbe(light):
    """Return light as Radiance's bytes: mantissas of 8 bits, and an exponent of 2 with a bias of 128."""
    exponent = np.frexp(light.max(axis=-1))[1]
    mantissa = np.floor(np.ldexp(light, 8 - exponent[..., None]))
    return np.concatenate([mantissa, exponent[..., None] + 128], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("is_packed", [False, True])
def test_light_of_radiance_files(is_packed, tmp_path):
    """Rows are plain, or each of their four channels is in runs of literal bytes (Radiance's "File Formats")."""
    pytest.importorskip("cv2")
    light = np.random.default_rng(3).uniform(0.01, 40, (7, 20, 3)) ** 2
    rows = rgbe(light)
    if is_packed:
        packed = [
            bytes([2, 2, 0, 20]) + b"".join(bytes([20]) + row[:, channel].tobytes() for channel in range(4))
            for row in rows
        ]
        body = b"".join(packed)
    else:
        body = rows.tobytes()
    path = tmp_path / "sky.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 7 +X 20\n" + body)
    found = read_light(path)
    assert found.dtype == np.float32 and found.flags.c_contiguous
    np.testing.assert_allclose(found, light, rtol=0, atol=light.max(axis=-1, keepdims=True).max() / 128)
    assert (np.abs(found - light) <= light.max(axis=-1, keepdims=True) / 128).all()
    shown = Background(panorama=found, exposure=0.001).panorama
    np.testing.assert_array_equal(shown, found)


def test_files_without_light_are_rejected(tmp_path):
    pytest.importorskip("cv2")
    picture, empty, damaged = (tmp_path / name for name in ("sky.png", "empty.hdr", "damaged.hdr"))
    Image.fromarray(np.zeros((4, 8, 3), dtype=np.uint8)).save(picture)
    empty.write_bytes(b"")
    damaged.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 2000000\n")
    for path, said in (
        (picture, "must be an image of floats, such as Radiance's .hdr, got uint8"),
        (empty, "must be an image of floats, such as Radiance's .hdr, got no known format"),
        (damaged, "cannot be read as an image of light"),
        (tmp_path / "none.hdr", "none.hdr: cannot be read: No such file"),
    ):
        with pytest.raises(FileFormatError, match=said):
            read_light(path)


def test_haze_of_flat_ground():
    """Without relief, opacity depends on the slope alone: 0 at the horizon and at the near end, 1 at the peak."""
    haze = Haze((1.0, 1.0, 1.0), radius=100.0, width=0.5)
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((2000, 2000, 1)), pose=(0, 0, -0.5, 0, 0, 0, 1), appearance=(0.0, 0.0, 0.0))
    scene.background = Background(gradient=((0, 0, 0), (0, 0, 0)), haze=haze)
    eye = 2.0
    for height in (0.001, haze.peak, 0.999):
        slope = eye * (1 - height) / (100 * (1 - 0.5 * (1 - height)))
        rays = Rays([np.array([1.0, 0, -slope]) / np.hypot(1, slope)], axes="ros_body")
        shown = wv.render(scene, rays, (0, 0, eye, 0, 0, 0, 1), outputs=("color",), convention="ros_body")
        wanted = {0.001: 0.001 / haze.peak, 0.999: 0.001 / (1 - haze.peak)}.get(height, 1.0)
        assert abs(int(shown.color.numpy()[0, 0, 0]) - 255 * wanted) <= 1


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Background(sky=FACES, gradient=((0, 0, 0), (1, 1, 1))), "must have at most one of sky, panorama and"),
        (lambda: Background(gradient=((0, 0, 0),)), "gradient of a background must be at least two and at most 4096"),
        (
            lambda: Background(gradient="blue"),
            "gradient of a background must be at least two colors or none",
        ),
        (lambda: Background(gradient=((0, 0, 0), (1, -1, 1))), "each color of the gradient of a background must be"),
        (lambda: Background(panorama="sky.hdr"), "panorama of a background must be a Texture or finite floats from 0"),
        (lambda: Background(panorama=np.zeros((4, 8, 3), np.uint8)), r"got uint8 \(4, 8, 3\)"),
        (lambda: Background(panorama=np.full((4, 8, 3), np.nan)), "must be finite and from 0 up, and 96 numbers are"),
        (lambda: Background(exposure=-1), "exposure of a background must be a finite number from 0 up"),
        (lambda: Background(haze=0.3), "haze of a background must be a Haze or None, got float"),
        (lambda: Haze(radius=0), "radius of haze must be greater than 0"),
        (lambda: Haze(width=1.5), "width of haze must be from 0 to 1, got 1.5"),
        (lambda: Haze(normal=(0, 0, 0)), "normal of haze must not be 0"),
        (lambda: Haze(color=(0, 0, 2)), "color of haze must be three numbers from 0 to 1"),
        (lambda: Haze(position=(1e30, 0, 0)), "position of haze must be at most"),
    ],
)
def test_invalid_skies_are_rejected(make, said):
    with pytest.raises(SceneError, match=said):
        make()


MODEL = """<mujoco><visual><rgba haze="0.9 0.4 0.2 1"/><map haze="%g" zfar="30"/><quality offsamples="0"/></visual>
<asset><texture type="skybox" builtin="gradient" rgb1="0.3 0.5 0.9" rgb2="0.7 0.6 0.1" width="200" height="1200"
 mark="random" markrgb="1 1 1"/></asset>
<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="0 0 0.1" rgba="0.2 0.3 0.4 1" euler="%s"/>
<geom type="box" size="0.3 0.2 0.5" pos="0 0 0.5" rgba="0.8 0.4 0.2 1"/>
<camera name="low" pos="-3 0.5 1.2" xyaxes="0 -1 0 0.1 0 1"/>
<camera name="high" pos="-4 0 9" xyaxes="0.2 -1 0.1 0.4 0 1"/>
</worldbody><statistic extent="1.5" center="0 0 0"/></mujoco>"""


@pytest.mark.gl
@pytest.mark.parametrize("width", [0.3, 0.7])
def test_sky_and_haze_of_mujoco(width):
    model = mujoco.MjModel.from_xml_string(MODEL % (width, "3 -2 0"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = scene_from_mujoco(model)
    with mujoco.Renderer(model, 120, 160) as renderer:
        for camera in ("low", "high"):
            renderer.update_scene(data, camera)
            for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
                renderer.scene.flags[flag] = 0
            picture = renderer.render().astype(np.int32)
            pinhole = camera_from_mujoco(model, camera, 160, 120)
            pose = camera_poses(data, model, [model.camera(camera).id])[0]
            ours = wv.render(seen.scene, pinhole, pose, outputs=("color", "segmentation"), shadows=False)
            seg = ours.segmentation.numpy()[0]
            error = np.abs(ours.color.numpy()[0] - picture).max(axis=-1)
            sky = seg < 0
            sky[1:-1, 1:-1] &= sky[:-2, 1:-1] & sky[2:, 1:-1] & sky[1:-1, :-2] & sky[1:-1, 2:]
            assert sky.mean() > 0.15
            assert error[sky].max() <= 3
            assert np.quantile(error[sky], 0.99) <= 2
            floor = seg == seen.scene.objects.index(seen.scene["floor"])
            far = floor & (np.abs(picture - picture[-1, 0]).max(axis=-1) > 40)  # in haze
            assert far.sum() > 200
            assert np.quantile(error[far], 0.95) <= 4  # the ring of haze is a polygon there

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of vertices and textures in JAX: images, gradients, compiled functions, batches and errors."""

from functools import cache, partial

import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis.scene.lights import Background
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.solids import sphere

from support.colored_cards import CARD_ROW, CARD_UV, TEXTURE, WRAPS, build_card_scene
from support.gradients import CAMERAS, OBJECT_ROWS, ROW
from support.jax_devices import import_torch, jax_device  # noqa: F401

jax = pytest.importorskip("jax")
jnp = jax.numpy
wvj = pytest.importorskip("warpvis.jax")

PINHOLE = CAMERAS["pinhole"]
POSE = np.float32(ROW)
OBJECTS = np.float32(np.concatenate([OBJECT_ROWS, CARD_ROW[None]]))


@cache
def scene_on(device):
    return build_card_scene(device)


def random_colors(scene, item, seed=3):
    """Return texels of the card, or colors of the vertices of another object."""
    shape = (4, 5, 3) if item == "card" else (len(scene.objects[scene.index(item)].vertices), 3)
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def color_of(scene, colors, poses=POSE, camera=PINHOLE, **options):
    return wvj.render(scene, camera, poses, colors=colors, outputs="color", **options).color


def assert_close(got, expected, tolerance):
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize("name", CAMERAS)
def test_images_and_gradients_equal_those_of_torch(name, device):
    """To rounding: images differ by the division of `albedo` by 255 in single precision."""
    torch, wt, place = import_torch(device)
    scene, camera = scene_on(device), CAMERAS[name]
    given = {item: random_colors(scene, item) for item in ("card", "stone", "wall")}
    tensors = {item: torch.tensor(value, device=place, requires_grad=True) for item, value in given.items()}
    expected = wt.render(scene, camera, torch.tensor(POSE, device=place), colors=tensors, outputs="color").color
    weights = np.random.default_rng(9).uniform(-1, 1, expected.shape).astype(np.float32)
    (expected * torch.tensor(weights, device=place)).sum().backward()

    @jax.jit
    @partial(jax.value_and_grad, has_aux=True)
    def gradient(colors):
        image = color_of(scene, colors, camera=camera)
        return (image * weights).sum(), image

    (_, image), got = gradient(given)
    np.testing.assert_allclose(image, expected.detach().cpu().numpy(), rtol=2e-7, atol=0)
    for item, tensor in tensors.items():
        assert_close(got[item], tensor.grad.cpu().numpy(), 1e-6)
        assert np.any(got[item])


@pytest.mark.parametrize("item", ["stone", "wall", "card"])
def test_gradients_match_central_differences(item, device):
    """Colors are linear in the given ones, so that differences are exact for steps of any length."""
    scene, rng = scene_on(device), np.random.default_rng(3)
    given = np.float64(random_colors(scene, item))
    weights = rng.uniform(-1, 1, (1, *PINHOLE.shape, 3))

    def loss_of(values):
        image = color_of(scene, {item: np.float32(values)})
        return (np.asarray(image, dtype=np.float64) * weights).sum()

    got = jax.jit(jax.grad(lambda colors: (color_of(scene, {item: colors}) * weights).sum()))(np.float32(given))
    largest = np.argsort(-np.abs(np.asarray(got)).ravel())[:12]
    for k in (*largest, *rng.integers(0, given.size, 8)):
        change = np.zeros(given.size)
        change[k] = 0.5
        expected = loss_of(given + change.reshape(given.shape)) - loss_of(given - change.reshape(given.shape))
        assert abs(got.ravel()[k] - expected) < 1e-5 * np.abs(got).max()


@pytest.mark.parametrize("wraps", WRAPS, ids="-".join)
def test_own_texture_equals_albedo(wraps, device):
    scene = build_card_scene(device, wraps)
    expected = wv.render(scene, PINHOLE, POSE[None], outputs=("albedo", "segmentation"))
    got = np.asarray(color_of(scene, {"card": np.float32(TEXTURE / 255)}))
    assert (expected.segmentation.numpy() == scene.index("card")).sum() > 50
    assert np.abs(got - expected.albedo.numpy() / 255).max() < 1 / 255 + 1e-5


@pytest.mark.parametrize("compiled", [False, True], ids=["eager", "jit"])
def test_pixels_of_other_objects_have_albedo_and_no_gradient(compiled, device):
    scene = build_card_scene(device)
    scene.background = Background((0.1, 0.5, 0.9))
    card = scene.index("card")

    def loss(pose, texels):
        images = wvj.render(scene, PINHOLE, pose, colors={"card": texels}, outputs=("color", "segmentation", "depth"))
        others = images.segmentation != card
        return jnp.where(others[..., None], images.color, 0.0).sum(), images

    function = jax.grad(loss, argnums=(0, 1), has_aux=True)
    got, images = (jax.jit(function) if compiled else function)(POSE, np.full(TEXTURE.shape, 0.25, np.float32))
    assert not any(np.any(gradient) for gradient in got)
    views = wv.render(scene, PINHOLE, POSE[None], outputs=("albedo", "segmentation", "depth"))
    for name in ("segmentation", "depth"):
        np.testing.assert_array_equal(getattr(images, name), getattr(views, name).numpy())
    others, shown = views.segmentation.numpy() != card, views.albedo.numpy() / 255
    np.testing.assert_allclose(np.asarray(images.color)[others], shown[others], rtol=0, atol=1e-6)
    nothing = np.asarray(images.color)[views.segmentation.numpy() < 0]
    assert len(nothing) and np.abs(nothing - (0.1, 0.5, 0.9)).max() < 1 / 255
    np.testing.assert_allclose(color_of(scene, None), shown, rtol=0, atol=1e-6)


def test_gradients_of_depth_are_those_without_colors(device):
    scene = scene_on(device)

    def loss(pose, **options):
        images = wvj.render(scene, PINHOLE, pose, **options)
        return jnp.where(jnp.isfinite(images.depth), images.depth, 0.0).sum()

    given = {"card": random_colors(scene, "card")}
    got = jax.grad(partial(loss, colors=given, outputs=("color", "depth")))(POSE)
    assert_close(got, jax.grad(loss)(POSE), 1e-6)
    assert got.any()


def test_gradients_of_worlds_and_deformed_vertices(device):
    """Gradients are those of the poses and vertices of the render, not of a later one."""
    scene = build_card_scene(device)
    worlds = np.stack([OBJECTS, OBJECTS])
    worlds[1, 0, 1] += 0.2
    vertices = np.asarray(scene.objects[2].mesh_vertices, dtype=np.float32)
    poses, given = np.repeat(POSE[None], 3, axis=0), random_colors(scene, "stone")

    def stone_of(colors, poses, rows, shape, index=None):
        options = {"object_poses": rows, "world_index": index, "vertices": {"stone": shape}}
        return color_of(scene, {"stone": colors}, poses, **options)

    index = np.array([1, 0, 1], np.int32)
    image, backward = jax.vjp(lambda colors: stone_of(colors, poses, worlds, vertices, index), given)
    stone_of(given, poses[:1], worlds[:1], 0.5 * vertices)
    (got,) = backward(2 * image)
    expected = np.zeros_like(given)
    for world, views in enumerate((1, 2)):
        alone, backward = jax.vjp(partial(stone_of, poses=POSE, rows=worlds[world], shape=vertices), given)
        np.testing.assert_array_equal(alone[0], image[2 if world else 1])
        expected += views * np.asarray(backward(2 * alone)[0])
    assert_close(got, expected, 1e-5)


def test_texture_is_found_again(device):
    """Gradient descent in a compiled scan finds the texture of a card; its colors are linear in the texels."""
    scene, texels = scene_on(device), random_colors(scene_on(device), "card")
    measured = color_of(scene, {"card": texels})

    def step(found, _):
        value, gradient = jax.value_and_grad(
            lambda colors: jnp.square(color_of(scene, {"card": colors}) - measured).sum()
        )(found)
        return found - 0.1 * gradient, value

    found, losses = jax.jit(lambda start: jax.lax.scan(step, start, length=60))(jnp.full(texels.shape, 0.5))
    assert losses[-1] < 0.01 * losses[0]
    assert np.abs(found - texels).mean() < 0.1 * np.abs(0.5 - texels).mean()


@pytest.mark.parametrize("in_axes", [(0, None, None), (None, 0, None), (None, None, 0), (0, 0, 0)], ids=str)
def test_vmap(in_axes, device):
    """A batch of renders, and its gradients, equal renders one after the other, also if colors are batched."""
    scene, rng = scene_on(device), np.random.default_rng(8)
    arrays = [np.repeat(POSE[None, None], 2, axis=0), np.stack([OBJECTS] * 2), rng.random((2, 4, 5, 3), np.float32)]
    arrays[0][1, 0, 1] += 0.05
    arrays[1][1, 2, 1] += 0.1
    given = [array if axis == 0 else array[0] for array, axis in zip(arrays, in_axes, strict=True)]
    stone = random_colors(scene, "stone")

    def loss(poses, objects, texels, colors):
        image = color_of(scene, {"card": texels, "stone": colors}, poses, object_poses=objects)
        return jnp.square(image).sum(), image

    function = jax.grad(loss, argnums=(2, 3), has_aux=True)
    got, images = jax.jit(jax.vmap(function, in_axes=(*in_axes, None)))(*given, stone)
    for k in range(2):
        one = [array[k] if axis == 0 else array for array, axis in zip(given, in_axes, strict=True)]
        expected, image = function(*one, stone)
        np.testing.assert_array_equal(images[k], image)
        for gradient, alone in zip(got, expected, strict=True):
            assert_close(gradient[k], alone, 1e-6)


def test_gradient_of_a_batch_is_added(device):
    """The gradient of a loss over `vmap` is the sum of those of its members, also with batched vertices."""
    scene = build_card_scene(device)
    base = np.asarray(scene.objects[2].mesh_vertices, dtype=np.float32)
    shapes, given = np.stack([base, 0.8 * base]), random_colors(scene, "stone")

    def loss(colors, shape):
        return jnp.square(color_of(scene, {"stone": colors}, vertices={"stone": shape})).sum()

    got = jax.grad(lambda colors: jax.vmap(loss, in_axes=(None, 0))(colors, shapes).sum())(given)
    assert_close(got, sum(jax.grad(loss)(given, shape) for shape in shapes), 1e-6)


def test_colors_with_intrinsics(device):
    scene, given = scene_on(device), {"card": random_colors(scene_on(device), "card")}
    wider = wv.Camera(36, 28, fx=30.0, fy=30.0, cx=18.0, cy=14.0, near=0.1, far=8.0)
    intrinsics = np.float32([wider.fx, wider.fy, wider.cx, wider.cy])
    got = color_of(scene, given, intrinsics=intrinsics)
    np.testing.assert_array_equal(got, color_of(scene, given, camera=wider))


def test_changed_appearance_is_used(device):
    """New texture coordinates of the object replace the cached ones."""
    scene, given = build_card_scene(device), {"card": np.float32(TEXTURE / 255)}
    render = jax.jit(partial(color_of, scene))
    before = np.asarray(render(given))  # waits for the asynchronous call
    texture = Texture(TEXTURE, wrap_u="clamp", wrap_v="clamp", mipmaps=False)
    scene.set_appearance("card", Appearance((Material(texture=texture),), uv=0.5 * CARD_UV))
    after = np.asarray(render(given))
    shown = wv.render(scene, PINHOLE, POSE[None], outputs="albedo").albedo.numpy() / 255
    assert np.abs(after - before).max() > 0.1
    assert np.abs(after - shown).max() < 1 / 255 + 1e-5


SIZES = r"must have shape \(4, 3\) or \(h, w, 3\), got"
BAD = {
    "vertices": (
        {"colors": {"stone": np.zeros((3, 3), np.float32)}},
        r"colors\['stone'\] must have shape \(42, 3\)",
    ),
    "empty": ({"colors": {"card": np.zeros((0, 4, 3), np.float32)}}, rf"colors\['card'\] {SIZES}"),
    "columns": ({"colors": {"card": np.zeros((4, 4), np.float32)}}, rf"colors\['card'\] {SIZES}"),
    "dtype": ({"colors": {"card": np.zeros((4, 4, 3), np.uint8)}}, r"colors\['card'\] must be float32, got uint8"),
    "text": ({"colors": {"card": "red"}}, r"colors\['card'\] must be an array of numbers"),
    "no-uv": ({"colors": {"stone": np.zeros((4, 4, 3), np.float32)}}, "the object has no texture coordinates"),
    "solid": ({"colors": {"marble": np.zeros((4, 3), np.float32)}}, "colors must be those of meshes, got 'marble'"),
    "name": ({"colors": {"cup": np.zeros((4, 3), np.float32)}}, "cup"),
    "outputs": (
        {"colors": {"card": np.zeros((4, 3), np.float32)}, "outputs": "depth"},
        "outputs must contain color",
    ),
    "mapping": ({"colors": np.zeros((4, 3), np.float32)}, "colors must be arrays by name of the object, got ndarray"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_sentence(case):
    scene, (change, message) = build_card_scene(), BAD[case]
    scene.add(sphere(0.2), name="marble", pose=(1.5, -0.5, 0.2, 0, 0, 0, 1), movable=True)
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        wvj.render(scene, PINHOLE, POSE, **{"outputs": "color", **change})
    assert "\n" not in str(caught.value)


def test_colors_on_another_device():
    if not wp.is_cuda_available() or "cuda" not in str(jax.devices()).lower():
        pytest.skip("needs a GPU")
    texels = jax.device_put(jnp.zeros((4, 4, 3)), jax.devices("cpu")[0])
    with pytest.raises(wv.WarpvisError, match=r"colors\['card'\] must be on the scene's device, cuda:0"):
        color_of(scene_on("cuda:0"), {"card": texels})

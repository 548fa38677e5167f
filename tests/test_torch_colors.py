# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of vertices and textures in PyTorch: images, gradients, compiled functions and errors."""

import numpy as np
import pytest
import reference_color_gradients as twin
import torch
import trimesh
import warp as wp

import warpvis as wv
import warpvis.torch as wt
from warpvis.rendering.color_gradients import ColorGradients
from warpvis.scene.lights import Background
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.solids import sphere
from warpvis.scene.worlds import parse_worlds
from warpvis.torch._arguments import renderer_number
from warpvis.torch._colors import interpolate

from support.colored_cards import CARD, CARD_FACES, CARD_ROW, CARD_UV, TEXTURE, WRAPS, build_card_scene
from support.gradients import CAMERAS, OBJECT_ROWS, ROW

IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1.0])
IMAGES = ("points", "segmentation", "faces")


def tensor(values, device, *, requires_grad=False):
    made = torch.tensor(np.asarray(values), dtype=torch.float32, device=device.replace("cpu:0", "cpu"))
    return made.requires_grad_(requires_grad)


def objects_of(device):
    return tensor(np.concatenate([OBJECT_ROWS, CARD_ROW[None]]), device)


def first_view(views):
    """Return images of the first view as kernels read them: results of ray lists are one row."""
    images = {name: getattr(views, name).numpy()[0] for name in IMAGES}
    return {name: image[None] if images["faces"].ndim == 1 else image for name, image in images.items()}


@pytest.mark.parametrize("name", ["pinhole", "orthographic", "lidar"])
@pytest.mark.parametrize(
    ("item", "wraps"), [("card", wraps) for wraps in WRAPS] + [("stone", WRAPS[0]), ("wall", WRAPS[0])]
)
def test_kernels_match_twins(name, item, wraps, device):
    scene, camera, rng = build_card_scene(device, wraps), CAMERAS[name], np.random.default_rng(2)
    views = wv.render(scene, camera, np.float32(ROW[None]), outputs=IMAGES)
    index, images = scene.index(item), {name: getattr(views, name) for name in IMAGES}
    found = scene.objects[index]
    shape = (5, 6) if item == "card" else (len(found.vertices),)
    row = found.pose.astype(np.float64) if found.movable else IDENTITY
    seen, vertices = first_view(views), np.float64(found.frame_vertices)
    options = {"uv": np.float64(CARD_UV[CARD_FACES]), "wraps": wraps} if item == "card" else {}
    table = shape if item == "card" else (1, *shape)
    scene_data = (seen, index, row, vertices, found.faces)

    colors, worlds = ColorGradients(scene), parse_worlds(scene, 1, None, None, None)
    given, background = rng.random((*shape, 3)), rng.random((*views.points.shape, 3))
    out = wp.array(np.float32(background), dtype=wp.vec3, device=scene.device)
    colors.interpolate(index, wp.array(np.float32(given), dtype=wp.vec3, device=scene.device), worlds, images, out)
    image = seen["segmentation"].shape
    expected = twin.interpolate_colors(
        given.reshape(*table, 3), background[0].reshape(*image, 3), *scene_data, **options
    )
    assert (seen["segmentation"] == index).sum() >= 5
    np.testing.assert_allclose(out.numpy().reshape(expected.shape), expected, rtol=0, atol=1e-5)

    gradient = wp.array(np.float32(background), dtype=wp.vec3, device=scene.device)
    got = colors.gradients(index, shape, worlds, images, gradient).numpy()
    expected = twin.sum_color_gradients(background[0].reshape(*image, 3), table, *scene_data, **options)
    np.testing.assert_allclose(got.reshape(expected.shape), expected, rtol=0, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("item", ["stone", "wall", "card"])
def test_gradients_match_central_differences(item, device):
    """Colors are linear in the given ones, so that differences are exact for steps of any length."""
    scene, camera, rng = build_card_scene(device), CAMERAS["pinhole"], np.random.default_rng(3)
    shape = (4, 5, 3) if item == "card" else (len(scene.objects[scene.index(item)].vertices), 3)
    given, poses = rng.random(shape), tensor(ROW, device)
    weights = rng.uniform(-1, 1, (1, *camera.shape, 3))

    def loss_of(values):
        image = wt.render(scene, camera, poses, colors={item: tensor(values, device)}, outputs="color").color
        return (image.cpu().numpy().astype(np.float64) * weights).sum()

    colors = tensor(given, device, requires_grad=True)
    image = wt.render(scene, camera, poses, colors={item: colors}, outputs="color").color
    (image * tensor(weights, device)).sum().backward()
    got = colors.grad.cpu().numpy()
    largest = np.argsort(-np.abs(got).ravel())[:12]
    for k in (*largest, *rng.integers(0, given.size, 8)):
        change = np.zeros(given.size)
        change[k] = 0.5
        expected = loss_of(given + change.reshape(shape)) - loss_of(given - change.reshape(shape))
        assert abs(got.ravel()[k] - expected) < 1e-5 * np.abs(got).max()


@pytest.mark.parametrize("movable", [True, False], ids=["movable", "static"])
@pytest.mark.parametrize("wraps", WRAPS, ids="-".join)
def test_own_texture_equals_albedo(wraps, movable, device):
    """Also with repetitions of the material."""
    camera = CAMERAS["pinhole"]
    for options in ({}, {"texture_repeat": (2.0, 1.5)}):
        scene = build_card_scene(device, wraps, movable=movable, **options)
        expected = wv.render(scene, camera, np.float32(ROW[None]), outputs=("albedo", "segmentation"))
        given = {"card": tensor(TEXTURE / 255, device)}
        got = wt.render(scene, camera, tensor(ROW, device), colors=given, outputs="color").color.cpu().numpy()
        assert (expected.segmentation.numpy() == scene.index("card")).sum() > 50
        assert np.abs(got - expected.albedo.numpy() / 255).max() < 1 / 255 + 1e-5


@pytest.mark.parametrize("name", CAMERAS)
def test_own_vertex_colors_equal_albedo(name, device):
    scene, camera = wv.Scene(device=device), CAMERAS[name]
    rng = np.random.default_rng(4)
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.9)
    colors = rng.integers(0, 256, (len(mesh.vertices), 3)).astype(np.uint8)
    appearance = Appearance(vertex_colors=colors)
    scene.add(mesh, name="ball", appearance=appearance, pose=(2.5, 0.3, 0.1, 0, 0.6, 0, 0.8), movable=True)
    attached = trimesh.creation.icosphere(subdivisions=1, radius=0.4)
    scene.add(attached, name="knob", pose=(1.7, -0.5, 0.3, 0, 0, 0, 1), attach_to="ball")
    scene.background = Background((0.2, 0.4, 0.6))
    expected = wv.render(scene, camera, np.float32(ROW[None]), outputs=("albedo", "segmentation"))
    given = {"ball": tensor(colors / 255, device), "knob": tensor(np.ones((len(attached.vertices), 3)), device)}
    images = wt.render(scene, camera, tensor(ROW, device), colors=given, outputs=("color", "segmentation"))
    segmentation = expected.segmentation.numpy()
    assert set(np.unique(segmentation)) >= {0, 1}
    np.testing.assert_array_equal(images.segmentation.cpu().numpy(), segmentation)
    shown = expected.albedo.numpy() / 255
    assert np.abs(images.color.cpu().numpy() - shown)[segmentation != 1].max() < 1 / 255 + 1e-5
    np.testing.assert_allclose(images.color.cpu().numpy()[segmentation == 1], 1.0, atol=1e-5)


def test_pixels_of_other_objects_have_albedo_and_no_gradient(device):
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]
    scene.background = Background((0.1, 0.5, 0.9))
    given = tensor(np.full((*TEXTURE.shape,), 0.25), device, requires_grad=True)
    row = tensor(ROW, device, requires_grad=True)
    outputs = ("color", "segmentation", "depth")
    images = wt.render(scene, camera, row, colors={"card": given}, outputs=outputs)
    others = images.segmentation != scene.index("card")
    shown = tensor(wv.render(scene, camera, np.float32(ROW[None]), outputs="albedo").albedo.numpy() / 255, device)
    torch.testing.assert_close(images.color[others], shown[others], rtol=0, atol=1e-6)
    assert (images.color[images.segmentation < 0] - tensor([0.1, 0.5, 0.9], device)).abs().max() < 1 / 255
    images.color[others].sum().backward()
    assert not given.grad.any() and (row.grad is None or not row.grad.any())
    plain = wt.render(scene, camera, tensor(ROW, device), outputs="color").color
    torch.testing.assert_close(plain, shown, rtol=0, atol=1e-6)


def test_gradients_of_worlds_and_deformed_vertices(device):
    """Gradients are those of the poses and vertices of the render, not of a later one."""
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]
    worlds = objects_of(device)[None].repeat(2, 1, 1)
    worlds[1, 0, 1] += 0.2
    vertices = tensor(scene.objects[2].mesh_vertices, device)
    poses = tensor(np.repeat(ROW[None], 3, axis=0), device)
    index = torch.tensor([1, 0, 1], device=poses.device)
    given = tensor(np.random.default_rng(6).random(vertices.shape), device, requires_grad=True)

    def color_of(poses, rows, shape, index=None):
        arguments = {"vertices": {"stone": shape}, "colors": {"stone": given}, "outputs": "color"}
        return wt.render(scene, camera, poses, object_poses=rows, world_index=index, **arguments).color

    image = color_of(poses, worlds, vertices, index)
    color_of(poses[:1], worlds[:1], 0.5 * vertices)
    image.square().sum().backward()
    got, given.grad = given.grad, None
    for world, views in enumerate((1, 2)):
        alone = color_of(poses[:1], worlds[world], vertices)
        torch.testing.assert_close(alone[0], image[2 if world else 1], rtol=0, atol=0)
        (views * alone.square().sum()).backward()
    torch.testing.assert_close(got, given.grad, rtol=1e-5, atol=1e-5)


def test_texture_is_found_again(device):
    """Adam finds the texture of a card from images of several views; texels that no view shows keep their color."""
    scene, camera = wv.Scene(device=device), wv.Camera.from_fov(64, 48, hfov=1.0, near=0.1, far=5.0)
    uv = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    appearance = Appearance((Material(texture=Texture(TEXTURE, wrap_u="clamp", wrap_v="clamp")),), uv=uv)
    scene.add((CARD, CARD_FACES), name="card", appearance=appearance)
    eyes = [(-0.7, y, z) for y in (-0.3, 0.0, 0.3) for z in (-0.2, 0.2)]
    poses = tensor([wv.look_at(eye, (0.0, 0.05, 0.0)).reshape(-1)[:7] for eye in eyes], device)
    true = tensor(TEXTURE / 255, device)
    measured = wt.render(scene, camera, poses, colors={"card": true}, outputs="color").color
    texels = torch.full_like(true, 0.5, requires_grad=True)
    optimizer = torch.optim.Adam([texels], lr=0.05)
    for _ in range(200):
        optimizer.zero_grad()
        image = wt.render(scene, camera, poses, colors={"card": texels}, outputs="color").color
        (image - measured).square().sum().backward()
        optimizer.step()
    seen = texels.grad.abs().sum(dim=2) > 0
    moved = (texels.detach() != 0.5).any(dim=2)
    assert (moved.sum() > 40) and not (seen & ~moved).any()
    assert (texels.detach() - true)[moved].abs().mean() < 2 / 255


def test_compiled_function_has_one_graph(device):
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]

    def measure(poses, texels, colors):
        given = {"card": texels, "stone": colors}
        images = wt.render(scene, camera, poses, colors=given, outputs=("depth", "color"))
        return images.depth.nan_to_num(posinf=0.0).sum() + images.color.square().sum()

    compiled = torch.compile(measure, fullgraph=True, backend="aot_eager")
    rng, found = np.random.default_rng(7), []
    values = rng.random((3, 4, 3)), rng.random((len(scene.objects[2].vertices), 3))
    for function in (measure, compiled):
        inputs = [tensor(value, device, requires_grad=True) for value in (ROW[None], *values)]
        function(*inputs).backward()
        found.append([value.grad for value in inputs])
    for plain, traced in zip(*found, strict=True):
        torch.testing.assert_close(traced, plain, rtol=0, atol=1e-6)


@pytest.mark.parametrize("device", ["cpu"])
def test_operator_passes_torch_checks(device):
    """Schema, fake tensors and autograd registration."""
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]
    number, rows = renderer_number(scene, camera, (), "auto", None), tensor(ROW[None], device)
    images = wv.render(scene, camera, np.float32(ROW[None]), outputs=(*IMAGES, "albedo"))
    seen = [wp.to_torch(getattr(images, name)) for name in (*IMAGES, "albedo")]
    given = [tensor(np.full((3, 4, 3), 0.5), device, requires_grad=True)]
    arguments = (rows, objects_of(device)[None], None, [], seen, given, [scene.index("card")], number)
    checks = ("test_schema", "test_autograd_registration", "test_faketensor")
    torch.library.opcheck(interpolate, arguments, test_utils=checks)


def test_vmap_shares_colors(device):
    """Gradients of a batch of worlds equal those of a loop."""
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]
    worlds = objects_of(device)[None].repeat(2, 1, 1)[:, None]
    worlds[1, 0, 2, 1] += 0.1
    poses = tensor(ROW[None], device)
    texels = tensor(np.random.default_rng(8).random((4, 5, 3)), device, requires_grad=True)

    def color_of(objects, colors):
        return wt.render(scene, camera, poses, object_poses=objects, colors={"card": colors}, outputs="color").color

    together = torch.vmap(color_of, in_dims=(0, None))(worlds, texels)
    looped = torch.stack([color_of(objects, texels) for objects in worlds])
    torch.testing.assert_close(together, looped, rtol=0, atol=0)
    gradients = [torch.autograd.grad(image.square().sum(), texels)[0] for image in (together, looped)]
    torch.testing.assert_close(*gradients, rtol=1e-5, atol=1e-5)
    with pytest.raises(wv.WarpvisError, match=r"colors must be the same for all batches of torch\.vmap"):
        torch.vmap(color_of, in_dims=(0, 0))(worlds, torch.stack([texels, texels]))


def test_changed_appearance_is_used(device):
    """New texture coordinates of the object replace the cached ones."""
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]
    poses, given = tensor(ROW, device), {"card": tensor(TEXTURE / 255, device)}
    before = wt.render(scene, camera, poses, colors=given, outputs="color").color
    texture = Texture(TEXTURE, wrap_u="clamp", wrap_v="clamp", mipmaps=False)
    scene.set_appearance("card", Appearance((Material(texture=texture),), uv=0.5 * CARD_UV))
    after = wt.render(scene, camera, poses, colors=given, outputs="color").color
    shown = wv.render(scene, camera, np.float32(ROW[None]), outputs="albedo").albedo.numpy() / 255
    assert (after - before).abs().max() > 0.1
    assert np.abs(after.cpu().numpy() - shown).max() < 1 / 255 + 1e-5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"colors": {"stone": torch.zeros(3, 3)}}, r"colors\['stone'\] must have shape \(42, 3\) or \(h, w, 3\), got"),
        ({"colors": {"card": torch.zeros(0, 4, 3)}}, r"colors\['card'\] must have shape \(4, 3\) or \(h, w, 3\), got"),
        ({"colors": {"card": torch.zeros(4, 4)}}, r"colors\['card'\] must have shape \(4, 3\) or \(h, w, 3\), got"),
        ({"colors": {"card": torch.zeros(4, 4, 3, dtype=torch.uint8)}}, r"colors\['card'\] must be float32, got"),
        ({"colors": {"card": np.zeros((4, 4, 3))}}, r"colors\['card'\] must be a torch.Tensor, got ndarray"),
        ({"colors": {"stone": torch.zeros(4, 4, 3)}}, "the object has no texture coordinates"),
        ({"colors": {"marble": torch.zeros(4, 3)}}, "colors must be those of meshes, got 'marble', which is a solid"),
        ({"colors": {"cup": torch.zeros(4, 3)}}, "cup"),
        ({"colors": {"card": torch.zeros(4, 3, device="meta")}}, "tensors must be on the scene's device, cpu"),
        ({"colors": {"card": torch.zeros(4, 3)}, "outputs": "depth"}, "outputs must contain color if colors are given"),
        ({"colors": torch.zeros(4, 3)}, "colors must be tensors by name of the object, got Tensor"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(change, message):
    scene = build_card_scene()
    scene.add(sphere(0.2), name="marble", pose=(1.5, -0.5, 0.2, 0, 0, 0, 1), movable=True)
    arguments = {"outputs": "color", **change}
    with pytest.raises(wv.WarpvisError, match=message):
        wt.render(scene, CAMERAS["pinhole"], tensor(ROW, "cpu"), **arguments)


def test_cuda_graph_replays_colors_and_gradients():
    if not torch.cuda.is_available():
        pytest.skip("needs CUDA in PyTorch")
    device = "cuda:0"
    scene, camera = build_card_scene(device), CAMERAS["pinhole"]
    poses, objects = tensor(ROW[None], device), objects_of(device)
    texels = tensor(TEXTURE / 255, device, requires_grad=True)

    def step():
        given = {"card": texels}
        image = wt.render(scene, camera, poses, object_poses=objects, colors=given, outputs="color").color
        value = image.square().sum()
        return value, torch.autograd.grad(value, texels)[0]

    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        for _ in range(3):
            step()
    torch.cuda.current_stream().wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph, stream=stream):
        recorded = step()
    with torch.no_grad():
        texels += 0.1
    graph.replay()
    torch.cuda.synchronize()
    for got, expected in zip(recorded, step(), strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-5, atol=1e-4)

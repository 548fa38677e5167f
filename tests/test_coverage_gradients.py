# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Areas and visible fractions with gradients: against a twin, finer images, and an optimization."""

import numpy as np
import pytest
import reference_soft_visibility as twin
import torch
import trimesh
import warp as wp

import warpvis as wv
import warpvis.torch as wt
from warpvis.core.kernel_cache import launch
from warpvis.kernels.gradients.coverage import sum_area_strips
from warpvis.rendering.coverage import find_neighbors
from warpvis.scene import solids
from warpvis.torch._arguments import renderer_number
from warpvis.torch._coverage import _measure

from support.gradients import CAMERAS, OBJECT_ROWS, ROW, build_scene
from support.hidden_ball import START, hidden_scene

WITH_IMAGES = [name for name in CAMERAS if name != "lidar"]


def tensor(values, device, *, requires_grad=False):
    made = torch.tensor(np.asarray(values), dtype=torch.float32, device=device.replace("cpu:0", "cpu"))
    return made.requires_grad_(requires_grad)


@pytest.mark.parametrize("names", [("stone",), ("box", "stone"), ("wall",)], ids="-".join)
@pytest.mark.parametrize("name", WITH_IMAGES)
def test_areas_and_gradients_match_twin(name, names, device):
    """Of objects in front and of one that others hide, by the distance of edges from pixel centers."""
    scene, camera = build_scene(device), CAMERAS[name]
    poses, objects = tensor(ROW[None], device, requires_grad=True), tensor(OBJECT_ROWS, device, requires_grad=True)
    stone = tensor(scene.objects[2].mesh_vertices, device, requires_grad=True)
    area = wt.coverage(scene, camera, poses, names, object_poses=objects, vertices={"stone": stone})
    area.sum().backward()
    outputs = ("segmentation", "faces")
    views = wv.render(scene, camera, np.float32(ROW[None]), object_poses=np.float32(OBJECT_ROWS[None]), outputs=outputs)
    images = {key: getattr(views, key).numpy()[0] for key in outputs}
    rows = np.float32(ROW).astype(np.float64), np.float32(OBJECT_ROWS).astype(np.float64)
    targets = [scene.index(chosen) for chosen in names]
    reference = build_scene()
    assert area.item() == pytest.approx(twin.sum_coverage(camera, reference, images, targets, *rows), rel=1e-5)
    expected = twin.sum_coverage_gradients(camera, reference, images, targets, *rows, "stone")
    got = torch.cat([value.grad.flatten() for value in (poses, objects, stone)]).cpu().numpy()
    for part in (np.s_[:7], np.s_[7:21], np.s_[21:]):
        np.testing.assert_allclose(got[part], expected[part], rtol=0, atol=1e-4 * np.abs(expected).max())


def test_strips_are_added(device):
    strips = np.random.default_rng(0).uniform(0, 100, (3, 7))
    out = wp.empty(3, dtype=wp.float32, device=device)
    launch(sum_area_strips, out.shape, [wp.array(strips, dtype=wp.float64, device=device), out], wp.get_device(device))
    np.testing.assert_allclose(out.numpy(), twin.sum_area_strips(strips), rtol=1e-6)


@pytest.mark.parametrize("name", WITH_IMAGES)
def test_masks_match_twin(name, device):
    """Their weighted sum has the gradient of central differences."""
    scene, camera, rng = build_scene(device), CAMERAS[name], np.random.default_rng(0)
    poses, objects = tensor(ROW[None], device, requires_grad=True), tensor(OBJECT_ROWS, device, requires_grad=True)
    mask = wt.soft_mask(scene, camera, poses, ("box", "stone"), object_poses=objects)
    weights = rng.uniform(-1, 1, mask.shape[1:])
    (mask[0] * tensor(weights, device)).sum().backward()
    outputs = ("segmentation", "faces")
    views = wv.render(scene, camera, np.float32(ROW[None]), object_poses=np.float32(OBJECT_ROWS[None]), outputs=outputs)
    images = {key: getattr(views, key).numpy()[0] for key in outputs}
    base = np.float32(np.concatenate([ROW, OBJECT_ROWS.ravel()])).astype(np.float64)
    expected = twin.write_masks(camera, scene, images, [2, 3], base[:7], base[7:].reshape(2, 7))
    np.testing.assert_allclose(mask[0].detach().cpu().numpy(), expected, atol=1e-4)
    area = wt.coverage(scene, camera, poses, ("box", "stone"), object_poses=objects)
    assert mask.sum().item() == pytest.approx(area.item(), rel=1e-5)
    seen = lambda row: twin.seen_vertices(scene, row[:7], row[7:].reshape(2, 7))  # noqa: E731
    crossings, step, slopes = twin.Crossings(camera, scene, images, [2, 3], seen(base)), 1e-6, []
    for change in step * np.eye(len(base)):
        up, down = (crossings.masks(seen(base + sign * change), [2, 3])[0] for sign in (1, -1))
        slopes.append((weights * (up - down)).sum() / (2 * step))
    got = torch.cat([poses.grad.flatten(), objects.grad.flatten()]).cpu().numpy()
    np.testing.assert_allclose(got, slopes, rtol=0, atol=2e-4 * np.abs(slopes).max())


def test_object_moves_to_a_mask(device):
    """Intersection over union with the mask of another position grows."""
    scene, camera = hidden_scene(device), wv.Camera.from_fov(60, 45, hfov=0.7)
    poses = tensor(START[None], device)
    base = tensor([item.pose for item in scene.objects], device)
    target = base + tensor([[0, -0.25, 0.15, 0, 0, 0, 0], [0] * 7], device)
    measured = wt.soft_mask(scene, camera, poses, "ball", object_poses=target, occluded=False).round()
    ratios = []
    move = torch.zeros(2, 3, device=poses.device, requires_grad=True)
    optimizer = torch.optim.Adam([move], lr=0.02)
    for _ in range(60):
        optimizer.zero_grad()
        objects = torch.cat([base[:, :3] + move, base[:, 3:]], dim=1)
        mask = wt.soft_mask(scene, camera, poses, "ball", object_poses=objects, occluded=False)
        ratio = (mask * measured).sum() / (mask + measured - mask * measured).sum()
        ratios.append(ratio.item())
        (1 - ratio).backward()
        optimizer.step()
    assert ratios[0] < 0.7
    assert ratios[-1] > 0.9


FINE = 8


def true_area(camera_size, row, object_rows):
    """Return the area in pixels, measured in an image of 8 times the resolution."""
    camera = wv.Camera.from_fov(camera_size[0] * FINE, camera_size[1] * FINE, hfov=0.6)
    views = wv.render(hidden_scene(), camera, row[None], object_poses=object_rows[None], outputs="segmentation")
    return (views.segmentation.numpy() == 0).sum() / FINE**2


def test_gradient_agrees_with_areas_of_finer_images():
    """To 5 % of the largest component, for moves of camera and objects by 2 cm and rotations by 0.02 rad."""
    size, step = (120, 90), 0.02
    camera, scene = wv.Camera.from_fov(*size, hfov=0.6), hidden_scene()
    base = np.array([scene.objects[0].pose, scene.objects[1].pose], dtype=np.float64)
    twists = torch.zeros(3, 6, requires_grad=True)
    moved = wt.apply_twists(tensor(np.concatenate([START[None], base]), "cpu"), twists)
    area = wt.coverage(scene, camera, moved[:1], "ball", object_poses=moved[1:])
    assert area.item() == pytest.approx(true_area(size, START, base), rel=0.01)
    area.sum().backward()
    expected = np.zeros((3, 6))
    for k, axis in np.ndindex(3, 6):
        values = []
        for sign in (1, -1):
            twist = torch.zeros(3, 6, dtype=torch.float64)
            twist[k, axis] = sign * step
            rows = wt.apply_twists(torch.tensor(np.concatenate([START[None], base])), twist).numpy()
            values.append(true_area(size, rows[0], rows[1:]))
        expected[k, axis] = (values[0] - values[1]) / (2 * step)
    np.testing.assert_allclose(twists.grad.numpy(), expected, rtol=0, atol=0.05 * np.abs(expected).max())


def test_blurred_masks_show_an_entirely_hidden_object(device):
    """Where the visible fraction is constant, the fraction of a blurred mask of the occluder leads the camera.

    Its gradient has the error of the antialiased area of the ball, 400 px.
    """
    scene, camera = hidden_scene(device), wv.Camera.from_fov(80, 60, hfov=0.9)
    row = tensor([0, 0.2, 0.05, *START[3:]], device)
    weights = torch.exp(-(torch.arange(-12.0, 13, device=row.device) ** 2) / 32)
    weights = (weights / weights.sum()).reshape(1, 1, -1, 1)

    def soften(move):
        poses = torch.cat([row[:3] + move, row[3:]])[None]
        ball = wt.soft_mask(scene, camera, poses, "ball", occluded=False)
        padded = torch.nn.functional.pad(wt.soft_mask(scene, camera, poses, "box")[:, None], [12] * 4, mode="replicate")
        blurred = torch.nn.functional.conv2d(torch.nn.functional.conv2d(padded, weights), weights.mT)[:, 0]
        return poses, (ball * (1 - blurred)).sum() / ball.sum()

    move = tensor([0, 0, 0], device, requires_grad=True)
    poses, fraction = soften(move)
    assert wt.visible_fraction(scene, camera, poses, "ball").item() == 0
    fraction.backward()
    steps = 0.02 * torch.eye(3, device=row.device)
    with torch.no_grad():
        slopes = torch.stack([(soften(step)[1] - soften(-step)[1]) / 0.04 for step in steps])
    assert (move.grad - slopes).abs().max() < 0.1 * slopes.abs().max()

    optimizer = torch.optim.Adam([move], lr=0.03)
    for _ in range(40):
        optimizer.zero_grad()
        (-soften(move)[1]).backward()
        optimizer.step()
    assert wt.visible_fraction(scene, camera, soften(move)[0], "ball").item() > 0.9


def test_ascent_shows_a_hidden_object(device):
    """A camera moves from where a box hides most of a ball to where it is visible."""
    scene, camera = hidden_scene(device), wv.Camera.from_fov(60, 45, hfov=0.7)
    rows = tensor(START[None], device)
    moves = torch.zeros(1, 3, device=rows.device, requires_grad=True)
    optimizer = torch.optim.Adam([moves], lr=0.02)
    fractions = []
    for _ in range(60):
        optimizer.zero_grad()
        poses = torch.cat([rows[:, :3] + moves, rows[:, 3:]], dim=1)
        fraction = wt.visible_fraction(scene, camera, poses, "ball")
        fractions.append(fraction.item())
        (-fraction).sum().backward()
        optimizer.step()
    assert fractions[0] < 0.3
    assert max(fractions) > 0.9


def test_fractions_are_those_of_what_hides(device):
    """1 in front, 0 with the gradient 0 behind a wall or outside of the image."""
    scene = wv.Scene(device=device)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    for name, x, y in (("front", 1.5, 0), ("behind", 3, 0), ("outside", 1.5, 5)):
        scene.add(ball, name=name, pose=(x, y, 0, 0, 0, 0, 1), movable=True)
    scene.add(trimesh.creation.box(extents=(0.1, 4, 4)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1))
    camera, poses = wv.Camera.from_fov(40, 30, hfov=0.8), tensor(wv.look_at((0, 0, 0), (1, 0, 0)).reshape(1, 7), device)
    for name, expected in (("front", 1.0), ("behind", 0.0), ("outside", 0.0)):
        poses = poses.detach().requires_grad_()
        fraction = wt.visible_fraction(scene, camera, poses, name)
        fraction.sum().backward()
        assert fraction.tolist() == [pytest.approx(expected, abs=1e-6)]
        if not expected:
            assert not poses.grad.any()


def test_worlds_share_gradients_of_their_views(device):
    scene, camera = hidden_scene(device), wv.Camera.from_fov(40, 30, hfov=0.7)
    base = np.array([scene.objects[0].pose, scene.objects[1].pose])
    worlds = np.stack([base, base + [0, 0.1, 0, 0, 0, 0, 0]])
    objects, poses = tensor(worlds, device, requires_grad=True), tensor(np.repeat(START[None], 3, axis=0), device)
    index = torch.tensor([1, 0, 1], device=poses.device)
    areas = wt.coverage(scene, camera, poses, "ball", object_poses=objects, world_index=index)
    areas.sum().backward()
    for world, views in enumerate((1, 2)):
        single = tensor(worlds[world], device, requires_grad=True)
        area = wt.coverage(scene, camera, poses[:1], "ball", object_poses=single)
        area.sum().backward()
        assert area.item() == pytest.approx(areas[1 - world].item(), rel=1e-6)
        torch.testing.assert_close(objects.grad[world], views * single.grad, rtol=1e-5, atol=1e-4)


def test_compiled_function_has_the_same_gradient(device):
    scene, camera = hidden_scene(device), CAMERAS["pinhole"]

    def measure(poses):
        return wt.visible_fraction(scene, camera, poses, "ball").sum()

    found = []
    for function in (measure, torch.compile(measure, fullgraph=True, backend="aot_eager")):
        poses = tensor(START[None], device, requires_grad=True)
        function(poses).backward()
        found.append(poses.grad)
    torch.testing.assert_close(found[1], found[0], rtol=1e-6, atol=1e-6)


def test_operator_passes_torch_checks():
    scene, poses = hidden_scene(), tensor(START[None], "cpu", requires_grad=True)
    arguments = (poses, None, None, [], [0], renderer_number(scene, CAMERAS["pinhole"], (), "auto", None), True, True)
    checks = ("test_schema", "test_autograd_registration", "test_faketensor")
    torch.library.opcheck(_measure, arguments, test_utils=checks)


def test_areas_follow_changed_vertices(device):
    """Tables of the mesh have the newest vertices, and those of the scene after objects were added."""
    scene, camera, poses = hidden_scene(device), CAMERAS["pinhole"], tensor(START[None], device)
    before = wt.coverage(scene, camera, poses, "ball", occluded=False)
    scene.update_vertices("ball", 0.5 * scene.objects[0].mesh_vertices)
    half = wt.coverage(scene, camera, poses, "ball", occluded=False)
    assert 0.2 < (half / before).item() < 0.3
    scene.add(trimesh.creation.box(extents=(0.1, 4, 4)), name="wall", pose=(1, 0, 0, 0, 0, 0, 1))
    assert wt.coverage(scene, camera, poses, "ball").item() == 0


def test_neighbors_of_split_vertices_and_open_meshes():
    """Vertices at the same place are one; an edge of one triangle or of three has no neighbor."""
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1]])
    square = np.array([[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(find_neighbors(corners, square), [[-1, 1, -1], [-1, -1, 0]])
    fan = np.array([[0, 1, 2], [3, 4, 5], [1, 2, 6]])
    assert (find_neighbors(corners, fan) == -1).all()


@pytest.mark.parametrize("function", [wt.coverage, wt.visible_fraction, wt.soft_mask])
@pytest.mark.parametrize("in_dims", [(0, 0), (None, 0), (0, None)])
def test_vmap_measures_worlds(device, function, in_dims):
    scene, camera = hidden_scene(device), wv.Camera.from_fov(40, 30, hfov=0.7)
    base = np.array([item.pose for item in scene.objects])
    worlds = tensor(np.stack([base, base + [0, 0.1, 0, 0, 0, 0, 0]]), device)
    poses = tensor(np.stack([START, START + [0, 0, 0.1, 0, 0, 0, 0]])[:, None], device)
    full = [poses if in_dims[0] == 0 else poses[0], worlds if in_dims[1] == 0 else worlds[1]]
    gradients = []
    for is_mapped in (True, False):
        inputs = [value.clone().requires_grad_() for value in full]

        def measure(pose, objects):
            return function(scene, camera, pose, "ball", object_poses=objects)

        if is_mapped:
            found = torch.vmap(measure, in_dims=in_dims)(*inputs)
        else:
            found = torch.stack(
                [measure(*(v if dim is None else v[k] for v, dim in zip(inputs, in_dims, strict=True))) for k in (0, 1)]
            )
        found.square().sum().backward()
        gradients.append([found.detach(), *(value.grad for value in inputs)])
    for got, expected in zip(*gradients, strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": "cup"}, "the scene has no object 'cup'"),
        ({"names": ()}, "names must contain at least one object, got none"),
        ({"camera": CAMERAS["lidar"]}, "camera must have pixels with neighbors for areas of objects, got a list"),
        ({"poses": torch.zeros(1, 6)}, r"poses must have shape \(V, 7\)"),
        ({"vertices": {"ball": torch.zeros(3)}}, "vertices of 'ball' must be a float32 torch.Tensor"),
        ({"occluded": "no"}, "occluded must be True or False, got 'no'"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(change, message):
    arguments = {"camera": CAMERAS["pinhole"], "poses": tensor(START[None], "cpu"), "names": "ball", **change}
    with pytest.raises(wv.WarpvisError, match=message):
        wt.coverage(hidden_scene(), **arguments)


def test_round_solids_are_an_error():
    scene = hidden_scene()
    scene.add(solids.sphere(0.1), name="round", pose=(1, 1, 1, 0, 0, 0, 1), movable=True)
    with pytest.raises(wv.WarpvisError, match=r"scene must contain only meshes for areas of objects, got .* 'round'"):
        wt.coverage(scene, CAMERAS["pinhole"], tensor(START[None], "cpu"), "ball")

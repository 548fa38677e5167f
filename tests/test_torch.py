# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gradients in PyTorch: against central differences in float64, in compiled functions, CUDA graphs and vmap."""

import gc

import numpy as np
import pytest
import torch
import trimesh

import warpvis as wv
import warpvis.torch as wt
from warpvis.cameras import parameter_values, with_parameters
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import SceneError
from warpvis.torch._arguments import renderer_number
from warpvis.torch._cast import cast

from support.gradients import CAMERAS, OBJECT_ROWS, ROW, Loss, build_scene, changes_of, flat_rays

NAMES = ("depth", "points", "normals")


def tensor(values, device, *, requires_grad=False):
    made = torch.tensor(np.asarray(values), dtype=torch.float32, device=device.replace("cpu:0", "cpu"))
    return made.requires_grad_(requires_grad)


def weigh(images, loss, names=NAMES):
    """Return the loss of rendered images, with zeros in place of infinite and missing numbers."""
    total = 0.0
    for name in names:
        image = getattr(images, name)
        weights = torch.as_tensor(loss.image_gradients((name,))[name], device=image.device)
        total = total + (torch.where(weights != 0, image, 0.0) * weights).sum()
    return total


def assert_close(got, expected, tolerance=1e-4):
    got = got.cpu().numpy().reshape(-1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.fixture(scope="module")
def stone():
    return np.array(build_scene().objects[2].mesh_vertices, dtype=np.float64)


@pytest.mark.parametrize("name", CAMERAS)
def test_gradients_match_central_differences(name, device, stone):
    scene, camera = build_scene(device), CAMERAS[name]
    vertex_changes = [{"vertices": {"stone": change["stone"]}} for change in changes_of("stone", stone)[:24]]
    changes = changes_of("row", ROW) + changes_of("object_rows", OBJECT_ROWS) + vertex_changes
    loss = Loss(build_scene(), camera, changes)
    row, rows = tensor(ROW, device, requires_grad=True), tensor(OBJECT_ROWS, device, requires_grad=True)
    vertices = tensor(stone, device, requires_grad=True)
    images = wt.render(scene, camera, row, object_poses=rows, vertices={"stone": vertices}, outputs=NAMES)
    weigh(images, loss).backward()
    expected = loss.differences().sum(axis=1)
    assert_close(row.grad, expected[:7])
    assert_close(rows.grad, expected[7:21])
    assert_close(vertices.grad.reshape(-1)[:12], expected[21:])


@pytest.mark.parametrize("name", [name for name in CAMERAS if name != "lidar"])
def test_intrinsic_gradients_match_central_differences(name, device):
    """By casting along the rays of cameras with other parameters, of all kinds of lenses."""
    scene, camera = build_scene(device), CAMERAS[name]
    values = parameter_values(camera)
    changes = []
    for step in 1e-6 * np.maximum(np.abs(values), 0.1):
        for sign in (1, -1):
            changed = values + sign * step * (np.arange(len(values)) == len(changes) // 2)
            rays, origins, _ = flat_rays(with_parameters(camera, changed))
            changes.append({"rays": rays} if origins is None else {"rays": rays, "origins": origins})
    names = ("depth", "points")
    loss = Loss(build_scene(), camera, changes)
    steps = 1e-6 * np.maximum(np.abs(values), 0.1)
    expected = loss.differences(names, step=1.0).sum(axis=1) / steps
    intrinsics = torch.tensor(values, requires_grad=True)
    objects = tensor(OBJECT_ROWS, device)
    images = wt.render(scene, camera, tensor(ROW, device), object_poses=objects, intrinsics=intrinsics, outputs=names)
    weigh(images, loss, names).backward()
    np.testing.assert_allclose(intrinsics.grad.numpy() * steps, expected * steps, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("name", ["pinhole", "lidar"])
def test_images_equal_those_of_render(name, device):
    """With and without gradients, for all outputs."""
    scene, camera = build_scene(device), CAMERAS[name]
    outputs = (*NAMES, "labels", "segmentation", "faces")
    rows = np.float32(np.repeat(ROW[None], 3, axis=0))
    rows[:, 0] += [0.0, 0.1, 0.2]
    worlds = np.float32(np.stack([OBJECT_ROWS, OBJECT_ROWS[::-1]]))
    expected = wv.render(scene, camera, rows, object_poses=worlds, world_index=[1, 0, 1], outputs=outputs)
    poses, objects = tensor(rows, device), tensor(worlds, device)
    index = torch.tensor([1, 0, 1], device=poses.device)
    for requires_grad in (False, True):
        poses.requires_grad_(requires_grad)
        images = wt.render(scene, camera, poses, object_poses=objects, world_index=index, outputs=outputs)
        for output in outputs:
            got = getattr(images, output)
            np.testing.assert_array_equal(got.detach().cpu().numpy(), getattr(expected, output).numpy())
    assert not images.segmentation.requires_grad


def test_gradients_of_worlds_are_added(device):
    """The gradient of a world is the sum of those of its views."""
    scene, camera = build_scene(device), CAMERAS["pinhole"]
    worlds = np.stack([OBJECT_ROWS, OBJECT_ROWS + [0, 0.1, 0.1, 0, 0, 0, 0]])
    objects = tensor(worlds, device, requires_grad=True)
    poses = tensor(np.repeat(ROW[None], 3, axis=0), device)
    images = wt.render(scene, camera, poses, object_poses=objects, world_index=torch.tensor([1, 0, 1]).to(poses.device))
    images.depth.nan_to_num(posinf=0.0).square().sum().backward()
    for world, views in enumerate((1, 2)):
        alone = tensor(worlds[world], device, requires_grad=True)
        images = wt.render(scene, camera, poses[:1], object_poses=alone)
        images.depth.nan_to_num(posinf=0.0).square().sum().backward()
        torch.testing.assert_close(objects.grad[world], views * alone.grad, rtol=1e-5, atol=1e-4)


def test_matrices_and_twists_have_gradients(device):
    """A twist of a matrix and of a row have the same gradient, that of central differences."""
    scene, camera = build_scene(device), CAMERAS["pinhole"]
    twists = np.zeros(6)
    changes = [
        {"row": wt.apply_twists(torch.tensor(ROW)[None], torch.tensor(change["twist"])[None])[0].numpy()}
        for change in changes_of("twist", twists)
    ]
    loss = Loss(build_scene(), camera, changes)
    expected = loss.differences().sum(axis=1)
    objects = tensor(OBJECT_ROWS, device)
    twist = tensor(twists[None], device, requires_grad=True)
    rows = wt.apply_twists(tensor(ROW[None], device), twist)
    weigh(wt.render(scene, camera, rows, object_poses=objects, outputs=NAMES), loss).backward()
    assert_close(twist.grad, expected)

    twist = tensor(np.zeros((1, 6)), device, requires_grad=True)
    matrix = tensor(poses_to_matrices(ROW[None]), device)
    turn = torch.linalg.matrix_exp(_skew(twist[:, :3]))
    moved = torch.cat([matrix[:, :3, :3] @ turn, matrix[:, :3, :3] @ twist[:, 3:, None] + matrix[:, :3, 3:]], dim=2)
    poses = torch.cat([moved, matrix[:, 3:]], dim=1)
    weigh(wt.render(scene, camera, poses, object_poses=objects, outputs=NAMES), loss).backward()
    assert_close(twist.grad, expected)


def _skew(vector):
    x, y, z = vector.unbind(dim=-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(-1, 3, 3)


def test_matrices_become_rows_of_the_same_rotation():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(500, 7))
    rows[:4, 3:] = np.eye(4)
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    got = wt.matrices_to_rows(torch.tensor(poses_to_matrices(rows))).numpy()
    np.testing.assert_allclose(got[:, :3], rows[:, :3])
    np.testing.assert_allclose(np.abs((got[:, 3:] * rows[:, 3:]).sum(axis=1)), 1.0)


def test_compiled_function_has_one_graph(device):
    """Gradients of a compiled function equal those without; another scene is not confused with the first one."""
    camera = CAMERAS["pinhole"]

    def measure(scene, poses, objects):
        images = wt.render(scene, camera, poses, object_poses=objects, outputs=("depth", "points"))
        return images.depth.nan_to_num(posinf=0.0).sum() + images.points.nan_to_num().square().sum()

    compiled = torch.compile(measure, fullgraph=True, backend="aot_eager")
    scene, other = build_scene(device), build_scene(device)
    other.add(trimesh.creation.box(extents=(0.3, 0.3, 0.3)), name="more", pose=(1.5, 0, 0.2, 0, 0, 0, 1))
    for chosen in (scene, other, scene):
        found = []
        for function in (measure, compiled):
            poses = tensor(ROW[None], device, requires_grad=True)
            objects = tensor(OBJECT_ROWS[None], device, requires_grad=True)
            value = function(chosen, poses, objects)
            value.backward()
            found.append((value.detach(), poses.grad, objects.grad))
        for plain, traced in zip(*found, strict=True):
            torch.testing.assert_close(traced, plain, rtol=0, atol=0)


@pytest.mark.parametrize("device", ["cpu"])
def test_operators_pass_torch_checks(device):
    """Schema, fake tensors and autograd registration."""
    scene, camera = build_scene(device), CAMERAS["pinhole"]
    number = renderer_number(scene, camera, (), "auto", None)
    poses = tensor(ROW[None], device, requires_grad=True)
    objects = tensor(OBJECT_ROWS[None], device, requires_grad=True)
    arguments = (poses, objects, None, [], None, number, "depth,normals,segmentation")
    torch.library.opcheck(cast, arguments, test_utils=("test_schema", "test_autograd_registration", "test_faketensor"))


def test_vmap_renders_worlds(device):
    scene, camera = build_scene(device), CAMERAS["pinhole"]
    worlds = tensor(np.stack([OBJECT_ROWS, OBJECT_ROWS[::-1]])[:, None], device)
    poses = tensor(np.stack([ROW, ROW + [0.1, 0, 0, 0, 0, 0, 0]])[:, None], device)

    def depth_of(poses, objects):
        return wt.render(scene, camera, poses, object_poses=objects).depth

    together = torch.vmap(depth_of)(poses, worlds)
    shared = torch.vmap(depth_of, in_dims=(None, 0))(poses[0], worlds)
    for k in range(2):
        torch.testing.assert_close(together[k], depth_of(poses[k], worlds[k]), rtol=0, atol=0)
        torch.testing.assert_close(shared[k], depth_of(poses[0], worlds[k]), rtol=0, atol=0)

    for in_dims, inputs in (
        ((0, 0), (poses, worlds)),
        ((None, 0), (poses[0], worlds)),
        ((0, None), (poses, worlds[0])),
    ):
        mapped = [value.detach().requires_grad_() for value in inputs]
        looped = [value.detach().requires_grad_() for value in inputs]
        torch.vmap(depth_of, in_dims=in_dims)(*mapped).nan_to_num(posinf=0.0).square().sum().backward()
        for k in range(2):
            given = [value if dim is None else value[k] for value, dim in zip(looped, in_dims, strict=True)]
            depth_of(*given).nan_to_num(posinf=0.0).square().sum().backward()
        for got, expected in zip(mapped, looped, strict=True):
            torch.testing.assert_close(got.grad, expected.grad, rtol=1e-5, atol=1e-3)


def test_pose_is_found_again(device):
    """Adam finds a camera that is 5 degrees and 5 cm off, by the depth that it measured."""
    scene, camera = build_scene(device), wv.Camera.from_fov(64, 48, hfov=1.1, near=0.1, far=8.0)
    true = tensor(ROW[None], device)
    measured = wt.render(scene, camera, true).depth
    start = wt.apply_twists(true, tensor([[0.05, -0.05, 0.05, 0.03, -0.03, 0.03]], device))
    twist = torch.zeros(1, 6, device=true.device, requires_grad=True)
    optimizer = torch.optim.Adam([twist], lr=0.01)
    for _ in range(150):
        optimizer.zero_grad()
        depth = wt.render(scene, camera, wt.apply_twists(start, twist)).depth
        both = depth.isfinite() & measured.isfinite()
        torch.nn.functional.huber_loss(depth[both], measured[both], delta=0.05).backward()
        optimizer.step()
    found = wt.apply_twists(start, twist).detach()
    assert (found[:, :3] - true[:, :3]).norm() < 2e-3
    assert 2 * torch.acos((found[:, 3:] * true[:, 3:]).sum().abs().clamp(max=1)) < np.radians(0.1)


def test_scene_is_freed():
    import weakref

    scene = build_scene()
    wt.render(scene, CAMERAS["pinhole"], tensor(ROW, "cpu"))
    freed = weakref.ref(scene)
    del scene
    gc.collect()
    assert freed() is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": np.zeros((1, 7))}, "poses must be a torch.Tensor, got ndarray"),
        ({"poses": torch.zeros(1, 7, dtype=torch.float64)}, "poses must be float32, got torch.float64"),
        ({"poses": torch.zeros(1, 7)}, "quaternions of length 1"),
        ({"poses": torch.zeros(1, 6)}, r"poses must have shape \(V, 7\)"),
        ({"poses": torch.zeros(1, 7, device="meta")}, "tensors must be on the scene's device, cpu, got one on meta"),
        ({"object_poses": torch.zeros(1, 3, 7)}, r"object_poses must have shape \(W, 2, 7\)|object_poses"),
        ({"poses": 2 * torch.eye(4)[None]}, "poses must .* wrong in 1 of 1"),
        ({"poses": torch.diag(torch.tensor([1.0, 1, -1, 1]))}, "poses must be rotations, not mirrors"),
        ({"object_poses": torch.eye(4)[[0, 1, 3, 2]].expand(2, 4, 4)}, "object_poses must have the last row 0 0 0 1"),
        ({"world_index": torch.tensor([0.9])}, "world_index must be a torch.Tensor of int32, got torch.float32"),
        ({"world_index": [0]}, "world_index must be a torch.Tensor of int32, got list"),
        ({"vertices": torch.zeros(3, 3)}, "vertices must be arrays by name of the object, got Tensor"),
        ({"intrinsics": torch.ones(4, device="meta")}, "intrinsics must be on cpu, got a tensor on meta"),
        ({"world_index": torch.tensor([3])}, "world_index must be from 0 to 0"),
        ({"vertices": {"wall": torch.zeros(3, 3)}}, "vertices must be those of movable objects, got 'wall'"),
        ({"vertices": {"stone": torch.zeros(3, 3)}}, "vertices"),
        ({"vertices": {"cup": torch.zeros(3, 3)}}, "cup"),
        ({"intrinsics": torch.ones(3)}, "intrinsics must be a torch.Tensor of the 4 numbers fx, fy, cx, cy, got"),
        ({"intrinsics": torch.tensor([-1.0, 1, 1, 1])}, "fx"),
        ({"outputs": ("depth", "colors")}, "outputs must be some of depth, points"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(change, message):
    arguments = {"poses": tensor(ROW, "cpu"), **change}
    with pytest.raises(wv.WarpvisError, match=message):
        wt.render(build_scene(), CAMERAS["pinhole"], arguments.pop("poses"), **arguments)


@pytest.mark.parametrize("name", ["poses", "object_poses", "intrinsics"])
def test_forward_mode_derivatives_are_an_error(name):
    """They would be 0, since PyTorch drops tangents in custom operators."""
    inputs = {"poses": tensor(ROW, "cpu"), "object_poses": tensor(OBJECT_ROWS, "cpu")}
    inputs["intrinsics"] = torch.tensor(parameter_values(CAMERAS["pinhole"]))

    def depth(value):
        changed = {**inputs, name: value}
        return wt.render(build_scene(), CAMERAS["pinhole"], changed.pop("poses"), **changed).depth

    with pytest.raises(wv.errors.ArrayError, match="have no forward-mode derivatives"):
        torch.func.jvp(depth, (inputs[name],), (torch.ones_like(inputs[name]),))


def test_labels_have_no_gradient():
    images = wt.render(build_scene(), CAMERAS["pinhole"], tensor(ROW, "cpu", requires_grad=True), outputs="labels")
    with pytest.raises(RuntimeError, match="does not require grad"):
        images.labels.float().sum().backward()


def test_round_solids_have_gradients_of_depth_but_not_of_normals(device):
    """Depth and points of a sphere have the gradients of its tangent planes; its normals change with the point."""
    scene = wv.Scene(device=device)
    scene.add(wv.scene.solids.sphere(0.5), name="ball", movable=True)
    camera, row = wv.Camera.from_fov(16, 12, hfov=0.3), tensor(wv.look_at((0, 0, 0), (2, 0, 0)), device)

    def total(objects, names):
        images = wt.render(scene, camera, row, object_poses=objects, outputs=(*names, "normals"))
        return sum(getattr(images, name).double().square().sum() for name in names)

    objects = tensor([[2.0, 0.1, 0, 0, 0, 0, 1]], device, requires_grad=True)
    for name in ("depth", "points"):
        objects.grad = None
        total(objects, [name]).backward()
        expected = []
        for k in range(3):
            step = 1e-3 * torch.eye(7, device=objects.device)[k]
            with torch.no_grad():
                expected.append((total(objects + step, [name]) - total(objects - step, [name])).item() / 2e-3)
        np.testing.assert_allclose(objects.grad[0, :3].cpu(), expected, rtol=1e-3, atol=1e-2)
    with pytest.raises(SceneError, match=r"normals must be left out of the loss .* got 'ball'"):
        total(objects, ["normals"]).backward()


def test_cuda_graph_replays_render_and_gradients():
    if not torch.cuda.is_available():
        pytest.skip("needs CUDA in PyTorch")
    device = "cuda:0"
    scene, camera = build_scene(device), CAMERAS["pinhole"]
    poses, objects = tensor(ROW[None], device, requires_grad=True), tensor(OBJECT_ROWS[None], device)

    def step():
        depth = wt.render(scene, camera, poses, object_poses=objects).depth
        value = depth.nan_to_num(posinf=0.0).square().sum()
        return value, torch.autograd.grad(value, poses)[0]

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
        poses[0, 0] += 0.1
    graph.replay()
    torch.cuda.synchronize()
    for got, expected in zip(recorded, step(), strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-6, atol=1e-4)

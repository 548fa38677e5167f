# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth sensors that are PyTorch modules: inputs, invalid pixels, composition, random numbers and errors."""

import pickle
import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import reference_learned
import warp as wp

import warpvis as wv
from warpvis.core.threads import launch_images
from warpvis.kernels.sensors.learned import report_learned_depth, rotate_to_cameras
from warpvis.kernels.sensors.noise import MeasuredImages
from warpvis.sensors import Corruptions, LearnedDepth, Reason, StereoDepth, randomized

from support.kinect_noise import CAMERA, images, make_scene
from support.stereo import POSES

OUTPUTS = ("depth", "reasons", "true_depth", "normals", "segmentation", "points")
NUMBERS = {"seed": 3, "frame": [1, 2, 3], "view_index": [5, 0, 1]}
SPECIAL = np.float32([np.nan, np.inf, -np.inf, 0.0, -0.0, -2.0, 0.1, 0.5, 1.7, 3.0, 3.5, 1e30])


@pytest.fixture
def torch():
    return pytest.importorskip("torch")


def render(sensor, device="cpu", outputs=OUTPUTS, **options):
    return wv.render(make_scene(device), CAMERA, POSES, outputs=outputs, sensor=sensor, **(NUMBERS | options))


def identity(depth):
    return depth


def add_noise(depth, noise):
    return depth + 0.01 * noise[:, :1]


def assert_same(one, other, names=OUTPUTS):
    for name in names:
        np.testing.assert_array_equal(getattr(one, name).numpy(), getattr(other, name).numpy(), err_msg=name)


@pytest.mark.parametrize("has_inner", [False, True])
@pytest.mark.parametrize("far", [3.0, np.inf])
def test_reported_depth_matches_the_reference(device, has_inner, far):
    """All pairs of learned depth, exact depth, and depth of another sensor."""
    camera = wv.Camera.from_fov(4, 3, hfov=1.0, near=0.5, far=far)
    exact = np.float32([0.2, 1.0, 3.2, np.inf])
    inner = np.array([(1.5, 0), (np.inf, 1), (-np.inf, 2), (np.nan, 3)])
    grids = np.meshgrid(SPECIAL, exact, np.arange(4), indexing="ij")
    learned, true_depth = (np.ascontiguousarray(grid, dtype=np.float32) for grid in grids[:2])
    measured = inner[grids[2], 0].astype(np.float32), inner[grids[2], 1].astype(np.uint8)
    given = [wp.array(image, device=device) for image in (learned, true_depth, *measured)]
    result = MeasuredImages()
    result.depth, result.reasons = given[2:]
    inputs = [camera.near, camera.far, *given[:2], has_inner, result]
    launch_images(report_learned_depth, learned.shape, lambda window: [window, *inputs], device=wp.get_device(device))
    expected = reference_learned.report_learned_depth(camera, learned, true_depth, measured if has_inner else None)
    np.testing.assert_array_equal(given[2].numpy(), expected[0].astype(np.float32))
    np.testing.assert_array_equal(given[3].numpy(), expected[1])


def test_rotated_normals_match_the_reference(device):
    normals = wv.render(make_scene(device), CAMERA, POSES, outputs=("normals",)).normals
    rotated = wp.empty_like(normals)
    poses = wp.array(POSES, dtype=wp.transform, device=device)
    launch_images(
        rotate_to_cameras,
        normals.shape,
        lambda window: [poses, window, normals, rotated],
        device=wp.get_device(device),
    )
    expected = reference_learned.rotate_to_cameras(POSES, normals.numpy())
    assert (expected == 0).all(axis=-1).any() and (expected[..., 2] <= 0.01).all()  # toward the camera
    np.testing.assert_allclose(rotated.numpy(), expected, atol=1e-5)


def test_inputs_share_memory_with_images(torch, device):
    seen = {}
    names = ("true_depth", "normals", "segmentation", "camera_normals", "noise", "depth")

    def module(*tensors):
        seen.update(
            {name: (tensor.data_ptr(), tensor.cpu().numpy()) for name, tensor in zip(names, tensors, strict=True)}
        )
        assert {str(tensor.device).replace("cuda:0", "cuda") for tensor in tensors} == {device.removesuffix(":0")}
        assert not torch.is_grad_enabled()
        return tensors[0]

    views = render(LearnedDepth(module, names, noise_channels=2), device)
    channels = {"normals": 3, "camera_normals": 3, "noise": 2}
    for name, (pointer, image) in seen.items():
        assert image.shape == (3, channels.get(name, 1), 72, 96)
        if name in ("true_depth", "normals", "segmentation"):
            assert pointer == getattr(views, name).ptr
            np.testing.assert_array_equal(np.moveaxis(image, 1, -1).squeeze(), getattr(views, name).numpy())
    assert seen["depth"][0] == seen["true_depth"][0]
    rotated = reference_learned.rotate_to_cameras(POSES, views.normals.numpy())
    np.testing.assert_allclose(np.moveaxis(seen["camera_normals"][1], 1, -1), rotated, atol=1e-5)
    noise = seen["noise"][1]
    assert abs(noise.mean()) < 4 / np.sqrt(noise.size) and abs(noise.std() - 1) < 4 / np.sqrt(2 * noise.size)
    assert abs(np.corrcoef(noise[:, 0].ravel(), noise[:, 1].ravel())[0, 1]) < 4 / np.sqrt(noise[:, 0].size)


@pytest.mark.parametrize("inner", [None, StereoDepth(0.06, sigma=0.1), StereoDepth(0.06, full_signal=0.5)], ids=str)
@pytest.mark.parametrize("inputs", ["depth", ("depth", "normals", "segmentation", "camera_normals")], ids=str)
def test_identity_changes_nothing(torch, device, inner, inputs):
    """Images that the module reads do not reach the sensor below, whose holes would change."""
    below = render(inner or Corruptions(), device)
    assert_same(render(LearnedDepth(lambda depth, *_: depth, inputs, of=inner), device), below)
    assert_same(render(LearnedDepth(lambda depth, *_: depth[:, 0].double(), inputs, of=inner), device), below)


def test_invalid_pixels_of_a_module(torch, device):
    columns = np.resize(SPECIAL, CAMERA.width)
    inner = StereoDepth(0.06, sigma=0.1, dropout=0.2)

    def module(depth):
        return torch.tensor(columns, device=depth.device).expand(depth.shape)

    for of in (None, inner):
        below = render(of or Corruptions(), device)
        views = render(LearnedDepth(module, of=of), device)
        measured = None if of is None else (below.depth.numpy(), below.reasons.numpy())
        expected = reference_learned.report_learned_depth(
            CAMERA, np.broadcast_to(columns, views.depth.shape), views.true_depth.numpy(), measured
        )
        np.testing.assert_array_equal(views.depth.numpy(), expected[0].astype(np.float32))
        np.testing.assert_array_equal(views.reasons.numpy(), expected[1])
        assert {Reason.VALID, Reason.EMPTY, Reason.RANGE, Reason.DROPOUT} <= set(np.unique(expected[1]))
        np.testing.assert_array_equal(np.isnan(views.points.numpy()[..., 0]), ~np.isfinite(views.depth.numpy()))


@pytest.mark.parametrize(("fill", "value"), [(0.5, 0.5), ("far", CAMERA.far)])
def test_filled_inputs(torch, device, fill, value):
    seen = []

    def module(depth, true_depth):
        seen.append((depth.cpu().numpy(), true_depth.cpu().numpy()))
        return true_depth * torch.nan

    inner = StereoDepth(0.06, sigma=0.1, dropout=0.2)
    with pytest.warns(UserWarning, match="returned NaN for all pixels"):
        views = render(LearnedDepth(module, ("depth", "true_depth"), of=inner, fill=fill), device)
    below = render(inner, device)
    near = CAMERA.near if fill == "far" else value
    for given, image in zip(seen[0], (below.depth.numpy(), views.true_depth.numpy()), strict=True):
        expected = np.where(np.isfinite(image), image, np.where(image == -np.inf, near, value)).astype(np.float32)
        np.testing.assert_array_equal(given[:, 0], expected)
    assert not np.isfinite(views.true_depth.numpy()).all()  # the image itself is not filled


def test_chunks_and_batches_give_the_same_depth(torch, device):
    """Noise depends on the view only, whatever the split into calls."""
    sizes = []

    def module(depth, noise):
        sizes.append(len(depth))
        return add_noise(depth, noise)

    whole = render(LearnedDepth(module, ("depth", "noise")), device)
    assert_same(render(LearnedDepth(module, ("depth", "noise"), batch=2), device), whole)
    assert sizes == [3, 2, 1]
    alone = wv.render(
        make_scene(device),
        CAMERA,
        POSES[1],
        sensor=LearnedDepth(module, ("depth", "noise")),
        seed=3,
        frame=2,
        view_index=[0],
    )
    np.testing.assert_array_equal(alone.depth.numpy()[0], whole.depth.numpy()[1])
    other = render(LearnedDepth(module, ("depth", "noise")), device, frame=4)
    assert (other.depth.numpy() != whole.depth.numpy()).mean() > 0.3


def test_modules_with_a_generator_are_reproducible(torch, device):
    class Net(torch.nn.Module):
        def forward(self, depth, generator=None):
            return depth + 0.01 * torch.randn(depth.shape, generator=generator, device=depth.device)

    sensor = LearnedDepth(Net().eval(), batch=1)
    whole = render(sensor, device)
    assert_same(render(sensor, device), whole)
    again = wv.render(make_scene(device), CAMERA, POSES[2], sensor=sensor, seed=3, frame=3, view_index=[1])
    np.testing.assert_array_equal(again.depth.numpy()[0], whole.depth.numpy()[2])  # of one view per call
    changed = [render(sensor, device, **change).depth.numpy() for change in ({"seed": 4}, {"frame": 9})]
    changed.append(whole.depth.numpy())
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert (changed[first] != changed[second]).mean() > 0.3


def test_renderers_with_out_and_copies(torch, device):
    network = torch.nn.Conv2d(1, 1, 3, padding=1, bias=False).to(wp.device_to_torch(device)).eval()
    torch.nn.init.dirac_(network.weight)
    renderer = wv.Renderer(make_scene(device), CAMERA, outputs=OUTPUTS, sensor=LearnedDepth(network, fill=0.0), seed=3)
    views = renderer.render(POSES)
    for image in (views.depth, views.reasons):
        image.zero_()
    expected = renderer.render(POSES, frame=0)
    assert renderer.render(POSES, frame=0, out=views) is views
    assert_same(views, expected)
    copied = pickle.loads(pickle.dumps(renderer.sensor))
    assert copied.fill == 0.0 and copied.module is not network
    assert_same(wv.render(make_scene(device), CAMERA, POSES, outputs=OUTPUTS, sensor=copied, frame=0), expected)
    assert_same(views, render(Corruptions(), device))  # 0 is a lost pixel


def test_composition_with_other_models(torch, device):
    learned = LearnedDepth(lambda depth: 0.9 * depth)
    over = render(Corruptions(dropout=0.3, of=learned), device)
    lost = over.reasons.numpy() == Reason.DROPOUT
    assert 0.1 < lost.mean() < 0.35
    below = render(learned, device).depth.numpy()
    np.testing.assert_array_equal(over.depth.numpy()[~lost], below[~lost])
    inner = randomized(StereoDepth(0.06), sigma=(0.05, 0.1))
    under = render(LearnedDepth(identity, of=inner), device)
    assert_same(under, render(inner, device))
    lens = wv.Camera.from_opencv(CAMERA.to_K(), [0.1, 0, 0, 0], CAMERA.width, CAMERA.height)
    bent = wv.render(make_scene(device), lens, POSES, outputs=("depth", "true_depth"), sensor=learned)
    seen = np.isfinite(bent.depth.numpy())
    np.testing.assert_allclose(bent.depth.numpy()[seen], 0.9 * bent.true_depth.numpy()[seen], rtol=1e-6)


def test_many_worlds_of_a_mujoco_model(torch, device):
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="3 3 .1"/><body name="ball" pos="0 0 .4"><joint type="slide"/>'
        '<geom size=".2"/></body><camera name="top" pos="0 0 2"/></worldbody></mujoco>'
    )
    options = {"height": 24, "width": 32, "outputs": ("depth", "true_depth"), "seed": 3, "device": device}
    sensor = LearnedDepth(add_noise, ("depth", "noise"), batch=2)
    batch = wv.mujoco.BatchRenderer(model, **options, sensor=sensor)
    qpos = np.linspace(-0.2, 0.2, 5)[:, None]
    views = batch.render(qpos, frame=2)
    errors = views.depth.numpy() - views.true_depth.numpy()
    assert 0.009 < errors[np.isfinite(errors)].std() < 0.011
    some = batch.render(qpos, worlds=[4, 1], frame=2)
    np.testing.assert_array_equal(some.depth.numpy(), views.depth.numpy()[[4, 1]])


def test_gymnasium_observations(torch):
    gym = pytest.importorskip("gymnasium")
    from gymnasium_environments import make_cup

    from warpvis.mujoco.gymnasium import VectorDepthObservation

    sensor = LearnedDepth(add_noise, ("depth", "noise"))
    look = {"camera": "front", "width": 40, "height": 32, "outputs": ("depth", "true_depth"), "sensor": sensor}
    env = VectorDepthObservation(gym.vector.SyncVectorEnv([lambda: make_cup("PoseObservation")] * 3), **look)
    first, again, other = (env.reset(seed=seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(again["depth"], first["depth"])
    assert (first["depth"] != other["depth"]).mean() > 0.3
    found = np.isfinite(first["true_depth"])
    assert 0.009 < (first["depth"] - first["true_depth"])[found].std() < 0.011


def test_work_of_torch_is_ordered_on_cuda(torch, cuda):
    """Weights that a side stream of PyTorch is still writing are used, and later changes are not."""
    scale = torch.zeros(1, device="cuda:0")
    sensor = LearnedDepth(lambda depth: depth * scale)
    renderer = wv.Renderer(make_scene(cuda), CAMERA, outputs=("depth",), sensor=sensor)
    renderer.render(POSES)
    with torch.cuda.stream(torch.cuda.Stream()):
        torch.cuda._sleep(200_000_000)
        scale.fill_(0.5)
        views = renderer.render(POSES, frame=0)
        scale.fill_(7.0)
    expected = wv.Renderer(make_scene(cuda), CAMERA, outputs=("depth",), sensor=LearnedDepth(lambda depth: depth * 0.5))
    np.testing.assert_array_equal(views.depth.numpy(), expected.render(POSES, frame=0).depth.numpy())


def test_cuda_graphs_are_refused(torch, cuda):
    renderer = wv.Renderer(make_scene(cuda), CAMERA, sensor=LearnedDepth(identity))
    poses = wp.array(POSES, dtype=wp.transform, device=cuda)
    views = renderer.render(poses)
    with pytest.raises(wv.WarpvisError, match="must not be recorded in a CUDA graph"), wp.ScopedCapture(cuda):
        renderer.render(poses, out=views)


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (lambda torch: lambda depth: None, "module must return a torch.Tensor, got NoneType"),
        (lambda torch: lambda depth: depth.numpy(), "module must return a torch.Tensor, got ndarray"),
        (
            lambda torch: lambda depth: depth[:1],
            r"module must return depth of shape \(3, 1, 72, 96\) or \(3, 72, 96\), got \(1, 1, 72, 96\)$",
        ),
        (lambda torch: lambda depth: depth.int(), r"must return floating-point depth \[m\], got torch.int32$"),
        (lambda torch: lambda depth: depth.to("meta"), "must return depth on cpu, got meta$"),
        (
            lambda torch: lambda depth: depth.clamp_(max=2.0),
            r"must not change its inputs in place, got a changed depth. Use clone\(\)$",
        ),
        (
            lambda torch: torch.nn.Conv2d(1, 1, 1, device="meta").eval(),
            r'module must be on cpu, the device of the scene, got meta. Use module.to\("cpu"\)$',
        ),
    ],
)
def test_invalid_modules_raise(torch, module, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        render(LearnedDepth(module(torch)))


def test_exceptions_of_modules_have_a_note(torch):
    with pytest.raises(RuntimeError, match="double") as caught:
        render(LearnedDepth(torch.nn.Conv2d(1, 1, 1).double().eval(), batch=2))
    assert caught.value.__notes__ == ["LearnedDepth called its module with depth (2, 1, 72, 96) on cpu."]


def test_training_mode_warns(torch):
    network = torch.nn.Sequential(torch.nn.Dropout(0.5))
    with pytest.warns(UserWarning, match=r"is in training mode, .*: call module.eval\(\)"):
        wv.Renderer(make_scene(), CAMERA, sensor=LearnedDepth(network))


def test_datasets_are_refused(torch, tmp_path):
    sensor = LearnedDepth(torch.nn.Sequential(torch.nn.ReLU(), torch.nn.ReLU()).eval())
    with pytest.raises(
        wv.WarpvisError, match=r"^LearnedDepth.module must be numbers or text .*, got Sequential\(.*\)$"
    ):
        wv.render_batch(make_scene(), CAMERA, POSES, tmp_path / "data", sensor=sensor)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"module": 3}, "module must be a torch.nn.Module or a function, got 3"),
        ({"inputs": ()}, "inputs must be different names of depth, true_depth, normals, camera_normals, .* noise, got"),
        ({"inputs": ("depth", "color")}, "inputs must be different names of .*, got .*'color'"),
        ({"inputs": ("depth", "depth")}, "inputs must be different names"),
        ({"of": "stereo"}, "of must be a model of warpvis.sensors"),
        ({"of": Corruptions(of=LearnedDepth(identity))}, "of must not contain LearnedDepth"),
        ({"fill": "near"}, "fill must be"),
        ({"batch": 0}, "batch must be a whole number from 1 up"),
        ({"noise_channels": 0}, "noise_channels must be a whole number from 1 up"),
    ],
)
def test_invalid_parameters_raise(arguments, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        LearnedDepth(**({"module": identity} | arguments))


def test_requirements_and_camera_of_the_inner_sensor():
    inner = wv.sensors.realsense_d435(64, 48)
    sensor = LearnedDepth(identity, ("camera_normals", "noise", "depth"), of=inner, noise_channels=2, fill="far")
    assert sensor.needs == ("normals",) and sensor.camera() == inner.camera()
    assert sensor.edge_shift == inner.edge_shift and sensor.bytes_per_pixel == inner.bytes_per_pixel + 4 * 7
    assert LearnedDepth(identity).needs == () and LearnedDepth(identity).bytes_per_pixel == 4
    with pytest.raises(wv.errors.CameraError, match=r"must be a warpvis.Camera or a LensCamera, got str"):
        LearnedDepth(identity).check(make_scene(), "camera")


def test_without_torch_there_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(wv.WarpvisError, match=r"^LearnedDepth needs PyTorch, which is missing: pip install torch$"):
        wv.Renderer(make_scene(), CAMERA, sensor=LearnedDepth(identity))


def test_documented_code_runs(torch):
    page = (Path(__file__).parent.parent / "docs/sensors/noise_models.md").read_text(encoding="utf-8")
    section = page.partition("## Learned noise")[2].partition("\n## ")[0]
    names = {"np": np, "wv": wv, "scene": make_scene(), "camera": CAMERA, "camera_to_world": POSES}
    blocks = re.findall(r"```py\n(.*?)```", section, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(block, names)
    assert images(names["views"], ("depth",))["depth"].shape == (len(POSES), CAMERA.height, CAMERA.width)

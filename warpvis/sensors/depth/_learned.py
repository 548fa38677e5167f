# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth sensors that are PyTorch modules."""

from __future__ import annotations

import inspect
import itertools
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_items, check_whole, truncate
from warpvis.errors import ArrayError, WarpvisError
from warpvis.kernels.constants import STREAM_LEARNED
from warpvis.rendering import DepthSensor, Exposure, Fill, TakesLens, check_fill, fill_numbers
from warpvis.scene import Scene
from warpvis.sensors.depth._base import draw_normal_image, kernel_images

LearnedInput: TypeAlias = Literal["depth", "true_depth", "normals", "camera_normals", "segmentation", "noise"]
"""An input of a module in `LearnedDepth`."""


@dataclass(frozen=True)
class LearnedDepth(DepthSensor):
    """Depth measured by a PyTorch module, in the batch and on the device of the scene.

    The module is called with one tensor per input, shape ``(V, C, H, W)``, float32 (`segmentation`: int32). It returns
    depth [m] of shape ``(V, 1, H, W)`` or ``(V, H, W)``, of any floating-point type. NaN, 0 and negative depths are
    lost pixels; depth outside of the camera's range becomes -inf or +inf. The module runs without gradients, and
    neither changes its inputs in place nor keeps them without a copy.

    Tensors share the memory of the rendered images; `fill`, ``"camera_normals"`` and ``"noise"`` need separate memory.
    On CUDA, the module runs on Warp's stream, and only its first call waits for the GPU.
    """

    module: Callable[..., Any]
    """A `torch.nn.Module` on the device of the scene, or another function of tensors. If it has a parameter
    `generator`, each call passes a `torch.Generator`, seeded from the seed of the renderer and the number and the
    frame of the first view of the call."""
    inputs: tuple[LearnedInput, ...] = ("depth",)
    """Arguments of the module, in order:

    - ``"depth"``: depth measured by `of`, by default exact depth [m];
    - ``"true_depth"``: exact depth [m], of surfaces at any distance;
    - ``"normals"``: unit normals in the world frame, 3 channels, as in `Views.normals`; NaN without a surface;
    - ``"camera_normals"``: unit normals in the camera's frame, OpenCV axes; 0 without a surface;
    - ``"segmentation"``: object indices, -1 for none;
    - ``"noise"``: standard normal random numbers that depend only on the seed, the number and the frame of the view,
      and the pixel.
    """
    of: DepthSensor | None = field(default=None, kw_only=True)
    """The sensor whose depth the module reads as ``"depth"``; by default, exact depth."""
    fill: Fill = field(default="inf", kw_only=True)
    """Depth of pixels without depth in the inputs, as in `warpvis.Renderer`: a number of meters, or ``"far"``. By
    default, it is +inf without a surface; with `of`, also -inf and NaN. Convolutions spread numbers that are not finite
    to other pixels. With 0, the module may return 0 where nothing was measured."""
    batch: int | None = field(default=None, kw_only=True)
    """Maximum number of views per call of the module; by default, all views of a call of the renderer."""
    noise_channels: int = field(default=1, kw_only=True)
    """Number of channels of ``"noise"``."""

    takes_lens: ClassVar[TakesLens] = "any"

    def __post_init__(self) -> None:
        if not callable(self.module):
            raise ArrayError(f"module must be a torch.nn.Module or a function, got {truncate(repr(self.module))}")
        inputs = tuple(as_items([self.inputs] if isinstance(self.inputs, str) else self.inputs, "inputs"))
        unknown = [name for name in inputs if not isinstance(name, str) or name not in get_args(LearnedInput)]
        if unknown or not inputs or len(set(inputs)) < len(inputs):
            raise ArrayError(
                f"inputs must be different names of {', '.join(get_args(LearnedInput))}, got {truncate(repr(inputs))}"
            )
        object.__setattr__(self, "inputs", inputs)
        if self.of is not None and not isinstance(self.of, DepthSensor):
            raise ArrayError(f"of must be a model of warpvis.sensors, such as StereoDepth, got {self.of!r}")
        inner: object = self.of
        while inner is not None:
            if isinstance(inner, LearnedDepth):
                raise ArrayError("of must not contain LearnedDepth, because both would use the same random numbers")
            inner = getattr(inner, "of", None)
        check_fill(self.fill)
        if self.batch is not None:
            object.__setattr__(self, "batch", check_whole(self.batch, "batch"))
        object.__setattr__(self, "noise_channels", check_whole(self.noise_channels, "noise_channels"))

    def camera(self) -> Camera:
        """Return the camera of the sensor whose depth is read."""
        return super().camera() if self.of is None else self.of.camera()

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read."""
        needed = {name.removeprefix("camera_") for name in self.inputs} | set(() if self.of is None else self.of.needs)
        known: tuple[Literal["normals", "segmentation"], ...] = ("normals", "segmentation")
        return tuple(name for name in known if name in needed)

    @property
    def bytes_per_pixel(self) -> int:
        """Memory of copied inputs and of the result per pixel, without that of the module's layers [B]."""
        floats = 1 + (self.noise_channels if "noise" in self.inputs else 0)
        floats += 3 if "camera_normals" in self.inputs else 0
        floats += 0 if self.fill == "inf" else sum("depth" in name for name in self.inputs)
        return 4 * floats + (0 if self.of is None else self.of.bytes_per_pixel)

    @property
    def edge_shift(self) -> int:
        """Maximum distance by which the sensor `of` displaces edges [px]."""
        return 0 if self.of is None else self.of.edge_shift

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera if it can be used with the sensor `of`, and the module with the device of the scene.

        Raises:
            WarpvisError: If PyTorch is missing, or the module is on another device.
        """
        limited = super().check(scene, camera) if self.of is None else self.of.check(scene, camera)
        fill_numbers(self.fill, limited)
        torch, device = _import_torch(), scene.device
        if device.is_cuda and not torch.cuda.is_available():
            raise WarpvisError(f"LearnedDepth needs PyTorch with CUDA for a scene on {device}, got torch without CUDA")
        if isinstance(self.module, torch.nn.Module):
            expected = torch.device(wp.device_to_torch(device))
            for tensor in itertools.chain(self.module.parameters(), self.module.buffers()):
                if tensor.device != expected:
                    raise ArrayError(
                        f'module must be on {expected}, the device of the scene, got {tensor.device}. Use module.to("'
                        f'{expected}")'
                    )
            if self.module.training:
                warnings.warn(
                    "the module of LearnedDepth is in training mode, in which layers such as dropout and batch "
                    "normalization make images depend on other views and calls: call module.eval()",
                    stacklevel=2,
                )
        return limited

    def measure(self, exposure: Exposure) -> None:
        """Write the depth of the module and its reasons."""
        torch, device = _import_torch(), exposure.scene.device
        if device.is_cuda and device.is_capturing:
            raise WarpvisError("LearnedDepth must not be recorded in a CUDA graph, whose memory PyTorch does not know")
        if self.of is not None:
            exposure.measure_some(np.arange(len(exposure.true_depth)), self.of)  # with only the images that it needs
        images = [self._input(exposure, name) for name in self.inputs]
        count = len(exposure.true_depth)
        step = self.batch or max(1, count)
        with _on_stream(torch, device), torch.no_grad():
            tensors = [_to_channels(torch, image) for image in images]
            for first in range(0, count, step):
                views = slice(first, min(first + step, count))
                result = self._call(torch, exposure, [tensor[views] for tensor in tensors], views)
                self._write(exposure, wp.from_torch(result, dtype=wp.float32), views)

    def _input(self, exposure: Exposure, name: LearnedInput) -> wp.array:
        """Return an input of all views, ``(V, H, W)`` or for noise ``(V, C, H, W)``."""
        views, height, width = exposure.true_depth.shape
        if name == "noise":
            rows = (views, self.noise_channels * height, width)
            noise = draw_normal_image(exposure, STREAM_LEARNED, "learned noise", rows)
            return noise.reshape((views, self.noise_channels, height, width))
        if name == "camera_normals":
            from warpvis.kernels.sensors.learned import rotate_to_cameras

            normals = exposure.scratch("camera normals", exposure.true_depth.shape, wp.vec3)
            exposure.launch(rotate_to_cameras, exposure.normals, normals, cameras=[exposure.poses])
            return normals
        if name in ("normals", "segmentation"):
            return getattr(exposure, name)
        depth = exposure.true_depth if name == "true_depth" or self.of is None else exposure.depth_out
        filled = fill_numbers(self.fill, exposure.camera)
        if filled is None:
            return depth
        from warpvis.kernels.casting.images import fill_depth

        finite = exposure.scratch(f"filled {name}", depth.shape, wp.float32)
        wp.copy(finite, depth)
        exposure.launch(fill_depth, *filled, finite)
        return finite

    def _call(self, torch: Any, exposure: Exposure, tensors: list[Any], views: slice) -> Any:
        """Call the module for some views and return its depth, ``(V, H, W)`` float32, contiguous."""
        versions = [tensor._version for tensor in tensors]
        options = {}
        if _takes_generator(torch, self.module):
            number, frame = exposure.numbers[views.start]
            seed = np.random.SeedSequence((exposure.seed, int(number), int(frame))).generate_state(1, np.uint64)[0]
            generator = torch.Generator(device=tensors[0].device)
            options["generator"] = generator.manual_seed(int(seed >> np.uint64(1)))
        try:
            result = self.module(*tensors, **options)
        except Exception as error:
            given = [f"{name} {(*tensor.shape,)}" for name, tensor in zip(self.inputs, tensors, strict=True)]
            error.add_note(f"LearnedDepth called its module with {', '.join(given)} on {tensors[0].device}.")
            raise
        for name, tensor, version in zip(self.inputs, tensors, versions, strict=True):
            if tensor._version != version:
                raise ArrayError(f"module must not change its inputs in place, got a changed {name}. Use clone()")
        return self._checked(torch, exposure, result, tensors[0], views)

    def _checked(self, torch: Any, exposure: Exposure, result: Any, tensor: Any, views: slice) -> Any:
        """Return a result of the module as float32 if it is depth of the views.

        Raises:
            ArrayError: If it is not.
        """
        count, (height, width) = len(tensor), exposure.true_depth.shape[1:]
        if not isinstance(result, torch.Tensor):
            raise ArrayError(f"module must return a torch.Tensor, got {type(result).__name__}")
        shape, shapes = (*result.shape,), ((count, 1, height, width), (count, height, width))
        if shape not in shapes:
            raise ArrayError(f"module must return depth of shape {shapes[0]} or {shapes[1]}, got {shape}")
        if not result.is_floating_point():
            raise ArrayError(f"module must return floating-point depth [m], got {result.dtype}")
        if result.device != tensor.device:
            raise ArrayError(f"module must return depth on {tensor.device}, got {result.device}")
        result = result.detach().reshape(shapes[1]).to(torch.float32).contiguous()
        if "_is_checked" not in vars(self):  # once, since it waits for the GPU
            vars(self)["_is_checked"] = True
            exact = _to_channels(torch, exposure.true_depth[views])
            if bool(torch.isnan(result).all() & torch.isfinite(exact).any()):
                warnings.warn(
                    "the module of LearnedDepth returned NaN for all pixels of its first call; its weights or its "
                    "inputs may not be finite (fill=0.0 replaces +inf, -inf and NaN in depth)",
                    stacklevel=2,
                )
        return result

    def _write(self, exposure: Exposure, learned: wp.array, views: slice) -> None:
        from warpvis.kernels.sensors.learned import report_learned_depth

        reasons = None if exposure.reasons_out is None else exposure.reasons_out[views]
        images = kernel_images(replace(exposure, depth_out=exposure.depth_out[views], reasons_out=reasons))
        inputs = exposure.camera.near, exposure.camera.far, learned, exposure.true_depth[views], self.of is not None
        exposure.launch(report_learned_depth, *inputs, images, shape=learned.shape)


def _import_torch() -> Any:
    try:
        import torch
    except ImportError:
        raise WarpvisError("LearnedDepth needs PyTorch, which is missing: pip install torch") from None
    return torch


@contextmanager
def _on_stream(torch: Any, device: wp.Device) -> Iterator[None]:
    """Run PyTorch on Warp's stream, after its queued work and before its later work, without waiting for the GPU."""
    if device.is_cpu:
        yield
        return
    stream, current = wp.stream_to_torch(device), torch.cuda.current_stream(wp.device_to_torch(device))
    stream.wait_stream(current)
    try:
        with torch.cuda.stream(stream):
            yield
    finally:
        current.wait_stream(stream)


def _to_channels(torch: Any, image: wp.array) -> Any:
    """Return a tensor of the same memory, ``(V, C, H, W)``."""
    tensor = wp.to_torch(image, requires_grad=False)
    if image.ndim == 4:
        return tensor
    return tensor.unsqueeze(1) if tensor.ndim == 3 else tensor.permute(0, 3, 1, 2)


def _takes_generator(torch: Any, module: Callable[..., Any]) -> bool:
    """Return whether a module has a parameter `generator`."""
    function = module.forward if isinstance(module, torch.nn.Module) else module
    try:
        return "generator" in inspect.signature(function).parameters
    except (TypeError, ValueError):  # built-in functions have no signature
        return False

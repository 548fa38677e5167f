# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs that are computed from images of casters: colors, and outputs that users register."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.core.outputs import CAST, OUTPUTS, OutputSpec
from warpvis.core.threads import launch_images
from warpvis.errors import ArrayError
from warpvis.rendering._views import is_pixel_type
from warpvis.rendering.casters.base import ImagesByName

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.scene import Scene


@dataclass(frozen=True)
class Frame:
    """The views of one call and their exact images, from which an output is computed."""

    scene: Scene
    """The scene."""
    camera: AnyCamera
    """The camera; with a sensor, its depth is not limited."""
    poses: wp.array
    """Camera to world, axes of the camera, ``(V,)`` transform on the scene's device."""
    worlds: Worlds
    """The world of each view."""
    images: ImagesByName
    """The images that the output needs, by name, ``(V, H, W)``; lists of rays and points are images of one row."""
    threads: int
    """CPU threads to use."""


Compute = Callable[[Frame, wp.array], None]
"""Writes an output, its last argument, from the images of a frame."""

_COMPUTED: dict[str, Compute] = {}


def register_output(spec: OutputSpec, compute: Compute) -> None:
    """Add an output to those of all renderers and datasets of this process.

    Registering it again replaces `compute`, if the spec is the same.

    Args:
        spec: Its name, its dtype, and the images of casters that it is computed from. Its `stage` must be
            ``"compute"``.
        compute: Writes the output by kernels on the scene's device: ``compute(frame, out)``, where `out` has the dtype
            of `spec` and the shape of `Frame.images`.

    Raises:
        ArrayError: If the name is invalid or taken, or the spec cannot be computed.
    """
    if not isinstance(spec, OutputSpec) or not callable(compute):
        raise ArrayError(f"spec must be an OutputSpec and compute a function, got {spec!r} and {compute!r}")
    is_new = spec.name not in OUTPUTS or (spec.name in _COMPUTED and OUTPUTS[spec.name] == spec)
    if not spec.name.isidentifier() or spec.name.startswith("_") or not is_new:
        raise ArrayError(f"name of an output must be a new Python identifier, got {spec.name!r}")
    if spec.stage != "compute" or not is_pixel_type(spec):
        raise ArrayError(
            f'{spec.name} must have stage="compute" and be float32, int32 or uint8, or three float32 or uint8, got '
            f"stage={spec.stage!r}, {spec.dtype} and components {spec.components!r}"
        )
    unknown = [name for name in spec.needs if name not in CAST]
    if unknown or not spec.needs:
        raise ArrayError(f"needs of {spec.name} must be some of {', '.join(CAST)}, got {', '.join(unknown) or 'none'}")
    OUTPUTS[spec.name], _COMPUTED[spec.name] = spec, compute


def needs_of(name: str, scene: Scene) -> tuple[str, ...]:
    """Return the images of casters that an output is computed from."""
    return OUTPUTS["albedo" if name == "color" and not scene.lights else name].needs


def compute_output(name: str, frame: Frame, out: wp.array) -> None:
    """Write an output that is computed from others."""
    if name in _COMPUTED:
        _COMPUTED[name](frame, out)
    else:
        _shade(frame, out, lit=name == "color" and bool(frame.scene.lights))


def _shade(frame: Frame, out: wp.array, *, lit: bool) -> None:
    """Write the colors of visible surfaces: under the scene's lights, or base colors."""
    from warpvis.kernels.shading import base_colors, lighting

    scene, footprint = frame.scene, base_colors.Footprint()
    footprint.kind = {
        "pinhole": base_colors.FOOTPRINT_PINHOLE,
        "parallel": base_colors.FOOTPRINT_PARALLEL,
        "table": base_colors.FOOTPRINT_CONE,
    }[frame.camera.ray_model]
    footprint.size = wp.vec2(*frame.camera.pixel_size())
    images = [frame.images[name] for name in OUTPUTS["color" if lit else "albedo"].needs]
    scene_data = [scene.device_materials(scene.background), *([scene.device_lights(scene.lights)] if lit else [])]
    launch_images(
        lighting.shade_lit_colors if lit else base_colors.shade_base_colors,
        out.shape,
        lambda window: [*scene_data, footprint, frame.poses, window, frame.worlds, *images, out],
        device=scene.device,
        threads=frame.threads,
    )

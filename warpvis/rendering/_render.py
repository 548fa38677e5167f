# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering of a scene once, with warnings about probable mistakes."""

from __future__ import annotations

from collections.abc import Sequence

from warpvis.cameras.base import AnyCamera
from warpvis.core.motion import Motion
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import Convention, QuaternionOrder, host_poses, to_xyzw
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, ObjectScales, PoseLike
from warpvis.rendering._blindness import find_blind, seen_objects, warn_of_eyes_inside, warn_of_units
from warpvis.rendering._choices import DEFAULT_OUTPUTS, CasterName, Fill, Lighting, NearPlane, Output
from warpvis.rendering._depth_sensor import DepthSensor
from warpvis.rendering._renderer import Renderer
from warpvis.rendering._sensing import next_frame
from warpvis.rendering._views import Views
from warpvis.scene import Scene
from warpvis.scene.lights import AmbientOcclusion
from warpvis.scene.world_appearances import WorldAppearances
from warpvis.scene.worlds import parse_worlds


def render(
    scene: Scene,
    camera: AnyCamera,
    camera_to_world: PoseLike | Motion,
    *,
    outputs: Sequence[Output] = DEFAULT_OUTPUTS,
    caster: CasterName = "auto",
    cull_backfaces: bool = False,
    near_plane: NearPlane = "occlude",
    fill: Fill = "inf",
    shadows: bool = True,
    reflections: bool = True,
    lighting: Lighting = "pixel",
    ambient_occlusion: AmbientOcclusion | None = None,
    samples: int = 1,
    object_poses: ObjectPoses | Motion = None,
    object_scales: ObjectScales = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    appearances: WorldAppearances | None = None,
    convention: Convention | None = None,
    quaternion: QuaternionOrder = "xyzw",
    sensor: DepthSensor | None = None,
    seed: int = 0,
    frame: int | ArrayInput | None = None,
    view_index: ArrayInput | None = None,
    threads: int | None = None,
    device_bytes: int | None = None,
    out: Views | None = None,
) -> Views:
    """Render views of a scene once; see `Renderer` and its `render` for the arguments, and for rendering again.

    With a sensor and without `frame`, each call uses the next frame number of its seed in this process: 0, 1, 2, ...
    Calls in a loop therefore differ in their noise, and a program that is run twice renders the same images. Pass
    `frame` for an image that does not depend on earlier calls, and to workers that share a seed.
    """
    renderer = Renderer(
        scene,
        camera,
        outputs=outputs,
        caster=caster,
        cull_backfaces=cull_backfaces,
        near_plane=near_plane,
        fill=fill,
        shadows=shadows,
        reflections=reflections,
        lighting=lighting,
        ambient_occlusion=ambient_occlusion,
        samples=samples,
        sensor=sensor,
        seed=seed,
        threads=threads,
        device_bytes=device_bytes,
    )
    if sensor is not None and frame is None:
        frame = next_frame(renderer.seed)
    views = renderer.render(
        camera_to_world,
        object_poses=object_poses,
        object_scales=object_scales,
        world_index=world_index,
        exclude=exclude,
        appearances=appearances,
        convention=convention,
        quaternion=quaternion,
        frame=frame,
        view_index=view_index,
        out=out,
    )
    if not isinstance(camera_to_world, Motion) and scene.device.is_cpu:
        if quaternion == "xyzw":
            warn_of_order(camera_to_world, "opencv" if convention is None else convention)
        if fill == "inf" and object_poses is None and object_scales is None:
            nothing, blind = find_blind(views)
            if nothing or len(blind):
                poses = host_poses(to_xyzw(camera_to_world, quaternion, "camera_to_world"))
                seen = seen_objects(scene, parse_worlds(scene, len(poses), None, None, exclude).excluded)
                if not len(blind):
                    warn_of_units(scene, camera.far, seen, poses)
                warn_of_eyes_inside(scene, camera.near, poses, blind, seen)
    return views

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render many worlds of one MuJoCo model through the model's cameras and others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Unpack, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import check_size
from warpvis.core.checks import check_choice, check_flag, check_whole
from warpvis.core.labels import LabelInput
from warpvis.core.types import ArrayInput, DeviceLike
from warpvis.errors import ArrayError, SceneError
from warpvis.mujoco._batch_elements import SoftElements, Tendons
from warpvis.mujoco._batch_views import (
    BatchCamera,
    BatchViews,
    CameraChoice,
    ViewCaster,
    batch_views,
    choose_cameras,
    look_up_objects,
    look_up_pairs,
)
from warpvis.mujoco._batch_worlds import BatchWorlds
from warpvis.mujoco._body_visibility import (
    BodyMeter,
    BodyVisibility,
    by_world,
    choose_bodies,
    members_of_bodies,
    require_perspective,
)
from warpvis.mujoco._cameras import camera_from_mujoco
from warpvis.mujoco._geom_renderer import CoincidingGeoms
from warpvis.mujoco._geoms import DEFAULT_MESH_TOLERANCE, check_groups
from warpvis.mujoco._model_fields import UNKNOWN, element_meanings, shape_bodies
from warpvis.mujoco._poses import PoseSource
from warpvis.mujoco._scene import Movable, class_of_elements, make_scene, select_geoms, shown_by
from warpvis.mujoco._world_appearances import ModelAppearances
from warpvis.mujoco._world_models import Resizable, ResizableGeoms, resizable_geoms
from warpvis.mujoco._worlds import Kinematics
from warpvis.rendering import (
    ColorOptions,
    DepthSensor,
    Fill,
    Lighting,
    NearPlane,
    Output,
    Views,
    check_colors,
    check_output_names,
    view_numbers,
    views_for,
)
from warpvis.scene import Scene
from warpvis.scene.world_appearances import WorldAppearances
from warpvis.visibility import check_canvas


class BatchRenderer:
    """Renders cameras in many worlds.

    Worlds share the model's meshes; poses, sizes, visibility and fields of view may differ between worlds. All
    views of a call have one size; the pixel conventions are those of `warpvis.Views`.

    Example:
        >>> batch = BatchRenderer(model, nworld=1024, height=64, width=64)
        >>> views = batch.render(data, cameras=["wrist", "head"])  # MuJoCo Warp's data, on its GPU
        >>> depth = views.by_world().depth  # (1024, 2, 64, 64)
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        nworld: int | None = None,
        *,
        height: int = 240,
        width: int = 320,
        outputs: Sequence[Output] = ("depth",),
        geom_groups: Iterable[int] | None = None,
        site_groups: Iterable[int] | None = None,
        scene_option: mujoco.MjvOption | None = None,
        mesh_tolerance: float = DEFAULT_MESH_TOLERANCE,
        labels: LabelInput | None = None,
        label_names: Mapping[int, str] | None = None,
        exclude: Iterable[str] = (),
        movable: Movable = "bodies",
        resizable: Resizable = (),
        cull_backfaces: bool = True,
        near_plane: NearPlane = "clip",
        fill: Fill = "inf",
        lighting: Lighting = "pixel",
        sensor: DepthSensor | None = None,
        seed: int = 0,
        device: DeviceLike = "cpu",
        threads: int | None = None,
        **colors: Unpack[ColorOptions],
    ) -> None:
        """Prepare to render.

        Args:
            model: A `mujoco.MjModel`.
            nworld: Number of worlds in the poses of every call; any number by default.
            height: Image height [px].
            width: Image width [px].
            outputs: The images to make, as for `warpvis.Renderer`; ids need ``"segmentation"``. Colors are those of the
                model at construction.
            geom_groups: Groups of geoms to show, by default those of `scene_option`; see `scene_from_mujoco`.
            site_groups: Groups of sites to show, by default those of `scene_option`. Without it no sites are shown:
                they are markers, which no sensor sees.
            scene_option: A `mujoco.MjvOption`: its groups of geoms, sites, tendons, skins and flexes, its flags for
                static geoms, tendons, skins and flexes, and `flex_layer`. Without it, MuJoCo's default applies.
            mesh_tolerance: Largest distance between round shapes and their triangles [m]; see `scene_from_mujoco`.
            labels: Labels by name or pattern; see `scene_from_mujoco`.
            label_names: Names of user-defined classes, as for `warpvis.Scene`.
            exclude: Names or patterns of geoms, sites, tendons, skins, flexes or bodies not to render.
            movable: Static bodies and geoms whose poses in some worlds differ from the model's, by name or pattern, or
                ``"all"``; see `scene_from_mujoco`.
            resizable: Geoms whose sizes in some worlds differ from the model's, by name or pattern of geoms or
                bodies, or ``"all"``: boxes, spheres, capsules, cylinders and ellipsoids.
            cull_backfaces: Ignore surfaces seen from behind, as MuJoCo does.
            near_plane: As for `warpvis.Renderer`; MuJoCo clips.
            fill: Depth of empty pixels, as for `warpvis.Renderer`.
            lighting: Where light is computed in ``"color"``, as for `warpvis.Renderer`: ``"vertex"`` as by MuJoCo.
            sensor: A depth-camera model, as for `warpvis.Renderer`, applied to all cameras. The near planes of the
                cameras are the model's, `vis.map.znear`; surfaces nearer than the device's minimum depth are too near.
            seed: Seed of the sensor's random numbers, which also depend on world, camera and frame.
            device: Where to render; poses on a GPU must be on this one.
            threads: CPU threads to use; all cores of this process by default.
            **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `warpvis.Renderer`. As in
                MuJoCo, only the first plane or box with a reflectance shows a mirror image. In CUDA graphs, `samples`
                is 1.
        """
        nworld = None if nworld is None else check_whole(nworld, "nworld")
        check_size(width, "width")
        check_size(height, "height")
        groups, static, sites = shown_by(scene_option)
        sites = () if scene_option is None else sites
        for kind, given in (("geom", geom_groups), ("site", site_groups)):
            if given is not None and scene_option is not None:
                raise SceneError(f"{kind}_groups must not be given with scene_option, which has groups of {kind}s")
        groups = groups if geom_groups is None else check_groups(geom_groups)
        sites = sites if site_groups is None else check_groups(site_groups, "site_groups")
        self.model = model
        options: dict[str, Any] = {"mesh_tolerance": mesh_tolerance, "labels": labels, "label_names": label_names}
        options |= {"geom_groups": groups, "site_groups": sites, "exclude": exclude, "static": static}
        selection = select_geoms(model, **options)
        resized = resizable_geoms(model, selection, resizable)
        self.mujoco_scene = make_scene(model, selection, movable=movable, device=device, independent=resized)
        self._tendons = Tendons(model, selection, scene_option, self.scene)
        colored = not {"color", "albedo"}.isdisjoint(check_output_names(outputs, sensor))
        self._soft = SoftElements(model, selection, scene_option, self.scene, colored=colored)
        if not len(self.scene):
            raise SceneError(f"the model has no geoms to render in groups {groups}; see geom_groups=")
        self.nworld, self.height, self.width = nworld, height, width
        self.kinematics = Kinematics(model, threads=threads)
        self._outputs, self._sensor = check_output_names(outputs, sensor), sensor
        self.frame = 0
        """The frame of a sensor's random numbers in the next call of `render` without `frame`."""
        check_choice(lighting, "lighting", get_args(Lighting))
        check_choice(near_plane, "near_plane", get_args(NearPlane))
        self._render_options: dict[str, Any] = {"outputs": self._outputs, "sensor": sensor, "seed": seed, "fill": fill}
        self._render_options |= {"near_plane": near_plane, "cull_backfaces": cull_backfaces, "threads": threads}
        self._render_options |= {"lighting": lighting, **check_colors(**colors)}
        self._appearance: ModelAppearances | None = None
        if colored:
            moved = not isinstance(movable, str) or movable != "bodies"
            self._appearance = ModelAppearances(model, self.mujoco_scene, selection.mesh_tolerance, moved=moved)
        self._resizable = ResizableGeoms(model, self.mujoco_scene, resized)
        shapes = self.mujoco_scene.shapes()
        self._coinciding = CoincidingGeoms(model, self.scene, shapes, resizable=self._resizable.objects)
        self._caster = ViewCaster(self.scene, self._coinciding, self._render_options)
        self._meter = BodyMeter(self.scene, self._render_options)
        self._worlds = BatchWorlds(
            model,
            self.mujoco_scene,
            self.kinematics,
            nworld=nworld,
            resizable=self._resizable,
            tendons=self._tendons,
            soft=self._soft,
            appearance=self._appearance,
        )

    @property
    def scene(self) -> Scene:
        """The rendered scene: the geoms, and objects added to it, which are static."""
        return self.mujoco_scene.scene

    def render(
        self,
        poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput,
        *,
        cameras: CameraChoice | Sequence[CameraChoice] | None = None,
        worlds: ArrayLike | None = None,
        model: object | None = None,
        appearances: WorldAppearances | None = None,
        frame: int | ArrayInput | None = None,
        view_index: ArrayInput | None = None,
        out: Views | None = None,
    ) -> BatchViews:
        """Render some cameras in some worlds.

        On CUDA the work is queued on the device's current stream without waiting for it; arrays on the GPU are not
        copied to the host, except `cam_fovy` and the poses that skins and flexes need. With `out`, a call with the same
        arguments as an earlier one and without `model` allocates nothing and can be recorded into a CUDA graph.

        Args:
            poses: Poses of all objects: anything with the arrays `geom_xpos`, `geom_xmat`, `cam_xpos` and `cam_xmat` of
                W worlds (MuJoCo Warp's data, MJX's, `mujoco.batch.Batch`, `WorldPoses`), and the fields of `WorldPoses`
                for the model's tendons, skins, flexes and sites; a `mujoco.MjData`, or several; or joint positions,
                shape ``(W, nq)``, or ``(nq,)`` for one world. `kinematics.from_states` computes poses from states.
                Static geoms must be where the model places them, or be `movable`: this is checked for arrays in host
                memory.
            cameras: Names or ids of the model's cameras, -1 for the default free camera, or `mujoco.MjvCamera` that are
                fixed, free, or track a body (the poses must then have `subtree_com`); all of the model's cameras by
                default.
            worlds: Indices of the worlds to render, or a mask, ``(W,)`` bool; all by default. Other worlds cost
                nothing.
            model: Model fields that differ between worlds: the model of MuJoCo Warp or MJX, or a mapping of some of its
                arrays, of shape ``(W, ...)`` or ``(1, ...)``. `geom_rgba`, `geom_matid` and `mat_rgba` control
                visibility: geoms that the model itself hides are not in the scene. The outputs `color` and `albedo`
                show these colors and materials, `mat_emission`, the textures of `mat_texid`, and the lights of
                `light_active`, `light_type`, `light_cutoff`, `light_exponent`, `light_attenuation`, `light_diffuse`,
                `light_ambient` and `light_specular`; for them, `geom_matid` and `mat_texid` of several worlds must be
                in host memory. Worlds share `light_castshadow`. `cam_fovy` needs one ray-casting call per field of
                view: 256 different ones of 64x64 pixels take 2.6 to 4 times as long on 2 cores as a single one.
                `body_pos`, `body_quat`, `geom_pos`, `geom_quat`, `cam_pos`, `cam_quat`, `light_pos` and `light_dir` are
                used if `poses` are joint positions; other poses already include them. `geom_size` applies to
                `resizable` geoms: for arrays in host memory, the sizes of the others are checked to equal the model's.
                Meshes and height fields cannot differ.
            appearances: Colors, lights and backgrounds of the worlds that are rendered, in this order, for the outputs
                `color` and `albedo`, as for `Renderer.render`; they replace those of the model.
            frame: The frame number of a sensor's random numbers, at least 0, one or one for each view, in the order of
                the images. The default is `BatchRenderer.frame`, which starts at 0 and is incremented by each such
                call. The image of a camera in a world does not depend on which other worlds are rendered. A CUDA graph
                uses the frame that it was recorded with whenever it is replayed.
            view_index: View numbers for the random numbers, in the order of the images; by default the world's
                index times C plus the camera's.
            out: Images of an earlier call to write into, with the same number of views.

        Returns:
            Images of C cameras in W worlds, all worlds of the first camera first: ``(C * W, height, width)``;
            their method `by_world` returns ``(W, C, height, width)``.

        Raises:
            CameraError: If a camera does not exist.
            ArrayError: If poses, worlds, `model` or `out` do not fit, or the poses of a world were never computed.
        """
        if self._appearance is not None:
            self._appearance.follow()
        chosen = choose_cameras(self.model, cameras, self.width, self.height)
        prepared = self._worlds.prepare(poses, chosen, worlds, model)
        place, indices, rows = prepared.place, prepared.indices, prepared.rows
        device, count = self.scene.device, len(indices)
        place.looks = None
        if self._appearance is not None:
            place.looks = self._appearance.of_worlds(appearances, prepared.source, prepared.models, (indices, rows))
        shape = (len(chosen) * count, self.height, self.width)
        views = batch_views(views_for(self._outputs, shape, device, out), len(chosen), count)
        drawn = self._number(rows, len(chosen), frame, view_index)
        self._worlds.for_each_group(
            prepared, lambda camera, members: self._caster.cast(camera, place, members, drawn, views)
        )
        self._worlds.give_back(prepared)
        return views

    def visibility(
        self,
        poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput,
        *,
        bodies: Sequence[str | int],
        cameras: CameraChoice | Sequence[CameraChoice] | None = None,
        subtree: bool = False,
        shaped: bool = False,
        canvas: tuple[int, int, int, int] | None = None,
        min_samples: int = 256,
        occluders: int = 3,
        worlds: ArrayLike | None = None,
        model: object | None = None,
    ) -> BodyVisibility:
        """Measure how much of some bodies is visible in some cameras in some worlds, and what hides the rest.

        Fractions are those of `warpvis.visible_fractions`, of the union of a body's geoms. As in images, surfaces
        nearer than the near plane are invisible with ``near_plane="clip"``.

        Args:
            poses: As for `render`, and so are `cameras`, `worlds` and `model`.
            bodies: Names or ids of bodies, each with all its rendered geoms and sites.
            cameras: The cameras, which must be perspective.
            subtree: Whether bodies include their descendants.
            shaped: Whether to compute `BodyVisibility.shaped`.
            canvas: As for `warpvis.visible_fractions`, and so are `min_samples` and `occluders`. With
                ``(0, 0, 0, 0)``, a fraction is that of the part inside the image.
            min_samples: Minimum number of rays through the rectangle that a body may cover.
            occluders: Number of occluders of each body.
            worlds: The worlds.
            model: Fields that differ between worlds.

        Raises:
            SceneError: If a body does not exist or has no rendered geoms.
            CameraError: If a camera does not exist.
            ArrayError: If poses, worlds, `canvas` or `model` do not fit.
        """
        chosen = choose_cameras(self.model, cameras, self.width, self.height)
        lenses = [require_perspective(camera.intrinsics) for camera in chosen]
        options: dict[str, Any] = {"canvas": check_canvas(canvas, lenses[0]), "shaped": shaped}
        options |= {"min_samples": min_samples, "occluders": occluders}
        ids, of_objects = choose_bodies(self.model, bodies), self._bodies_of_objects()
        parts = members_of_bodies(self.model, ids, of_objects, subtree=check_flag(subtree, "subtree"))
        groups = [np.flatnonzero(part).tolist() for part in parts]
        found = self._measure_groups(poses, groups, chosen, worlds, model, **options)
        names = tuple(self.model.body(body).name for body in ids)
        return BodyVisibility(names, **found, bodies=tuple(ids))

    def _measure_groups(
        self,
        poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput,
        groups: Sequence[Sequence[int]],
        chosen: list[BatchCamera],
        worlds: ArrayLike | None,
        model: object | None,
        **options: Any,
    ) -> dict[str, wp.array]:
        """Measure groups of the scene's objects with the options of `BodyMeter.measure`, ``(W, C, K, ...)`` by name."""
        prepared = self._worlds.prepare(poses, chosen, worlds, model)
        found = dict[str, wp.array]()

        def measure(camera: PlanarCamera, views: NDArray[np.int64]) -> None:
            self._meter.measure(require_perspective(camera), prepared.place, views, groups, found, **options)

        self._worlds.for_each_group(prepared, measure)
        self._worlds.give_back(prepared)
        return by_world(found, len(chosen), len(prepared.indices))

    def _bodies_of_objects(self) -> NDArray[np.int32]:
        """List the body of every object of the scene; -1 for those without a body."""
        numbers, bodies = self._numbers_of_objects(), np.append(shape_bodies(self.model), -1)
        return bodies[np.where(numbers < len(bodies) - 1, numbers, -1)].astype(np.int32)

    def _number(
        self,
        worlds: NDArray[np.int32],
        cameras: int,
        frame: int | ArrayInput | None,
        view_index: ArrayInput | None,
    ) -> NDArray[np.int64] | None:
        """Return number and frame of every view, which determine a sensor's random numbers; None without a sensor."""
        if self._sensor is None:
            if frame is not None or view_index is not None:
                raise ArrayError("frame and view_index require a sensor: pass sensor= to BatchRenderer")
            return None
        if view_index is None:
            view_index = (worlds.astype(np.int64) * cameras + np.arange(cameras)[:, None]).ravel()
        numbers = view_numbers(len(worlds) * cameras, self.frame if frame is None else frame, view_index)
        if frame is None:
            self.frame += 1
        return numbers

    def element_ids(self, views: Views, *, out: wp.array | None = None) -> wp.array:
        """Return the id and type of the element of every pixel, as `mujoco.Renderer` does in segmentation.

        Args:
            views: The result of `render`, with `segmentation`.
            out: An array to write into, of the same shape.

        Returns:
            Pairs of an id and its `mujoco.mjtObj` (mjOBJ_GEOM, mjOBJ_SITE, mjOBJ_TENDON, ...), shape ``(views, height,
            width, 2)`` int32; -1 and mjOBJ_UNKNOWN for objects that were added to the scene, -1 and -1 for no object.
        """
        pairs = np.array([(-1, UNKNOWN), *element_meanings(self.model)], dtype=np.int32)
        return look_up_pairs(views, pairs[self._numbers_of_objects() + 1], out)

    def geom_ids(self, views: Views, *, out: wp.array | None = None) -> wp.array:
        """Return the geom of every pixel; -1 for empty pixels, other elements, and objects added to the scene.

        Args:
            views: The result of `render`, with `segmentation`.
            out: An array to write into, of the same shape.

        Returns:
            Ids of the model's geoms, shape ``(views, height, width)`` int32.
        """
        return self._look_up(views, np.arange(self.model.ngeom), out)

    def body_ids(self, views: Views, *, out: wp.array | None = None) -> wp.array:
        """Return the body of every pixel; see `geom_ids`."""
        return self._look_up(views, shape_bodies(self.model), out)

    def semantic_ids(self, views: Views, classes: Mapping[str, int], *, out: wp.array | None = None) -> wp.array:
        """Return the class of every pixel.

        Args:
            views: The result of `render`, with `segmentation`.
            classes: Class numbers by name or pattern of geoms, sites, tendons, skins, flexes or bodies, as for
                `labels`; the last match counts.
            out: An array to write into, of the same shape.

        Returns:
            Class numbers, shape ``(views, height, width)`` int32; -1 for empty pixels and where no pattern matches.
        """
        return self._look_up(views, class_of_elements(self.model, classes), out)

    def _look_up(self, views: Views, of_elements: NDArray[np.integer], out: wp.array | None) -> wp.array:
        """Make images of a number that is given for the first or all elements, in the order of `object_names`."""
        objects = self._numbers_of_objects()
        is_known = (objects >= 0) & (objects < len(of_elements))
        numbers = np.where(is_known, of_elements[np.where(is_known, objects, 0)], -1).astype(np.int32)
        return look_up_objects(views, numbers, out)

    def _numbers_of_objects(self) -> NDArray[np.int32]:
        """List the number in `object_names` of every object's element; -1 for objects added to the scene."""
        shapes = self.mujoco_scene.shapes().tolist()
        known = [*shapes, *self._tendons.numbers, *self._soft.numbers()]
        return np.array(known + [-1] * (len(self.scene) - len(known)), dtype=np.int32)

    def camera(self, camera: CameraChoice) -> PlanarCamera:
        """Return intrinsics of a camera in this renderer's image size."""
        return camera_from_mujoco(self.model, camera, self.width, self.height)

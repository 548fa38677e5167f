# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: named, labeled triangle meshes, and their acceleration structures."""

from __future__ import annotations

import os
import warnings
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.rays import OnceCache
from warpvis.core.arrays import get_device
from warpvis.core.checks import as_items, check_flag, check_text, describe_exception, pluralize
from warpvis.core.labels import Label, LabelInput, LabelNames, LabelPatterns, LabelRules
from warpvis.core.poses import QuaternionOrder, check_quaternion, check_up, poses_to_opencv, read_pose, to_xyzw
from warpvis.core.types import ArrayInput, DeviceLike, MeshLike
from warpvis.errors import FileFormatError, SceneError, WarpvisError
from warpvis.scene._mesh import MeshCache
from warpvis.scene._object import IDENTITY, ObjectList, SceneObject, bounds_of, detach_all, take_snapshot
from warpvis.scene._parts import instance_runs, label_metadata
from warpvis.scene._updates import as_deforming, parse_normals, parse_vertices, place_object, read_mesh, with_mesh
from warpvis.scene.acceleration.geometry import SceneBvh, Triangles
from warpvis.scene.acceleration.scene_trees import SceneTrees
from warpvis.scene.acceleration.traversal_plan import plan_traversal
from warpvis.scene.appearances import LazyAppearance, choose_appearance
from warpvis.scene.joints import JointTree, SceneJoints
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, AppearanceLike, Material

if TYPE_CHECKING:
    import trimesh

    from warpvis.kernels.shading.base_colors import DeviceMaterials
    from warpvis.kernels.shading.lighting import Lights
    from warpvis.scene._device_materials import MaterialTables
    from warpvis.scene._parts import FileParts
    from warpvis.scene.device_sky import DeviceSkies
    from warpvis.scene.mirror_planes import Mirrors


class Scene:
    """Triangle meshes in the world frame, right-handed, in meters.

    Example:
        >>> scene = Scene()
        >>> scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(1, 0, 0.1, 0, 0, 0, 1))
        0
    """

    def __init__(
        self,
        *,
        device: DeviceLike = "cpu",
        up: Literal["z", "y"] = "z",
        label_names: Mapping[int, str] | None = None,
        ground_labels: Iterable[Label | int | str] = (Label.GROUND,),
    ) -> None:
        """Create an empty scene.

        Args:
            device: Device that renders it: ``"cpu"``, ``"cuda:0"``, ...
            up: The world's vertical axis.
            label_names: Names of user-defined classes, by their numbers from 0 to 255: ``{40: "road"}``. They extend or
                override those of `Label`.
            ground_labels: Classes that are ground; see `ground_labels`.
        """
        check_up(up)
        self.device = get_device(device)
        self.up: Literal["z", "y"] = up
        self._label_names = LabelNames(label_names)
        self.ground_labels = ground_labels
        self._lights: tuple[Light, ...] = ()
        self._background: Background | None = None
        self._joints = JointTree()
        self._links: dict[str, str] = {}  # links of the joints by the names of their objects
        self._meshes = MeshCache()
        self._objects = ObjectList()
        self._trees = SceneTrees(self.device)
        # Prepared ray bundles of the most recent renderers, by their inputs.
        self.cached_rays: dict[Hashable, OnceCache] = {}
        # Renderers with gradients, by their cameras and options; see `warpvis.rendering.differentiable`.
        self.differentiable: dict[Hashable, Any] = {}
        self.numbers_of_renderers: dict[Hashable, str] = {}
        self._lock = Lock()
        self._device_lights: tuple[tuple[Light, ...], Lights] | None = None
        self._skies: dict[bool, tuple[tuple[Background | None, ...], DeviceSkies]] = {}
        # The last tables, whose columns are used again where they do not change.
        self._material_tables: MaterialTables | None = None
        self._has_all_planes = False
        # Data derived from the objects, until these change.
        self._derived: dict[str, Any] = {}

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        device: DeviceLike = "cpu",
        up: Literal["z", "y"] | None = None,
        file_up: Literal["z", "y"] | None = None,
        scale: float = 1.0,
        labels: LabelInput | None = None,
        label_names: Mapping[int, str] | None = None,
        movable: bool | Sequence[str] = False,
        search_path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
        strict: bool = False,
        show_environment: bool = False,
    ) -> Scene:
        """Load a scene from a file: OBJ, STL, PLY, GLB and other formats of trimesh, Webots worlds, MJCF, or URDF.

        Every named part of the file becomes one object, in the file's order. Its label is taken from `labels`, else
        from the file (``"label"`` in the ``extras`` of a glTF node or mesh), else it is `Label.OBSTACLE`. For Webots
        worlds (``.wbt``), see `warpvis.webots.load_webots` about names, labels, and devices; for MJCF (``.xml``), which
        MuJoCo compiles, `warpvis.mujoco.read_model`. Surfaces of URDF (``.urdf``, ``.xacro``) are named after their
        links, and are `Label.ROBOT`; those of USD by their paths. A mesh file, URDF or USD stage without lights gets a
        headlight (`scene.lights.HEADLIGHT`), which affects the output ``color`` only.

        Args:
            path: The file.
            device: Device that renders the scene.
            up: The scene's vertical axis. By default that of the Webots world, else ``"z"``.
            file_up: The file's vertical axis. By default ``"y"`` for glTF, as in its specification, the axis defined in
                a COLLADA file or a USD stage, and the scene's axis for every other mesh format; where the two differ,
                the geometry is rotated upright. Webots, MJCF and URDF define it themselves.
            scale: Factor from a mesh file's unit to meters (0.001 for millimeters), in addition to the unit that
                COLLADA, 3MF and USD files define; other formats are in meters.
            labels: Labels by name; a name may be a pattern (``"wall_*"``), and the last match wins. Or a JSON, TOML or
                YAML file with such ``labels``, and optionally ``label_names`` and ``ground_labels``.
            label_names: Names of user-defined classes, as for `Scene`.
            movable: Names or patterns of the objects that are movable, each with a separate pose; or True for the
                moving bodies of MJCF or URDF, one pose for each body.
            search_path: Folders to search for other files that the file references: PROTO files and meshes of Webots,
                meshes and includes of MJCF, packages and meshes of URDF, buffers of glTF.
            strict: Whether unsupported content is an error. By default it is skipped, and a warning lists it.
            show_environment: Whether the images of an image-based light of glTF (EXT_lights_image_based) are the
                background, too. By default it only lights the scene, as in common viewers.

        Raises:
            FileFormatError: If the file is missing, does not parse, or contains an invalid mesh, or if it has
                unsupported content and `strict` is set.
            SceneError: If it contains no triangles, a pattern matches nothing, or an argument does not apply to it.
        """
        if up is not None:
            check_up(up)
        rules = LabelRules.of(labels, label_names)
        found = cls.read_parts(path, search_path=search_path, strict=strict)
        if check_flag(show_environment, "show_environment", SceneError) and found.sky is not None:
            found = replace(found, background=found.sky() or found.background)
        scene = cls(device=device, up=found.scene_up(up))
        scene.add_parts(found, rules, file_up=file_up, scale=scale, movable=movable)
        for message in found.warnings:
            warnings.warn(message, stacklevel=2)
        return scene

    @staticmethod
    def read_parts(
        path: str | os.PathLike[str],
        *,
        search_path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
        strict: bool = False,
    ) -> FileParts:
        """Read the parts of a file, which `load` adds to a new scene, and `add_parts` to an existing one.

        Args:
            path: The file.
            search_path: As for `load`.
            strict: As for `load`.
        """
        from warpvis.io import read_parts

        return read_parts(path, search_path=search_path, strict=strict)

    def add(
        self,
        mesh: MeshLike,
        *,
        name: str | None = None,
        label: Label | int | str = Label.OBSTACLE,
        pose: ArrayLike | None = None,
        quaternion: QuaternionOrder = "xyzw",
        scale: float | ArrayLike = 1.0,
        movable: bool = False,
        attach_to: str | None = None,
        appearance: AppearanceLike | LazyAppearance | None = None,
        category: str = "",
    ) -> int:
        """Add an object.

        Args:
            mesh: A `trimesh.Trimesh`, any other object with `vertices` and `faces`, or the pair ``(vertices, faces)``:
                vertices [m] of shape ``(n, 3)``, corner indices of shape ``(m, 3)``. A movable
                `warpvis.scene.solids.Solid` is rendered as the true round surface, from outside; otherwise as its
                triangles.
            name: A unique name; by default ``object_`` and the object's index, or the next free number.
            label: Class of its pixels: a `Label`, another number up to 255, or the name of one.
            pose: Object to world, ``x y z qx qy qz qw`` or a 4x4 matrix; identity by default.
            quaternion: Order of the quaternion in a pose of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
            scale: Scale factor, or three of them along the mesh's axes, applied before the pose.
            movable: Whether the object may have a different pose in each world of `Renderer.render`. Moving it rebuilds
                nothing, and movable objects with equal meshes share one tree. Static objects render faster, as one
                merged mesh; very many static objects with the same mesh share one tree, too.
            attach_to: Name of a movable object that this one is rigidly attached to. It then has no separate pose, and
                both render faster than two movable objects. Only for meshes, not for solids.
            appearance: A `scene.materials.Appearance`, a `Material`, or a color (red, green, blue, and optionally
                opacity, from 0 to 1, sRGB). By default trimesh's `visual`, which is read when
                `SceneObject.appearance` is first accessed, or colors are rendered.
            category: Its class in words (``"mug"``), finer than its label.

        Returns:
            The object's index, which is the value of its pixels in the object image.

        Raises:
            SceneError: If the mesh is empty or malformed, the name is taken, or the object cannot be attached.
        """
        name = self._objects.new_name(name)
        movable = check_flag(movable, "movable", SceneError)
        shared, solid, shown = read_mesh(self._meshes, mesh, scale, name, appearance)
        check_quaternion(quaternion)
        row = None if pose is None else read_pose(pose, quaternion, name=f"pose of {name!r}")
        number = self._label_names.number(label)
        parent = None if attach_to is None else self.index(attach_to)
        described: dict[str, Any] = {"category": check_text(category, "category", SceneError), "lazy_appearance": shown}
        item = SceneObject(name, number, shared, origin=row, solid=solid, parent=parent, **described)
        self._objects.append(place_object(item, self._objects, movable=movable))
        self._forget()
        return len(self._objects) - 1

    def add_instances(
        self,
        mesh: MeshLike,
        poses: ArrayInput,
        *,
        names: str | Sequence[str] | None = None,
        label: Label | int | str = Label.OBSTACLE,
        quaternion: QuaternionOrder = "xyzw",
        scale: float | ArrayLike = 1.0,
        movable: bool = True,
        appearance: AppearanceLike | LazyAppearance | None = None,
        category: str = "",
    ) -> range:
        """Add many objects with the same mesh, which share its memory and its tree.

        Static ones share a tree where there are enough of them for it to render faster than one merged mesh.

        Args:
            mesh: As for `add`.
            poses: Object to world, rows ``x y z qx qy qz qw``, shape ``(n, 7)``, or matrices ``(n, 4, 4)``.
            names: One name per pose, or a prefix: ``"chair"`` gives ``chair_0``, ``chair_1``, ...; by default
                ``object_`` and the objects' indices.
            label: As for `add`; the same for all.
            quaternion: Order of the quaternions in rows of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
            scale: As for `add`; the same for all.
            movable: As for `add`; the same for all.
            appearance: As for `add`; the same for all.
            category: As for `add`; the same for all.

        Returns:
            The objects' indices, in the order of the poses.
        """
        movable = check_flag(movable, "movable", SceneError)
        rows = poses_to_opencv(to_xyzw(poses, quaternion, "poses"), name="poses")
        chosen = self._objects.new_names(names, len(rows))
        subject = chosen[0] if chosen else "instances"
        shared, solid, shown = read_mesh(self._meshes, mesh, scale, subject, appearance)
        shared.check_reach(rows, subject)
        number = self._label_names.number(label)
        described: dict[str, Any] = {"category": check_text(category, "category", SceneError), "lazy_appearance": shown}
        if movable:
            item = SceneObject("", number, shared.single, IDENTITY, solid=solid, **described)
        else:
            item = SceneObject("", number, shared, shares_mesh=True, **described)
            shared.uses += len(rows)
        indices = self._objects.add_instances(chosen, rows, item)
        self._forget()
        return indices

    def add_parts(self, found: FileParts, rules: LabelRules, **options: Any) -> None:
        """Add the parts of a file, labeled by rules; options as for `FileParts.objects`."""
        self.use_labels(found.classes.followed_by(rules))
        parts = found.objects(self.up, labels=LabelPatterns(rules.labels, self._label_names), **options)
        scale = options.get("scale", 1.0)
        lights, background = found.environment(self.up, options.get("file_up"), scale)
        self.lights, self.background = (*self.lights, *lights), background or self.background
        if len(found.joints):
            self._joints = self._joints.joined(found.scene_joints(self.up, options.get("file_up"), scale))
            self._links |= {part.name: part.link for part in parts if part.link is not None}
        for run in instance_runs(parts):
            arguments = {**run[0].arguments(), "scale": scale}
            try:
                if len(run) == 1:
                    self.add(**arguments)
                    continue
                shared = {
                    name: arguments[name] for name in ("mesh", "label", "scale", "movable", "appearance", "category")
                }
                poses = np.stack([part.pose for part in run if part.pose is not None])
                self.add_instances(poses=poses, names=[part.name for part in run], **shared)
            except WarpvisError as error:
                raise FileFormatError(f"{found.path}: {describe_exception(error)}") from None

    def index(self, name: str) -> int:
        """Return the index of the object with the given name."""
        return self._objects.index_of(name)

    def update_vertices(self, name: str, vertices: ArrayInput, *, normals: ArrayInput | None = None) -> None:
        """Move the vertices of a movable object; its triangles are unchanged.

        The first call for an object gives it a separate tree without back-face culling and replaces a round solid by
        its triangles; the scene's trees are then rebuilt by the next render. Later calls refit the trees on the scene's
        device, which takes a fraction of the time. Refitting keeps the structure of the original tree, so rendering
        slows down if the shape changes a lot.

        Vertices that are on the scene's GPU are copied there and not read back, so their values are not checked: they
        must be finite. After one call and one render, such a call neither synchronizes nor allocates (except that
        `wp.Mesh.refit`, for the ``rays`` caster, takes memory from Warp's pool), so it can be captured with
        `Renderer.render` in a CUDA graph. Rebuilding the trees invalidates the graph.

        `SceneObject.vertices`, `bounds` and `export` use the newest vertices; they copy them from the device on access.

        Args:
            name: The object's name. It must have been added with ``movable=True``.
            vertices: Corners in the object's frame [m], as many as before, shape ``(n, 3)``: a host array or one on
                the scene's GPU; or `wp.vec3` of shape ``(n,)``. The scale that the object was added with is not
                applied again.
            normals: Shading normals for the output ``color``, as for `scene.materials.Appearance`: of the corners of
                the triangles, shape ``(m, 3, 3)``, or of the vertices, ``(n, 3)``. By default the triangles are flat.
        """
        index = self.index(name)
        self._objects.require_deformable(index)
        parsed = parse_vertices(vertices, self._objects[index], self.device)
        shading = None if normals is None else parse_normals(normals, self._objects[index])
        with self._lock:
            item = self._objects[index]
            if item.points is None:
                item = self._objects[index] = as_deforming(item, self.device)
                self._forget()
            wp.copy(item.points, parsed)
            self._trees.refit(index)
            if (shading is None) != (item.mesh.normals is None):
                empty = None if shading is None else wp.empty(shading.shape, dtype=wp.vec3, device=self.device)
                item.mesh.normals = empty
                self._derived.pop("materials", None)
            if shading is not None:
                wp.copy(item.mesh.normals, shading)

    def set_appearance(self, name: str, appearance: AppearanceLike | LazyAppearance | None) -> None:
        """Change the appearance of an object; the scene's trees are not rebuilt.

        Args:
            name: The object's name.
            appearance: As for `add`; None for white.

        Raises:
            SceneError: If there is no such object, or the appearance does not fit its mesh.
        """
        index = self.index(name)
        item = self._objects[index]
        counts = len(item.mesh.source), len(item.mesh.source_faces)
        chosen = choose_appearance(appearance, None, name, counts)
        with self._lock:
            self._objects[index] = replace(item, lazy_appearance=chosen)
            for key in ("objects", "materials", "isolated", "mirrors"):
                self._derived.pop(key, None)

    def update_mesh(
        self, name: str, vertices: ArrayInput, faces: ArrayInput | None = None, *, closed: bool = False
    ) -> None:
        """Replace the mesh of an object, for example after cutting, filling holes or marching cubes.

        The object's name, index, label and pose are unchanged. A movable object has a separate tree, and only that is
        rebuilt: at once, if the scene was rendered before. All static objects share one tree, which the next render
        rebuilds as a whole. To deform a mesh whose triangles do not change, use `update_vertices`, which builds no
        tree.

        A mesh on the scene's GPU is copied, checked and built into a tree there if the object is movable: the host
        reads only the number of ranges per level and whether the mesh is valid. `SceneObject.mesh_vertices` and `faces`
        are copied from the GPU on access.

        Other objects that share the old mesh keep it. A round solid is replaced by the mesh. CUDA graphs of renders
        captured before are invalid: they read memory that the scene has released.

        Args:
            name: The object's name. Attached objects, and objects that others are attached to, cannot change meshes.
            vertices: Corners [m], shape ``(n, 3)`` or `wp.vec3` of shape ``(n,)``, in the object's frame if it is
                movable, else in the world's. The scale that the object was added with is not applied again.
            faces: Corner indices of the triangles, shape ``(m, 3)``, int32 on a GPU; the object's faces by default.
            closed: Whether the mesh is known to be closed, with all normals outwards, so that its back faces can be
                culled where it is seen from outside of its box, which renders faster. `add` checks this itself, which
                takes longer than building a tree.
        """
        index = self.index(name)
        closed = check_flag(closed, "closed", SceneError)
        self._objects.require_detached(index, "mesh cannot be updated")
        item = with_mesh(self._objects[index], vertices, faces, self.device)
        with self._lock:
            self._trees.exchange(self._objects, index, item, closed=closed)
            self._derived = {}

    def replace_objects(self, objects: Sequence[SceneObject]) -> None:
        """Replace all objects of the scene, in this order; parents are indices into `objects`.

        From then on the scene caches its trees, so that only trees of new triangles are built.
        """
        listed = ObjectList(objects)
        with self._lock:
            self._objects = listed
            self._forget(cache_next=True)

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """The objects; values of the object image are indices into this."""
        return self._derived.get("objects") or self._derived.setdefault("objects", tuple(self._objects))

    @property
    def movable(self) -> tuple[int, ...]:
        """Indices of the movable objects with separate poses: the columns of `object_poses`."""
        return self._derived.get("movable") or self._derived.setdefault("movable", tuple(self._objects.movable))

    @property
    def joints(self) -> SceneJoints:
        """Joints of the loaded file, such as those of a robot: ``scene.joints.poses({"elbow": angles})``.

        Without joints in the file, `poses` returns the initial poses.
        """
        if "joints" not in self._derived:
            objects = [self._objects[index] for index in self.movable]
            links = [self._links.get(item.name) for item in objects]
            initial = np.array([item.place for item in objects]).reshape(-1, 7)
            self._derived["joints"] = SceneJoints(self._joints, links, initial)
        return self._derived["joints"]

    @property
    def label_names(self) -> LabelNames:
        """Names of the classes of pixels, by number: those of `Label` and user-defined ones.

        Add one by ``scene.label_names[40] = "road"``; ``scene.label_names.number("road")`` is the value of its pixels.
        """
        return self._label_names

    @label_names.setter
    def label_names(self, names: Mapping[int, str]) -> None:
        self._label_names = LabelNames(names)

    @property
    def ground_labels(self) -> frozenset[int]:
        """Classes that are ground: robots stand on them, and maps show them where there is no obstacle.

        Only `Label.GROUND` by default. All other classes except those of `Label` are obstacles.
        """
        return self._ground_labels

    @ground_labels.setter
    def ground_labels(self, labels: Iterable[Label | int | str]) -> None:
        self._ground_labels = frozenset(self._label_names.numbers(labels, "ground_labels"))

    @property
    def lights(self) -> tuple[Light, ...]:
        """Lights in the world's frame, as loaded from a file or set; none by default, without which colors are unlit.

        They shade the output ``color``. Lights that a file attaches to moving bodies stay at their initial positions.
        """
        return self._lights

    @lights.setter
    def lights(self, lights: Sequence[Light]) -> None:
        items = [lights] if isinstance(lights, Light) else as_items(lights, "lights", SceneError)
        invalid = [item for item in items if not isinstance(item, Light)]
        if invalid:
            raise SceneError(f"lights must be Lights, got {type(invalid[0]).__name__}")
        self._lights = tuple(items)

    @property
    def background(self) -> Background | None:
        """Background of rays that hit no object, as loaded from a file or set; None if not given."""
        return self._background

    @background.setter
    def background(self, background: Background | None) -> None:
        if background is not None and not isinstance(background, Background):
            raise SceneError(f"background must be a Background or None, got {type(background).__name__}")
        self._background = background

    @property
    def triangle_count(self) -> int:
        """Number of triangles of all objects."""
        return sum(count * item.triangle_count for _, count, item, _ in self._objects.runs())

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Minimum and maximum corner of the scene's axis-aligned box [m], shape ``(2, 3)``."""
        return bounds_of(self.require_objects())

    def __getitem__(self, name: str) -> SceneObject:
        return self._objects[self.index(name)]

    def __iter__(self) -> Iterator[SceneObject]:
        return iter(self.objects)

    def __len__(self) -> int:
        return len(self._objects)

    def __contains__(self, name: object) -> bool:
        return name in self._objects.names

    def __repr__(self) -> str:
        holds = f"{pluralize(len(self), 'object')}, {pluralize(self.triangle_count, 'triangle')}"
        return f"Scene({holds}, device={str(self.device)!r})"

    def use_labels(self, rules: LabelRules) -> None:
        """Add the class names of label rules, and their ground classes if given."""
        self._label_names.update(rules.label_names)
        if rules.ground_labels is not None:
            self.ground_labels = rules.ground_labels

    def require_objects(self) -> ObjectList:
        """Return the objects; raise a `SceneError` if the scene is empty."""
        if not self._objects.names:
            raise SceneError("the scene has no objects; add() one first")
        return self._objects

    def attached(self) -> dict[int, int]:
        """Return the parents of attached objects, by object index."""
        return self._objects.parents()

    def to(self, device: DeviceLike) -> Scene:
        """Return a copy of the scene on another device."""
        return self._copy(map(take_snapshot, self._objects), device)

    def _copy(self, objects: Iterable[SceneObject], device: DeviceLike) -> Scene:
        """Return a scene of other objects with the same settings."""
        scene = Scene(device=device, up=self.up, label_names=self._label_names, ground_labels=self._ground_labels)
        scene._objects, scene._lights, scene._background = ObjectList(objects), self._lights, self._background
        scene._joints, scene._links = self._joints, dict(self._links)
        return scene

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the objects without trees; another process builds them again."""
        classes = {"label_names": dict(self._label_names), "ground_labels": sorted(self._ground_labels)}
        state = {"device": str(self.device), "up": self.up, "lights": self.lights, "background": self.background}
        joints = {"joints": self._joints, "links": self._links}
        return {**state, **classes, **joints, "objects": [take_snapshot(item) for item in self._objects]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        arguments = {name: state[name] for name in ("device", "up", "label_names", "ground_labels")}
        self.__init__(**arguments)  # type: ignore[misc]
        self._objects, self.lights, self.background = ObjectList(state["objects"]), state["lights"], state["background"]
        self._joints, self._links = state["joints"], state["links"]

    def isolated(self) -> Scene:
        """Return a scene of the same objects, each movable and with a separate tree, so that each can be isolated.

        It is cached until the scene changes. The columns of its `object_poses` are all objects. A static object has its
        vertices in the world and the identity for a pose; if it shares a tree, its mesh's frame and its pose.
        """
        with self._lock:
            if "isolated" in self._derived:
                return self._derived["isolated"]
            instances = plan_traversal(self.require_objects(), self.device).instances
            isolated = self._copy(detach_all(self._objects, instances), self.device)
            if all(item.points is None for item in self._objects):  # else a replayed CUDA graph may deform them
                self._derived["isolated"] = isolated
            return isolated

    def to_trimesh(self) -> trimesh.Scene:
        """Return a `trimesh.Scene` of the objects in the same frame, with names, and labels in the meshes' metadata.

        Appearances, lights and the background are left out.
        """
        import trimesh

        scene = trimesh.Scene()
        for item in self._objects:
            mesh = trimesh.Trimesh(item.vertices, item.faces, process=False, metadata=self._metadata(item))
            scene.add_geometry(mesh, node_name=item.name, geom_name=item.name)
        return scene

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as glTF (``.glb``), y up as specified by the format; `load` reads it back with its labels.

        Every object is a node. Objects that share a mesh share it in the file. Nodes of these objects and of movable
        ones have transforms; the vertices of all others are in the world's frame. Appearances, lights and the
        background are left out.

        Raises:
            FileFormatError: If the path does not end in ``.glb`` or cannot be written, if vertices on a GPU are not
                finite, or if the file would exceed 4 GB, the format's limit.
        """
        from warpvis.io import export_scene

        objects = self.require_objects()
        export_scene(path, objects, map(self._metadata, objects), self.up)

    def _metadata(self, item: SceneObject) -> dict[str, int | str | bool]:
        """Return the metadata from which `load` restores the label of an object's mesh."""
        is_ground = item.label in self._ground_labels
        return label_metadata(self._label_names, item.label, item.category, is_ground=is_ground)

    def triangles(self, *, faces: bool = False) -> Triangles:
        """Return the triangles and Warp's trees of them, built on first use after a change.

        Args:
            faces: Whether to store the face index in the object's mesh for each triangle.
        """
        with self._lock:
            return self._trees.triangles(self.require_objects(), faces=faces)

    def bvh(self, *, faces: bool = False) -> SceneBvh:
        """Return the BVH, built on first use after a change.

        Args:
            faces: Whether to store the face index in the object's mesh for each triangle. This takes 4 bytes per leaf
                slot. Trees that were built without it are rebuilt, and all later ones are built with it.
        """
        with self._lock:
            return self._trees.bvh(self.require_objects(), faces=faces)

    def device_materials(self, background: Background | None) -> DeviceMaterials:
        """Return the device materials of the objects, created on first use after a change."""
        return self.device_alternatives(background, ())[0]

    def device_alternatives(
        self, background: Background | None, alternatives: Sequence[tuple[int, Material | Appearance]]
    ) -> tuple[DeviceMaterials, list[int]]:
        """Return the device materials with alternative appearances of objects.

        Args:
            background: What pixels show that see no object.
            alternatives: Objects with other appearances, or with other materials on their meshes.

        Returns:
            The materials, and the entry in them of each alternative.
        """
        from warpvis.scene._device_materials import MaterialTables
        from warpvis.scene.device_sky import set_background

        objects, movable = self.objects, self.movable
        with self._lock:
            tables = self._derived.get("materials")
            if tables is None or tables.stretches:
                options = {"has_all_planes": self._has_all_planes}
                tables = MaterialTables(objects, movable, self.device, self._material_tables, **options)
                self._derived["materials"] = self._material_tables = tables
            entries = [tables.entry(index, alternative) for index, alternative in alternatives]
            materials = tables.struct()
            set_background(materials, background)
            return materials, entries

    def mirrors(self) -> Mirrors | None:
        """Return the planes that mirror, found on first use after a change; None without any."""
        from warpvis.scene.mirror_planes import find_mirrors

        objects, movable = self.objects, self.movable
        with self._lock:
            if "mirrors" not in self._derived:
                self._derived["mirrors"] = find_mirrors(objects, movable, self.device)
            return self._derived["mirrors"]

    def require_planes(self) -> None:
        """Include the triangles of all meshes in the device materials from now on, which light at vertices needs."""
        with self._lock:
            if not self._has_all_planes:
                self._has_all_planes = True
                self._derived.pop("materials", None)

    def device_lights(self, lights: tuple[Light, ...]) -> Lights:
        """Return the lights on the device, created on first use after they were changed."""
        from warpvis.scene._device_lights import pack_lights

        with self._lock:
            if self._device_lights is None or self._device_lights[0] != lights:
                self._device_lights = lights, pack_lights(lights, self.device)
            return self._device_lights[1]

    def device_skies(self, background: Background | None, others: tuple[Background, ...] = ()) -> DeviceSkies:
        """Return the sky of the background and others that worlds may have, copied to the device after a change."""
        from warpvis.scene.device_sky import pack_skies

        key, kind = (background, *others), bool(others)
        with self._lock:
            if kind not in self._skies or self._skies[kind][0] != key:  # backgrounds are compared by identity
                self._skies[kind] = key, pack_skies(background, others, self.device)
            return self._skies[kind][1]

    def object_labels(self) -> wp.array:
        """Return the objects' labels on the scene's device, shape ``(objects,)`` uint8."""
        return wp.array(plan_traversal(self.require_objects(), self.device).labels, dtype=wp.uint8, device=self.device)

    def movable_sizes(self) -> wp.array:
        """Return the initial solid sizes of the movable objects on the device, shape ``(M,)`` vec4."""
        with self._lock:
            if "sizes" not in self._derived:
                sizes = plan_traversal(self._objects, self.device).solid_sizes[: len(self._objects.movable)]
                self._derived["sizes"] = wp.array(sizes, dtype=wp.vec4, device=self.device)
            return self._derived["sizes"]

    def movable_poses(self, worlds: int = 1) -> wp.array:
        """Return the initial poses of the movable objects on the device, shape ``(worlds, M)``; one world is cached."""
        with self._lock:
            if worlds == 1 and "poses" in self._derived:
                return self._derived["poses"]
            rows = plan_traversal(self._objects, self.device).movable_poses
            repeated = np.repeat(rows[None], worlds, axis=0)
            poses = wp.array(repeated, dtype=wp.transform, shape=repeated.shape[:2], device=self.device)
            if worlds == 1:
                self._derived["poses"] = poses
            return poses

    def _forget(self, *, cache_next: bool = False) -> None:
        """Drop the trees and all other data derived from the objects, since they have changed."""
        self._trees.forget(cache_next=cache_next)
        self._derived = {}
        if not cache_next:
            self._material_tables = None


def require_scene(scene: object) -> Scene:
    """Return `scene`, or raise a `SceneError` if it is not a `Scene`."""
    if not isinstance(scene, Scene):
        raise SceneError(f"scene must be a warpvis.Scene, got {type(scene).__name__}")
    return scene

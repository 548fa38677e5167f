# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A model's rangefinder sensors, read in one world or in many."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, cast

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, get_device, take_out
from warpvis.core.threads import check_threads, launch_images
from warpvis.core.types import ArrayInput, DeviceLike
from warpvis.errors import ArrayError, SceneError
from warpvis.mujoco._geoms import stored_mesh
from warpvis.mujoco._model_fields import ModelWatch, Watched, any_changed, check_shape_numbers
from warpvis.mujoco._poses import PoseSource, check_computed, read_frames, read_source
from warpvis.mujoco._rangefinder_rows import FrameCopies, ReadingRows
from warpvis.mujoco._worlds import Kinematics
from warpvis.rendering import Pool
from warpvis.scene import Mesh
from warpvis.scene.acceleration.geometry import make_mesh

_GEOM = mujoco.mjtGeom
_MESHES = (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_HFIELD)
# Type and data id of geoms that share a mesh.
_MeshKey: TypeAlias = tuple[int, int]
_RANGEFINDER = int(mujoco.mjtSensor.mjSENS_RANGEFINDER)
_OF_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_REAL, _POSITIVE = (int(getattr(mujoco.mjtDataType, f"mjDATATYPE_{name}")) for name in ("REAL", "POSITIVE"))

# Numbers of the fields that a sensor may write, by mujoco.mjtRayDataField.
_FIELD_SIZES = (1, 3, 3, 3, 3, 1)
# Corners of two triangles that face up.
_SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float64)
# Bounding spheres are larger than geoms by this factor, which covers the rounding of their radii.
_SLACK = 1.001
# Model fields that determine rays, in addition to the model's structure.
_RAY_FIELDS = ("sensor_cutoff", "cam_fovy", "cam_intrinsic", "cam_sensorsize")


class _Mesh(NamedTuple):
    """A mesh or a height field."""

    tree: wp.Mesh
    bound: float
    """Radius of a bounding sphere about the origin [m]."""


class Rangefinders:
    """A model's rangefinder sensors: distances along rays of sites and cameras, for one world or thousands at once.

    Readings equal the values that `mj_sensorPos` writes into `mjData.sensordata`, to single precision: `mj_ray` along z
    of a site, or through every pixel of a camera, ignoring the geoms of the sensor's body and fully transparent ones,
    and then the sensor's cutoff. Delays and intervals of sensors are ignored: readings are of the given poses. For a
    perspective camera MuJoCo misses some geoms that `mj_ray` hits (`mj_multiRay`); they are hit here.
    """

    def __init__(self, model: mujoco.MjModel, *, threads: int | None = None, device: DeviceLike = "cpu") -> None:
        """Read sensors and shapes from the model, to cast rays on a device.

        `read` follows later changes of the model: sizes, opacity, materials, vertices of meshes, heights of fields,
        cutoffs and fields of view. By default it uses all cores of this process.

        Raises:
            SceneError: If the model has none, has a signed distance field that a ray may hit (MuJoCo uses ray marching
                for those), or has numbers that are not finite.
        """
        if not isinstance(model, mujoco.MjModel):
            raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        found = np.flatnonzero(model.sensor_type == _RANGEFINDER)
        if not len(found):
            raise SceneError(f"model must have rangefinder sensors, got none among {model.nsensor} sensors")
        self.model = model
        self.sensors: NDArray[np.int32] = np.repeat(found, model.sensor_dim[found]).astype(np.int32)
        """The sensor of every number of a reading, shape ``(N,)``."""
        numbers = [np.arange(model.sensor_dim[sensor]) + model.sensor_adr[sensor] for sensor in found]
        self.addresses: NDArray[np.int32] = np.concatenate(numbers).astype(np.int32)
        """Indices into MuJoCo's sensor data: a reading is ``data.sensordata[addresses]``, shape ``(N,)``."""
        self.device = get_device(device)
        self._threads = check_threads(threads)
        self._kinematics = Kinematics(model, threads=threads)
        self._read_rays()
        self._read_geoms()

    def _read_rays(self) -> None:
        """Copy the model's rays to the device."""
        from warpvis.kernels.mujoco.rangefinders import SensorRays

        self._launches = Pool(2)
        self._ray_watch = [Watched(getattr(self.model, name)) for name in _RAY_FIELDS]
        self._rays = _sensor_rays(self.model, np.unique(self.sensors))
        self._ray_struct = SensorRays()
        kinds = {"site": (self._rays["site"], self.model.nsite), "cam": (self._rays["camera"], self.model.ncam)}
        # Kinds of frames that are read, and their numbers.
        self._counts = {"geom": self.model.ngeom} | {
            kind: count for kind, (ids, count) in kinds.items() if (ids >= 0).any()
        }
        for name, values in self._rays.items():
            dtype = {"i": wp.int32, "f": wp.vec3d if values.ndim == 2 else wp.float64}[values.dtype.kind]
            setattr(self._ray_struct, name, wp.array(values, dtype=dtype, device=self.device))

    def _read_geoms(self, meshes: Mapping[_MeshKey, _Mesh | None] = MappingProxyType({})) -> None:
        """Copy the model's shapes to the device; the given meshes are not rebuilt."""
        check_shape_numbers(self.model)
        for geom in np.flatnonzero(self.model.geom_type == int(_GEOM.mjGEOM_SDF)).tolist():
            if _is_met(self.model, geom) and (self._rays["body"] != self.model.geom_bodyid[geom]).any():
                raise SceneError(
                    "geoms must not be signed distance fields, in which MuJoCo marches rays in steps, "
                    f"got {self.model.geom(geom).name or geom!r}; rangefinders support the other types"
                )
        self._launches = Pool(2)
        self._geom_watch = ModelWatch(self.model, range(self.model.ngeom))
        self._meshes = dict(meshes)
        self._geom_struct = _ray_geoms(self.model, self.device, self._meshes)

    def _follow_model(self) -> None:
        """Read changed fields of the model again."""
        if any_changed(self._ray_watch):
            self._read_rays()
        if self._geom_watch.changed():
            if self._geom_watch.only_poses_changed():
                self._geom_watch.accept()
                return
            changed = self._geom_watch.changed_assets()
            self._read_geoms({key: mesh for key, mesh in self._meshes.items() if key not in changed})

    def read(
        self, poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput, *, out: wp.array | None = None
    ) -> wp.array:
        """Read all sensors.

        Args:
            poses: A `mujoco.MjData` after `mj_forward` or `mj_kinematics`; several; arrays of W worlds as for
                `geom_poses`, with `site_xpos` and `site_xmat` (for cameras, `cam_xpos` and `cam_xmat`); or joint
                positions, shape ``(nq,)`` or ``(W, nq)``, from which MuJoCo computes poses on the CPU.
            out: An array to write into, of the same shape.

        Returns:
            The values that `mj_sensorPos` writes, float32 on the device: distances [m], -1 where a ray hits nothing,
            and other fields that a sensor's `data` selects. Shape ``(N,)`` for one `mujoco.MjData` or one row of joint
            positions, else ``(W, N)``; one number per sensor, except where `sensors` repeats a sensor.

        Raises:
            ArrayError: If the poses are not of the model or were never computed, or `out` does not fit.
            SceneError: If the model now has numbers that are not finite, or a signed distance field that a ray may hit.
        """
        self._follow_model()
        source, single = _read_poses(poses, self._kinematics)
        columns = len(self.addresses)
        if self.device.is_cpu:
            # In one world, Python may take longer than casting the rays.
            launches = self._launches
            rows, copies = launches.take("world") or self._pack_world()
            fits = copies.copy(source)
            if fits:
                out = take_out(out, wp.float32, (columns,) if single else (1, columns), device=self.device)
                rows.run(1, out)
            launches.give_back("world", (rows, copies))
            if fits:
                return out
        check_computed(source, self._counts)
        frames = self._read_frames(source)
        worlds = len(frames["geom_xpos"])
        out = take_out(out, wp.float32, (columns,) if single else (worlds, columns), device=self.device)
        if self.device.is_cpu:
            self._launches.use("worlds", self._pack, lambda rows: rows.run(worlds, out, **frames))
        else:
            self._launch(frames, out.reshape((worlds, columns)))
        return out

    def _pack_world(self) -> tuple[ReadingRows, FrameCopies]:
        copies = FrameCopies(self._counts)
        return self._pack(**copies.arrays), copies

    def _pack(self, **frames: wp.array) -> ReadingRows:
        return ReadingRows(self._geom_struct, self._ray_struct, len(self.addresses), self._threads, **frames)

    def _launch(self, frames: Mapping[str, wp.array], readings: wp.array) -> None:
        """Read all sensors of all worlds, with one kernel thread for each ray."""
        from warpvis.kernels.mujoco.rangefinders import read_rangefinders

        geoms, *others = (
            [frames.get(f"{kind}_{part}") for part in ("xpos", "xmat")] for kind in ("geom", "site", "cam")
        )
        launch_images(
            read_rangefinders,
            (len(readings), 1, len(self._rays["body"])),
            lambda window: [self._geom_struct, *geoms, self._ray_struct, *others[0], *others[1], window, readings],
            device=self.device,
            threads=self._threads,
        )

    def _read_frames(self, source: PoseSource) -> dict[str, wp.array]:
        """Return the poses of geoms, and of the sites and cameras that have sensors, by name."""
        frames: dict[str, wp.array] = {}
        for kind, count in self._counts.items():
            frames[f"{kind}_xpos"], frames[f"{kind}_xmat"] = part = read_frames(source, kind, count, self.device)
            worlds = len(frames["geom_xpos"])
            if len(part[0]) != worlds:
                raise ArrayError(f"{kind}_xpos must be of as many worlds as geom_xpos, {worlds}, got {len(part[0])}")
        return frames

    def __getstate__(self) -> dict[str, Any]:
        derived = {"_launches", "_ray_struct", "_ray_watch", "_rays", "_geom_struct", "_geom_watch", "_meshes"}
        return {name: value for name, value in self.__dict__.items() if name not in derived} | {
            "device": str(self.device)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state | {"device": get_device(state["device"])}
        self._read_rays()
        self._read_geoms()


def _read_poses(
    poses: PoseSource | Sequence[mujoco.MjData] | ArrayInput, kinematics: Kinematics
) -> tuple[PoseSource, bool]:
    """Return a source of poses, and whether it is a single world without a world axis."""
    if isinstance(poses, mujoco.MjData):
        return poses, True
    source = read_source(poses)
    if source is not None:
        return source, False
    joints = as_numpy(cast("ArrayInput", poses), name="poses")
    return kinematics.from_qpos(joints), joints.ndim == 1


def _sensor_rays(model: mujoco.MjModel, sensors: NDArray[np.integer]) -> dict[str, NDArray]:
    """List the rays of the given sensors as fields of `warpvis.kernels.mujoco.rangefinders.SensorRays`."""
    parts, column = [], 0
    for sensor in sensors.tolist():
        frame, fields = int(model.sensor_objid[sensor]), int(model.sensor_intprm[sensor][0])
        of_site = int(model.sensor_objtype[sensor]) == _OF_SITE
        origin, direction = (np.zeros((1, 3)), np.eye(3)[2:]) if of_site else _pixel_rays(model, frame)
        size = sum(numbers for field, numbers in enumerate(_FIELD_SIZES) if fields >> field & 1)
        count, cutoff = len(direction), float(model.sensor_cutoff[sensor])
        clips = int(model.sensor_datatype[sensor]) if cutoff > 0 else None
        integers = {
            "site": frame if of_site else -1,
            "camera": -1 if of_site else frame,
            "body": (model.site_bodyid if of_site else model.cam_bodyid)[frame],
            "fields": fields,
            "column": column + size * np.arange(count),
        }
        limits = {
            "low": -cutoff if clips == _REAL else -np.inf,
            "high": cutoff if clips in (_REAL, _POSITIVE) else np.inf,
        }
        part = {name: np.full(count, value, dtype=np.int32) for name, value in integers.items()}
        part |= {name: np.full(count, value, dtype=np.float64) for name, value in limits.items()}
        parts.append(part | {"origin": origin, "direction": direction})
        column += size * count
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _pixel_rays(model: mujoco.MjModel, camera: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and unit directions of rays through a camera's pixels in its frame, row by row from the top.

    `mju_camIntrinsics` in src/engine/engine_support.c and `mju_camPixelRay` in engine_util_misc.c.
    """
    width, height = model.cam_resolution[camera].tolist()
    fovy, sensor = float(model.cam_fovy[camera]), model.cam_sensorsize[camera].astype(np.float64)
    right, up = np.meshgrid(np.arange(width) + 0.5, height - 0.5 - np.arange(height))
    zero, size = np.zeros(width * height), np.array([width, height], dtype=np.float64)
    # In meters for an orthographic image; otherwise in pixels, relative to the focal length.
    if int(model.cam_projection[camera]) == int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC):
        # Both half sides are fovy / 2, whatever the image's aspect.
        places = np.stack([right.ravel() / width - 0.5, up.ravel() / height - 0.5, zero], axis=-1) * [fovy, fovy, 1]
        return places, np.tile([0.0, 0.0, -1.0], (len(zero), 1))
    focal, center = np.full(2, 0.5 / np.tan(np.radians(fovy) / 2) * height), size / 2
    if sensor.all():
        focal, center = model.cam_intrinsic[camera].reshape(2, 2).astype(np.float64) / sensor * size
        center[1] = height - center[1]
    x, y = (right.ravel() - center[0]) / focal[0], (up.ravel() - center[1]) / focal[1]
    rays = np.stack([x, y, zero - 1], axis=-1)
    return np.zeros_like(rays), rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _is_met(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether rays hit a geom: the opacity of its material, or else its own, must not be 0 (`ray_eliminate`)."""
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return bool(rgba[3] != 0)


def _ray_geoms(model: mujoco.MjModel, device: wp.Device, meshes: dict[_MeshKey, _Mesh | None]) -> Any:
    """Return geoms that rays can hit as `kernels.mujoco.rangefinders.RayGeoms`; add their meshes to `meshes`."""
    from warpvis.kernels.mujoco.rangefinders import RayGeoms

    chosen, sizes, trees, bounds = list[int](), list[list[float]](), list[int](), list[float]()
    # Trees last: their traversal stops at the nearest hit so far.
    for geom in sorted(range(model.ngeom), key=lambda geom: int(model.geom_type[geom]) in _MESHES):
        kind, data = int(model.geom_type[geom]), int(model.geom_dataid[geom])
        if not _is_met(model, geom) or kind == _GEOM.mjGEOM_SDF:
            continue
        tree, (size, bound) = 0, _measure(kind, *model.geom_size[geom].tolist())
        if kind in _MESHES:
            if (kind, data) not in meshes:
                meshes[kind, data] = _make_mesh(model, kind, data, device)
            mesh = meshes[kind, data]
            if mesh is None:
                continue
            tree, bound = int(mesh.tree.id), mesh.bound
        chosen.append(geom)
        sizes.append(size)
        trees.append(tree)
        bounds.append(bound * _SLACK)
    arrays = {
        "geom": (chosen, wp.int32),
        "body": (model.geom_bodyid[chosen], wp.int32),
        "kind": (model.geom_type[chosen], wp.int32),
        "size": (np.reshape(sizes, (-1, 4)), wp.vec4),
        "mesh": (np.array(trees, dtype=np.uint64), wp.uint64),
        "bound": (bounds, wp.float64),
    }
    geoms = RayGeoms()
    for name, (values, dtype) in arrays.items():
        setattr(geoms, name, wp.array(values, dtype=dtype, device=device))
    return geoms


def _measure(kind: int, a: float, b: float, c: float) -> tuple[list[float], float]:
    """Return a geom's size as kernels read it, and the radius of its bounding sphere [m]; 0 for planes and meshes.

    Sizes of round shapes are radii and a half length in radii. `geom_rbound` is not read: MuJoCo does not update it
    when `geom_size` changes, and `mj_ray` does not use it.
    """
    if kind == _GEOM.mjGEOM_SPHERE:
        return [a, a, a, 0.0], a
    if kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER):
        return [a, a, a, b / a], a + b if kind == _GEOM.mjGEOM_CAPSULE else math.hypot(a, b)
    radii = {_GEOM.mjGEOM_BOX: math.hypot(a, b, c), _GEOM.mjGEOM_ELLIPSOID: max(a, b, c)}
    return [a, b, c, 0.0], radii.get(kind, 0.0)


def _make_mesh(model: mujoco.MjModel, kind: int, data: int, device: wp.Device) -> _Mesh | None:
    """Build the tree of a mesh or a height field, without sharing corners between triangles; None without triangles."""
    shape = stored_mesh(model, kind, data)
    if shape is None:
        return None
    corners = shape[0][shape[1]].reshape(-1, 3)
    if kind == _GEOM.mjGEOM_HFIELD:
        # The base is a box: a ray from inside the hills above it hits its top.
        corners = np.concatenate([corners, _SQUARE * np.r_[model.hfield_size[data][:2], 0.0]])
    if not np.isfinite(corners).all():
        names = {int(_GEOM.mjGEOM_HFIELD): "heights of hfield"}
        raise SceneError(f"{names.get(kind, 'vertices of mesh')} {data} must be finite")
    tree = make_mesh(Mesh(corners.astype(np.float32), np.arange(len(corners), dtype=np.int32).reshape(-1, 3)), device)
    return _Mesh(tree, float(np.linalg.norm(corners, axis=1).max()))

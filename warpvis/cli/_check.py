# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis check``: visibility of a scene's objects, or of points, from given poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from warpvis.cli._inputs import FrameOptions, MaybePoses, Names, SceneFile, refuse_options, split_names
from warpvis.cli._output import format_rows, require_place, with_help, write_json
from warpvis.core.checks import format_fraction
from warpvis.core.file_content import writing
from warpvis.errors import ArrayError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.cameras.frames import Frames
    from warpvis.cameras.image_cameras import ImageCamera
    from warpvis.scene import Scene
    from warpvis.visibility import ObjectVisibility

_LINES_PRINTED = 40


@with_help
@dataclass(frozen=True, kw_only=True)
class Check(FrameOptions):
    """Compute for each pose how much of each object is visible, or which points are, and why the others are not."""

    file: SceneFile
    poses: MaybePoses = None
    points: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Points in the world [m] to check instead of objects: text or CSV of lines x y z, .npy of shape (N, 3), or
    .ply."""
    objects: Names = ()
    """Names of the objects to check; all by default."""
    exclude: Names = ()
    """Names of objects that are invisible to the camera, such as the robot it is mounted on."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output file: .json with all results, or .npy with the points' status only, (poses, points) uint8."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output picture of the first pose: its depth, and the objects, each in its own color, or the points (.png, .pdf or
    .svg)."""
    tolerance: float = 1e-4
    """Maximum distance behind the first surface on its ray at which a point counts as visible [m]."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..."""

    def run(self) -> None:
        from warpvis.io import read_points

        self._check_options()
        points = None if self.points is None else read_points(self.points)
        scene, camera, frames = self.load(self.file, self.poses, device=self.device)
        if points is None:
            self._check_objects(scene, camera, frames)
        else:
            self._check_points(scene, camera, frames, points)
        written = [str(path) for path in (self.out, self.picture) if path is not None]
        if written:
            print(f"\n{', '.join(written)}")

    def _check_options(self) -> None:
        if self.points is not None and self.objects:
            raise ArrayError("give either --points or --objects, not both")
        if self.points is None:
            refuse_options(self, ("tolerance",), "without --points, give")
        if self.out is not None:
            require_place(self.out, [".json"] if self.points is None else [".json", ".npy"])
        if self.picture is not None:
            require_place(self.picture, [".png", ".pdf", ".svg"])

    def _check_objects(self, scene: Scene, camera: ImageCamera, frames: Frames) -> None:
        from warpvis.visibility import object_visibility

        objects, exclude = split_names(self.objects), split_names(self.exclude)
        names = objects or [item.name for item in scene if item.name not in exclude]
        seen = object_visibility(
            scene,
            camera,
            frames.camera_to_world,
            objects=names,
            exclude=exclude or None,
            object_poses=frames.object_poses,
            world_index=frames.world_index,
        )
        views = _object_report(scene, seen, frames)
        if self.picture is not None:
            from warpvis.viz import save_sightings

            save_sightings(scene, camera, objects=names, path=self.picture, **self._first_view(frames))
        if self.out is not None:
            write_json(self.out, {"file": str(self.file), "views": views})
        rows = []
        for view in views:
            for item in view["objects"]:
                share, status = format_fraction(item["fraction"]), item["status"].lower().replace("_", " ")
                pixels, hides = str(item["visible_pixels"]), item["occluder"] or ""
                rows.append([str(view["view"]), item["name"], share, pixels, status, hides])
        print(format_rows(["view", "object", "visible", "pixels", "status", "hidden by"], rows[:_LINES_PRINTED]))
        _print_rest(len(rows))

    def _first_view(self, frames: Frames) -> dict[str, Any]:
        """Return the arguments of pictures that select the first view."""
        first = frames[:1]
        world = 0 if first.world_index is None else first.world_index[0]
        return {
            "camera_to_world": first.camera_to_world[0],
            "title": f"{self.file.name}, first of {len(frames)} poses" if len(frames) > 1 else self.file.name,
            "object_poses": None if first.object_poses is None else first.object_poses[world],
            "exclude": split_names(self.exclude) or None,
        }

    def _check_points(self, scene: Scene, camera: ImageCamera, frames: Frames, points: NDArray[np.float64]) -> None:
        import numpy as np

        from warpvis.core.labels import Visibility
        from warpvis.visibility import point_visibility

        found = point_visibility(
            scene,
            camera,
            frames.camera_to_world,
            points,
            tolerance=self.tolerance,
            exclude=split_names(self.exclude) or None,
            object_poses=frames.object_poses,
            world_index=frames.world_index,
        )
        assert not isinstance(found, tuple)  # a tuple only with occluders, which were not requested
        status = found.numpy()
        if self.picture is not None:
            from warpvis.viz import save_point_sightings

            first = self._first_view(frames)
            save_point_sightings(scene, camera, points=points, path=self.picture, tolerance=self.tolerance, **first)
        kinds = [kind for kind in Visibility if kind != Visibility.UNKNOWN][::-1]
        counts = [{kind.name: int((row == kind).sum()) for kind in kinds} for row in status]
        if self.out is not None and self.out.suffix.lower() == ".npy":
            with writing(self.out):
                np.save(self.out, status)
        elif self.out is not None:
            names = np.array([kind.name for kind in Visibility])
            views = [
                {**_pose_report(k, frames), "counts": counts[k], "status": names[row].tolist()}
                for k, row in enumerate(status)
            ]
            write_json(self.out, {"file": str(self.file), "points": str(self.points), "views": views})
        header = ["view", "points", *(kind.name.lower().replace("_", " ") for kind in kinds)]
        rows = [[str(k), str(len(points)), *map(str, count.values())] for k, count in enumerate(counts)]
        print(format_rows(header, rows[:_LINES_PRINTED]))
        _print_rest(len(rows))


def _pose_report(view: int, frames: Frames) -> dict[str, Any]:
    pose = frames.camera_to_world[view].tolist()
    return {"view": view, "timestamp": float(frames.timestamps[view]), "pose": pose}


def _object_report(scene: Scene, seen: ObjectVisibility, frames: Frames) -> list[dict[str, Any]]:
    """Return the results of every view and object as plain Python values."""
    from warpvis.core.labels import Visibility

    status, occluder = seen.status.numpy(), seen.occluder.numpy()
    counts = {name: getattr(seen, name).numpy() for name in ("fraction", "visible_pixels", "silhouette_pixels")}
    boxes = {name: getattr(seen, name).numpy() for name in ("visible_box", "silhouette_box")}
    views: list[dict[str, Any]] = []
    for v in range(len(frames)):
        objects = [
            {
                "name": name,
                "status": Visibility(status[v, k]).name,
                **{field: array[v, k].tolist() for field, array in counts.items()},
                "occluder": scene.objects[occluder[v, k]].name if occluder[v, k] >= 0 else None,
                **{field: array[v, k].tolist() for field, array in boxes.items()},
            }
            for k, name in enumerate(seen.names)
        ]
        views.append({**_pose_report(v, frames), "objects": objects})
    return views


def _print_rest(count: int) -> None:
    if count > _LINES_PRINTED:
        print(f"... and {count - _LINES_PRINTED} more lines; --out writes all")

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis check``: which objects of a mesh file, or which points, are seen from given poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from warpvis.cli._inputs import format_rows, parse_labels, require_place, write_json
from warpvis.errors import ArrayError, FileFormatError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.core.camera import Camera
    from warpvis.scene import Scene
    from warpvis.visibility import ObjectVisibility

_LINES_PRINTED = 40


@dataclass(frozen=True)
class Check:
    """Say of every pose how much of each object is seen, or which points are, and why the others are not."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """Mesh file: OBJ, STL, PLY, GLB, ..."""
    poses: Path
    """Camera poses, camera to world, a line each: timestamp tx ty tz qx qy qz qw (TUM)."""
    points: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Points of the world in metres, in place of objects: text or CSV of lines x y z, .npy of shape (N, 3), or .ply."""
    objects: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Names of the objects; all by default."""
    exclude: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Names of objects that the camera does not see, such as the robot that carries it."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File to write: .json for all that is known, or .npy for the points' status alone, (poses, points) uint8."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Picture to write of the first pose: its depth, and the objects coloured by their status (.png, .pdf or .svg)."""
    camera: str = "kinect"
    """kinect, or a JSON file with width, height, hfov (radians) or K, near and far (metres)."""
    tolerance: float = 1e-4
    """How far behind the first surface on its ray a point still counts as seen [m]."""
    labels: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=LABEL ...")] = ()
    """What objects are: "ball=object" "wall_*=obstacle" ..."""
    convention: Literal["opencv", "opengl", "ros_body", "ros_optical"] = "opencv"
    """Axes of the camera frame of the poses."""
    scale: float = 1.0
    """Metres in a unit of the mesh file (0.001 for millimetres)."""
    up: Literal["z", "y"] = "z"
    """The world's vertical axis."""
    file_up: Literal["z", "y"] | None = None
    """The mesh file's vertical axis; y for glTF and the world's for other formats by default."""
    device: str = "cpu"
    """Where to compute: cpu, cuda:0, ..."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.core.poses import poses_to_opencv
        from warpvis.io import load_camera, read_points, read_poses
        from warpvis.scene import Scene

        self._check_options()
        camera = load_camera(self.camera)
        times, rows = read_poses(self.poses)
        poses = poses_to_opencv(rows, self.convention, name=str(self.poses))
        points = None if self.points is None else read_points(self.points)
        form: dict[str, Any] = {"up": self.up, "file_up": self.file_up, "scale": self.scale}
        scene = Scene.load(self.file, device=self.device, labels=parse_labels(self.labels), **form)
        if points is None:
            self._check_objects(scene, camera, times, poses)
        else:
            self._check_points(scene, camera, times, poses, points)
        written = [str(path) for path in (self.out, self.picture) if path is not None]
        if written:
            print(f"\n{', '.join(written)}")

    def _check_options(self) -> None:
        if self.points is not None and self.objects:
            raise ArrayError("give either --points or --objects, not both")
        if self.points is not None and self.picture is not None:
            raise ArrayError("--picture shows objects, so it does not go with --points")
        if self.out is not None:
            require_place(self.out, [".json"] if self.points is None else [".json", ".npy"])
        if self.picture is not None:
            require_place(self.picture, [".png", ".pdf", ".svg"])

    def _check_objects(self, scene: Scene, camera: Camera, times: Any, poses: NDArray[np.float64]) -> None:
        from warpvis.visibility import object_visibility

        exclude = self.exclude or None
        names = self.objects or [item.name for item in scene if item.name not in self.exclude]
        seen = object_visibility(scene, camera, poses, objects=names, exclude=exclude)
        views = _object_report(scene, seen, times, poses)
        if self.picture is not None:
            from warpvis.viz import save_sightings

            shown = self.objects or _of_interest(scene, self.exclude)
            title = f"{self.file.name}, first of {len(poses)} poses"
            save_sightings(scene, camera, poses[0], self.picture, objects=shown, exclude=exclude, title=title)
        if self.out is not None:
            write_json(self.out, {"file": str(self.file), "views": views})
        rows = []
        for view in views:
            for item in view["objects"]:
                share, status = f"{item['fraction']:.2f}", item["status"].lower().replace("_", " ")
                pixels, hides = str(item["visible_pixels"]), item["occluder"] or ""
                rows.append([str(view["view"]), item["name"], share, pixels, status, hides])
        print(format_rows(["view", "object", "visible", "pixels", "status", "hidden by"], rows[:_LINES_PRINTED]))
        _say_more(len(rows))

    def _check_points(
        self, scene: Scene, camera: Camera, times: Any, poses: NDArray[np.float64], points: NDArray[np.float64]
    ) -> None:
        import numpy as np

        from warpvis.core.labels import Visibility
        from warpvis.visibility import point_visibility

        given: dict[str, Any] = {"tolerance": self.tolerance, "exclude": self.exclude or None}
        found: Any = point_visibility(scene, camera, poses, points, **given)
        status = found.numpy()
        kinds = [kind for kind in Visibility if kind != Visibility.UNKNOWN][::-1]
        counts = [{kind.name: int((row == kind).sum()) for kind in kinds} for row in status]
        if self.out is not None and self.out.suffix.lower() == ".npy":
            try:
                np.save(self.out, status)
            except OSError as error:
                raise FileFormatError(f"{self.out}: cannot be written: {error.strerror}") from None
        elif self.out is not None:
            names = np.array([kind.name for kind in Visibility])
            views = [
                {**_pose_report(k, times, poses), "counts": counts[k], "status": names[row].tolist()}
                for k, row in enumerate(status)
            ]
            write_json(self.out, {"file": str(self.file), "points": str(self.points), "views": views})
        header = ["view", "points", *(kind.name.lower().replace("_", " ") for kind in kinds)]
        rows = [[str(k), str(len(points)), *map(str, count.values())] for k, count in enumerate(counts)]
        print(format_rows(header, rows[:_LINES_PRINTED]))
        _say_more(len(rows))


def _of_interest(scene: Scene, exclude: tuple[str, ...]) -> list[str]:
    """What a picture colours unless told: what is labelled object, or else all but the ground."""
    from warpvis.core.labels import Label

    others = [item for item in scene if item.name not in exclude]
    for chosen in ([item for item in others if item.label == Label.OBJECT], others):
        names = [item.name for item in chosen if item.label != Label.GROUND]
        if names:
            return names
    return [item.name for item in scene]


def _pose_report(view: int, times: Any, poses: NDArray[np.float64]) -> dict[str, Any]:
    return {"view": view, "timestamp": float(times[view]), "pose": poses[view].tolist()}


def _object_report(
    scene: Scene, seen: ObjectVisibility, times: Any, poses: NDArray[np.float64]
) -> list[dict[str, Any]]:
    """What is known of every view and object, of plain Python values."""
    from warpvis.core.labels import Visibility

    numbers = {name: getattr(seen, name).numpy() for name in ("fraction", "visible_pixels", "silhouette_pixels")}
    boxes = {name: getattr(seen, name).numpy() for name in ("visible_box", "silhouette_box")}
    status, occluder = seen.status.numpy(), seen.occluder.numpy()
    views = []
    for v in range(len(poses)):
        objects = []
        for k, name in enumerate(seen.names):
            hides = int(occluder[v, k])
            entry = {
                "name": name,
                "status": Visibility(status[v, k]).name,
                **{key: values[v, k].item() for key, values in numbers.items()},
                "occluder": scene.objects[hides].name if hides >= 0 else None,
                **{key: values[v, k].tolist() for key, values in boxes.items()},
            }
            objects.append(entry)
        views.append({**_pose_report(v, times, poses), "objects": objects})
    return views


def _say_more(count: int) -> None:
    if count > _LINES_PRINTED:
        print(f"... and {count - _LINES_PRINTED} more lines; --out writes all")

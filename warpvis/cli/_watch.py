# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis watch``: a map and who sees what, from the recording of a depth camera."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from warpvis.cli._output import require_place, with_help
from warpvis.core.checks import check_number, check_whole, format_percent
from warpvis.core.file_content import writing
from warpvis.errors import ArrayError, FileFormatError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.io import MeasuredFrame, Recording, Track
    from warpvis.maps import FloorFit
    from warpvis.viewer import WatchPage
    from warpvis.visibility import Agent, DepthWatcher, Watched

# Frames in which the floor is searched, spread evenly over the recording.
_FLOOR_FRAMES = 24

# Longest pause between two frames [s]: gaps in a recording are skipped.
_MAX_PAUSE = 2.0

# Frames per second of a recording without times.
_FRAME_RATE = 30.0

RecordingFormat = Literal["tum", "icl", "7scenes", "scannet", "redwood", "images", "ros", "lerobot"]


@with_help
@dataclass(frozen=True, kw_only=True)
class Watch:
    """Watch a recording of a depth camera: build a map, and report what the robot and people see of places of interest.

    Opens a page with the depth image, the map, unknown space and the answers as they change; --no-view prints them
    instead. Pages need pip install 'warpvis[view]'.
    """

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Folder or bag of the recording: TUM RGB-D, ICL-NUIM, 7-Scenes, ScanNet, Redwood, images with poses, a ROS bag, a
    LeRobot dataset."""
    people: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Poses of people's eyes over time, in the world and with the times of the recording's poses: CSV with columns
    timestamp, name, x, y, z, qx, qy, qz, qw, or the poses of one person in any format of poses."""
    places: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=X,Y,Z[,D]|FILE")] = ()
    """Places of interest in the same world [m]: "mug=1.2,0.3,0.8,0.1" is a sphere with a diameter, and without it a
    point; or a CSV file with columns name, x, y, z and optionally diameter, or a file of points."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output file of all answers, .csv or .json."""
    view: bool = True
    """Open a page; --no-view prints answers instead."""
    print_every: int = 10
    """Number of frames between two lines of --no-view."""
    every: int = 1
    """Use every Nth frame."""
    speed: float = 1.0
    """Speed of the page relative to the recording; 0 is as fast as possible, as without a page."""
    file_format: RecordingFormat | None = None
    """Format of the recording, if its files do not determine it."""
    camera: Annotated[str | None, tyro.conf.arg(metavar="kinect|FILE")] = None
    """Camera of the depth images, a file as for warpvis render; by default that of the recording."""
    unit: float | None = None
    """Length of one unit of the depth images [m]; by default that of the format."""
    poses: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File of the camera's poses, if the recording has none."""
    fixed: bool = False
    """The camera does not move and has no poses: its frame is the world."""
    topic: str | None = None
    """Topic of the depth images of a bag, if there are several."""
    world_frame: str | None = None
    """The tf frame that is the world of a bag; by default the root of the tree."""
    episode: int | None = None
    """Episode of a LeRobot dataset."""
    floor: float | None = None
    """Height of the floor in a world with z up [m]; by default, the floor is searched in the images."""
    up: Annotated[str | None, tyro.conf.arg(metavar="X,Y,Z")] = None
    """Approximate direction up in the world of the poses, which helps to find the floor: 0,0,1 for z."""
    camera_height: float | None = None
    """Approximate height of the camera above the floor [m], which helps to find the floor."""
    floor_confidence: float = 0.5
    """Minimum confidence of the floor that is found, from 0 to 1."""
    cell_size: float = 0.03
    """Side of a voxel of the map [m]."""
    max_range: float = 5.0
    """Maximum depth that is mapped [m]."""
    host: str = "localhost"
    """Address to listen on, as for warpvis view."""
    port: int = 8080
    """Port to listen on, or the next free one."""
    dark: bool = False
    """Use a dark theme."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..."""

    def run(self) -> None:
        check_whole(self.every, "every")
        check_whole(self.print_every, "print_every")
        check_number(self.speed, "speed", minimum=0.0)
        if self.out is not None:
            require_place(self.out, [".csv", ".json"])
        recording = self._open()
        tracks = self._read_people()
        watcher = self._make_watcher(recording)
        answers: list[dict[str, Any]] = []
        try:
            with self._page(watcher) as page:
                for index, watched in self._play(recording, watcher, tracks, page):
                    seconds = float(recording.timestamps[index])
                    progress = f"frame {index + 1} of {len(recording)}, time {seconds:.2f}"
                    if self.out is not None:
                        answers += _rows(index, seconds, watched)
                    if page is not None:
                        page.show(watched, progress)
                    elif (index // self.every) % self.print_every == 0:
                        print(f"{progress}: {_describe(watched)}", flush=True)
                if page is not None:
                    self._write(answers)
                    print("The recording has ended; Ctrl-C ends the page.", flush=True)
                    page.wait()
        finally:
            self._write(answers)

    def _open(self) -> Recording:
        """Open the recording; only frames with a pose are used."""
        import numpy as np

        from warpvis.io import load_camera, open_recording

        camera = None if self.camera is None else load_camera(self.camera)
        recording = open_recording(
            self.recording,
            file_format=self.file_format,
            camera=camera,
            unit=self.unit,
            poses=self.poses,
            topic=self.topic,
            world_frame=self.world_frame,
            episode=self.episode,
        )
        if not self.fixed:
            return recording.posed()
        if np.isfinite(recording.camera_to_world).any():
            raise FileFormatError(f"{self.recording}: has poses, so it takes no --fixed")
        return recording

    def _pose(self, frame: MeasuredFrame) -> NDArray[np.float64]:
        """Return the pose of a frame's camera."""
        return _identity() if self.fixed else frame.camera_to_world

    def _read_people(self) -> dict[str, Track]:
        from warpvis.io import read_tracks

        return {} if self.people is None else read_tracks(self.people)

    def _make_watcher(self, recording: Recording) -> DepthWatcher:
        from warpvis.visibility import DepthWatcher

        return DepthWatcher(
            recording.camera,
            places=_read_places(self.places),
            floor=self._find_floor(recording) if self.floor is None else self.floor,
            cell_size=self.cell_size,
            max_range=self.max_range,
            device=self.device,
        )

    def _find_floor(self, recording: Recording) -> FloorFit:
        """Search the floor in frames of the whole recording."""
        import numpy as np

        from warpvis.visibility import FloorSearch, search_floor

        up = None if self.up is None else _numbers(self.up, "--up", (3,))
        search = FloorSearch(
            recording.camera,
            up=up,
            camera_height=self.camera_height,
            interval=2,
            min_confidence=check_number(self.floor_confidence, "floor_confidence", minimum=0.0, maximum=1.0),
        )
        chosen = np.unique(np.linspace(0, len(recording) - 1, _FLOOR_FRAMES).astype(int)).tolist()
        frames = (recording[index] for index in chosen)
        try:
            floor = search_floor(search, ((frame.depth, self._pose(frame)) for frame in frames))
        except ArrayError as error:
            raise ArrayError(
                f"{error} (--camera-height, --up or --floor), or accept it with --floor-confidence"
            ) from None
        print(f"floor: {floor.camera_height:.2f} m below the camera, confidence {floor.confidence:.2f}", flush=True)
        return floor

    @contextlib.contextmanager
    def _page(self, watcher: DepthWatcher) -> Iterator[WatchPage | None]:
        if not self.view:
            yield None
            return
        from warpvis.viewer import WatchPage

        with WatchPage(watcher, host=self.host, port=self.port, dark=self.dark, speed=self.speed) as page:
            print(f"{page.url}  (Ctrl-C ends it)", flush=True)
            yield page

    def _play(
        self, recording: Recording, watcher: DepthWatcher, tracks: Mapping[str, Track], page: WatchPage | None
    ) -> Iterator[tuple[int, Watched]]:
        """Watch the frames at the speed of the page."""
        import numpy as np

        timed = not np.array_equal(recording.timestamps, np.arange(len(recording)))
        due, last = time.perf_counter(), None
        for index in range(0, len(recording), self.every):
            frame = recording[index]
            now = frame.timestamp
            people = _people_at(tracks, now)
            watched = watcher.update(frame.depth, self._pose(frame), people, time=now if timed else now / _FRAME_RATE)
            assert watched is not None and watched.time is not None  # the floor is known
            if page is not None:
                step = 0.0 if last is None else min(max(watched.time - last, 0.0), _MAX_PAUSE)
                due = page.wait_for(due, step)
            last = watched.time
            yield index, watched

    def _write(self, answers: Sequence[Mapping[str, Any]]) -> None:
        """Write the answers so far."""
        if self.out is None:
            return
        with writing(self.out):
            if self.out.suffix.lower() == ".json":
                content = {"recording": self.recording.name, "answers": list(answers)}
                self.out.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
            else:
                with self.out.open("w", newline="", encoding="utf-8") as file:
                    table = csv.DictWriter(file, _COLUMNS)
                    table.writeheader()
                    table.writerows(answers)


_COLUMNS = (
    "frame",
    "timestamp",
    "agent",
    "place",
    "status",
    "visible",
    "hidden",
    "unknown",
    "out_of_view",
    "unknown_length",
    "meant",
)


def _people_at(tracks: Mapping[str, Track], when: float) -> list[Agent]:
    """Return the people whose pose is known at a time."""
    from warpvis.visibility import Agent

    poses = {name: track.pose_at(when) for name, track in tracks.items()}
    return [Agent.human(name, pose) for name, pose in poses.items() if pose is not None]


def _rows(index: int, seconds: float, watched: Watched) -> list[dict[str, Any]]:
    """Return a row for every agent and place."""
    rows = []
    for agent, sights in watched.sights.items():
        for place, sight in sights.items():
            meant = watched.candidates.get(agent, {}).get(place)
            length = None if math.isnan(sight.unknown_length) else round(sight.unknown_length, 4)
            shares = {name: round(getattr(sight, name), 4) for name in ("visible", "hidden", "unknown", "out_of_view")}
            head = {"frame": index, "timestamp": seconds, "agent": agent, "place": place}
            meaning = {"unknown_length": length, "meant": None if meant is None else round(meant, 4)}
            rows.append({**head, "status": sight.status.name.lower(), **shares, **meaning})
    return rows


def _describe(watched: Watched) -> str:
    """Return all answers in one line."""
    parts = []
    for agent, sights in watched.sights.items():
        words = []
        for place, sight in sights.items():
            share = {"VISIBLE": sight.visible, "OCCLUDED": sight.hidden, "UNKNOWN": sight.unknown}.get(
                sight.status.name
            )
            text = sight.status.name.lower().replace("_", " ")
            words.append(f"{place} {text}" + ("" if share is None else f" {format_percent(share)}"))
        meant = watched.candidates.get(agent, {})
        best = max(meant, key=meant.__getitem__, default=None)
        words += [] if best is None else [f"means {best} {meant[best]:.2f}"]
        parts.append(f"{agent}: {', '.join(words) or 'no places'}")
    return "; ".join(parts)


def _read_places(words: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Read places given as name and numbers, or in files."""
    places: dict[str, NDArray[np.float64]] = {}
    for word in words:
        name, equals, numbers = word.partition("=")
        found = {name: _numbers(numbers, f"place {name!r}", (3, 4))} if equals else _read_place_file(Path(word))
        repeated = set(found) & set(places)
        if repeated:
            raise ArrayError(f"places must have different names, got {sorted(repeated)[0]!r} more than once")
        places |= found
    return places


def _read_place_file(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read lines of name, x, y, z and optionally diameter, or an array or a cloud of points."""
    from warpvis.core.file_content import read_text
    from warpvis.io import read_points

    if path.suffix.lower() in (".npy", ".ply"):
        return {f"point {index}": point for index, point in enumerate(read_points(path))}
    places: dict[str, NDArray[np.float64]] = {}
    for number, line in enumerate(read_text(path, "text").splitlines(), 1):
        name, _, numbers = (word.strip() for word in line.partition(","))
        if not line.strip() or line.startswith("#") or (name.lower() == "name" and not places):
            continue
        if not name or name in places:
            raise FileFormatError(f"{path}:{number}: must begin with the name of another place, got {name!r}")
        try:
            places[name] = _numbers(numbers, f"{path}:{number}: x, y, z and optionally diameter", (3, 4))
        except ArrayError as error:
            raise FileFormatError(str(error)) from None
    if not places:
        raise FileFormatError(f"{path}: holds no places, lines 'name,x,y,z,diameter'")
    return places


def _identity() -> NDArray[np.float64]:
    import numpy as np

    return np.array([0.0, 0, 0, 0, 0, 0, 1])


def _numbers(text: str, name: str, counts: tuple[int, ...]) -> NDArray[np.float64]:
    import numpy as np

    try:
        numbers = np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) not in counts or not np.isfinite(numbers).all():
        raise ArrayError(f"{name} must be {' or '.join(map(str, counts))} numbers, got {text!r}")
    return numbers

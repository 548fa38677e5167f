# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 node that maps a depth camera and reports what the robot and people see, and what people may mean.

    python ros2_watch.py --ros-args -p depth:=/camera/depth/image_rect -p camera_info:=/camera/depth/camera_info \
        -p fixed_frame:=map -p people:="anna=anna_head" -p places:="mug=1.2,0.3,0.8,0.1"

The node subscribes to depth images (16UC1 or 32FC1) and their CameraInfo; poses of the camera and of people come from
tf. It publishes `labels` (Image, mono8, values of wv.Label), `floor_map` (OccupancyGrid), and JSON text (String):
`visibility`, what everybody sees, and `candidates`, what people may mean. Its parameters are `PARAMETERS`.
Without ROS, the script watches rendered images.
"""

import array
import dataclasses
import json
import math
from collections import deque
from typing import Any

import numpy as np
import trimesh

import warpvis as wv

PARAMETERS = {
    "depth": "depth/image_rect",  # topic of the depth images
    "camera_info": "depth/camera_info",  # topic of their CameraInfo
    "fixed_frame": "map",  # tf frame of the map
    "people": "",  # "anna=anna_head ben=ben_head": tf frames of people's eyes
    "people_axes": "ros_body",  # axes of these frames: ros_body (x forward, z up) or ros_optical
    "places": "",  # "mug=1.2,0.3,0.8,0.1 door=4,0,1": x,y,z and optionally diameter in the fixed frame [m]
    "search_floor": False,  # search the floor in the images, instead of floor_height in a fixed frame with z up
    "floor_height": 0.0,
    "near": 0.2,
    "far": 8.0,
    "max_range": 5.0,
    "cell_size": 0.03,
    "robot_height": 1.2,  # floor_map is free where a robot of this height fits
    "map_rate": 1.0,  # of floor_map [1/s]
    "device": "cpu",
}

_WAITING = 5
"""Images that wait for the transform of their time, at most."""


def read_pairs(text: str) -> dict[str, str]:
    """Parse ``name=value name=value``."""
    return {name: value for name, _, value in (word.partition("=") for word in text.split())}


def pose_of(message: Any) -> list[float]:
    """Convert a TransformStamped to ``x y z qx qy qz qw``: the child's pose in the frame of the header."""
    position, rotation = message.transform.translation, message.transform.rotation
    return [position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w]


def seconds_of(stamp: Any) -> float:
    """Return the time of a stamp [s]."""
    return stamp.sec + 1e-9 * stamp.nanosec


def visibility_report(watched: wv.visibility.Watched) -> dict[str, dict[str, dict[str, Any]]]:
    """Return what everybody sees as JSON-compatible values, by agent and place."""
    return {
        agent: {
            place: {
                "status": sight.status.name.lower(),
                **{name: round(getattr(sight, name), 4) for name in ("visible", "hidden", "unknown", "out_of_view")},
            }
            for place, sight in sights.items()
        }
        for agent, sights in watched.sights.items()
    }


def place_in_frame(origin: Any, world_from_frame: np.ndarray) -> None:
    """Transform a Pose message in the floor's world, without rotation, to the fixed frame."""
    x, y, z, w = world_from_frame[3:]
    axis = np.array([-x, -y, -z])
    corner = np.array([origin.position.x, origin.position.y, origin.position.z]) - world_from_frame[:3]
    turn = 2 * np.cross(axis, corner)
    position = (corner + w * turn + np.cross(axis, turn)).tolist()
    origin.position.x, origin.position.y, origin.position.z = position
    for name, value in zip("xyzw", (*axis.tolist(), float(w)), strict=True):
        setattr(origin.orientation, name, value)


class Watch:
    """Connects a `DepthWatcher` to the topics of a node."""

    def __init__(self, node: Any, ros: Any) -> None:
        """Initialize with a node and the required parts of ROS; see `main`."""
        self._node, self._ros = node, ros
        self._set = {name: node.declare_parameter(name, value).value for name, value in PARAMETERS.items()}
        self._people = read_pairs(self._set["people"])
        self._watcher: wv.visibility.DepthWatcher | None = None
        self._camera: wv.Camera | None = None
        self._waiting: deque[Any] = deque(maxlen=_WAITING)
        self._stamp: Any = None
        self._warned: set[str] = set()
        self._labels = node.create_publisher(ros.Image, "labels", 5)
        self._maps = node.create_publisher(ros.OccupancyGrid, "floor_map", 1)
        self._visibility = node.create_publisher(ros.String, "visibility", 5)
        self._candidates = node.create_publisher(ros.String, "candidates", 5)
        node.create_subscription(ros.CameraInfo, self._set["camera_info"], self.take_camera, ros.sensor_qos)
        node.create_subscription(ros.Image, self._set["depth"], self.take_depth, ros.sensor_qos)
        node.create_timer(1 / self._set["map_rate"], self.publish_map)

    def take_camera(self, message: Any) -> None:
        """Start with an empty map when the first calibration arrives, or another one."""
        camera = wv.Camera.from_camera_info(message, near=self._set["near"], far=self._set["far"])
        if camera == self._camera:
            return
        self._camera = camera
        texts = read_pairs(self._set["places"])
        places = {name: np.array([float(word) for word in text.split(",")]) for name, text in texts.items()}
        self._watcher = wv.visibility.DepthWatcher(
            camera,
            places=places,
            floor=None if self._set["search_floor"] else self._set["floor_height"],
            up=(0, 0, 1) if self._set["search_floor"] else None,
            cell_size=self._set["cell_size"],
            max_range=self._set["max_range"],
            device=self._set["device"],
        )

    def take_depth(self, message: Any) -> None:
        """Watch an image as soon as tf knows the camera at its time: tf often arrives later."""
        self._waiting.append(message)
        while self._watcher is not None and self._waiting:
            image = self._waiting[0]
            found = self._find(image.header.frame_id, image.header.stamp)
            if found is None:
                self._warn_once(image.header.frame_id, f"tf has no {image.header.frame_id} at the times of images yet")
                return
            self._waiting.popleft()
            self._watch(image, pose_of(found))

    def _watch(self, message: Any, camera_pose: list[float]) -> None:
        depth, stamp = wv.io.from_image_msg(message), message.header.stamp
        watched = self._watcher.update(depth, camera_pose, self._find_people(stamp), time=seconds_of(stamp))
        if watched is None:
            self._warn_once("floor", self._watcher.problem)
            return
        self._stamp = stamp
        height, width = watched.labels.shape
        self._labels.publish(
            self._ros.Image(
                header=message.header,
                height=height,
                width=width,
                encoding="mono8",
                is_bigendian=0,
                step=width,
                data=array.array("B", watched.labels.tobytes()),
            )
        )
        header = {"stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec}, "frame_id": self._set["fixed_frame"]}
        report = {"header": header, "agents": visibility_report(watched)}
        self._visibility.publish(self._ros.String(data=json.dumps(report)))
        meant = {name: {place: round(p, 4) for place, p in of.items()} for name, of in watched.candidates.items()}
        self._candidates.publish(self._ros.String(data=json.dumps({"header": header, "people": meant})))

    def publish_map(self) -> None:
        """Publish which places of the floor are free."""
        if self._watcher is None or self._stamp is None:
            return
        grid = self._watcher.occupancy.occupancy_grid(max_height=self._set["robot_height"])
        message = wv.io.to_occupancy_grid(grid, frame_id=self._set["fixed_frame"], stamp=self._stamp)
        place_in_frame(message.info.origin, self._watcher.world_from_input)
        self._maps.publish(message)

    def _find_people(self, stamp: Any) -> list[wv.Agent]:
        """Return the people that tf knows at a time, or at their latest time."""
        agents = []
        for name, frame in self._people.items():
            found = self._find(frame, stamp) or self._find(frame, None)
            if found is None:
                self._warn_once(frame, f"tf does not know {frame} yet, so {name} is left out")
            else:
                agents.append(wv.Agent.human(name, pose_of(found), convention=self._set["people_axes"]))
        return agents

    def _find(self, name: str, stamp: Any) -> Any:
        time = self._ros.Time() if stamp is None else self._ros.Time.from_msg(stamp)
        try:
            return self._ros.buffer.lookup_transform(self._set["fixed_frame"], name, time)
        except self._ros.TransformException:
            return None

    def _warn_once(self, name: str, text: str) -> None:
        if name not in self._warned:
            self._warned.add(name)
            self._node.get_logger().warning(text)


@dataclasses.dataclass
class Ros:
    """The parts of ROS that a `Watch` uses."""

    Image: Any
    CameraInfo: Any
    String: Any
    OccupancyGrid: Any
    Time: Any
    buffer: Any
    TransformException: Any
    sensor_qos: Any


def main() -> None:
    """Run the node until it is stopped."""
    try:
        import rclpy
    except ImportError:
        show()
        return
    from nav_msgs.msg import OccupancyGrid
    from rclpy.qos import qos_profile_sensor_data
    from rclpy.time import Time
    from sensor_msgs.msg import CameraInfo, Image
    from std_msgs.msg import String
    from tf2_ros import Buffer, TransformException, TransformListener

    rclpy.init()
    node = rclpy.create_node("warpvis_watch")
    buffer = Buffer()
    listener = TransformListener(buffer, node)  # listens as long as it is referenced
    messages = (Image, CameraInfo, String, OccupancyGrid)
    watch = Watch(node, Ros(*messages, Time, buffer, TransformException, qos_profile_sensor_data))
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        del watch, listener
        node.destroy_node()
        rclpy.try_shutdown()


def show() -> None:
    """Watch rendered images of a room: a board hides the cup from Anna, and Ben looks through unmeasured space."""
    scene, camera = wv.Scene(), wv.Camera.from_fov(160, 120, hfov=math.radians(80), near=0.1, far=8.0)
    boxes = {"floor": ((8, 8, 0.1), (2, 0, -0.05)), "wall": ((0.1, 8, 3), (5.5, 0, 1.5)), "board": ((0.06, 1.2, 0.9),)}
    for name, (size, *place) in boxes.items():
        x, y, z = place[0] if place else (2.6, 0.6, 0.45)
        label = "ground" if name == "floor" else "obstacle"
        scene.add(trimesh.creation.box(size), name=name, label=label, pose=(x, y, z, 0, 0, 0, 1))
    cup = (2.0, 0.5, 0.6, 0.2)
    scene.add(trimesh.creation.icosphere(radius=cup[3] / 2), name="cup", pose=(*cup[:3], 0, 0, 0, 1))
    watcher = wv.visibility.DepthWatcher(camera, places={"cup": cup}, floor=0.0, sigma=0.005)
    people = [
        wv.Agent.human(name, wv.look_at(eyes, cup[:3]))
        for name, eyes in (("anna", (4.2, 0.6, 1.4)), ("ben", (0.5, 3.0, 1.4)))
    ]
    for side in (-0.5, 0.0, 0.5):
        pose = wv.look_at((0, side, 1.1), (2.4, 0, 0.4))
        depth = wv.render(scene, camera, pose, outputs="depth").depth
        watched = watcher.update(depth, pose, people, time=side)
    print("no ROS here; in rendered images,")
    for agent, places in visibility_report(watched).items():
        print(f"{agent}: {json.dumps(places)}")


if __name__ == "__main__":
    main()

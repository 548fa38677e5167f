# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 node that renders a robot's camera in a scene, including the robot, and reports the visibility of objects.

    python ros2_node.py --ros-args -p scene:=lab.glb -p fixed_frame:=map -p camera_frame:=camera_depth_optical_frame

The robot comes from `robot_description`; poses of its links and of the camera's optical frame come from tf. The node
publishes `depth/image_rect`, `camera_info`, `points` and `visibility` (JSON text), and `color/image_rect` and colored
points if the scene or the robot has colors. Its parameters are `PARAMETERS`.
Without ROS, the script renders one view of a robot with two links.
"""

import copy
import dataclasses
import json
import math
import os
import tempfile
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh

import warpvis as wv
from warpvis.scene.lights import AmbientOcclusion
from warpvis.scene.materials import Appearance, Material

PARAMETERS = {
    "scene": "",  # file of the robot's surroundings: glTF, OBJ, MJCF, a Webots world, ...
    "movable": "",  # movable objects, "cup=cup.glb bowl=bowl.obj": files in tf frames of the same names
    "fixed_frame": "map",  # tf frame of the scene
    "camera_frame": "camera_depth_optical_frame",
    "camera_info": "",  # topic of a real camera's CameraInfo, instead of the next three
    "width": 320,
    "height": 240,
    "hfov": 0.994837,
    "near": 0.3,
    "far": 4.5,
    "encoding": "32FC1",  # or 16UC1
    "objects": "",  # objects in `visibility`; by default all except the robot's links
    "exclude": "",  # invisible objects, such as links around the camera
    "shadows": True,  # of colors, like the next three
    "reflections": True,
    "ambient_occlusion": 0.0,  # distance up to which surfaces block ambient light, 0 for none
    "samples": 1,  # rays through each pixel at an edge: 1, 2, 4, 8 or 16
    "rate": 10.0,
    "device": "cpu",
}

Lookup = Callable[[str], Sequence[float] | None]
"""Returns a frame's pose in the fixed frame, ``x y z qx qy qz qw``, or None."""


@dataclasses.dataclass
class Part:
    """A mesh in the frame of a link or of a movable object, and its colors if it has any."""

    vertices: np.ndarray
    faces: np.ndarray
    appearance: Appearance | None

    @property
    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and faces."""
        return self.vertices, self.faces


def read_links(urdf: str, search_path: Sequence[str] = ()) -> dict[str, Part]:
    """Return the meshes of a robot's links in the links' tf frames."""
    robot = ElementTree.fromstring(urdf)
    shown = "visual" if robot.find("link/visual") is not None else "collision"
    shared = [item for item in robot if item.tag in ("material", "mujoco")]
    links = {}
    for link in robot.findall("link"):
        shapes = link.findall(shown)
        if not shapes:
            continue
        single = ElementTree.Element("robot", name=link.get("name", ""))
        single.extend(copy.deepcopy(shared))
        ElementTree.SubElement(single, "link", name=link.get("name", "")).extend(shapes)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "link.urdf"
            ElementTree.ElementTree(single).write(path)
            try:
                items = wv.Scene.load(path, search_path=search_path).objects
            except wv.WarpvisError as error:  # no mesh of this link was found
                warnings.warn(f"link {link.get('name')} is not shown: {error}", stacklevel=2)
                continue
        links[link.get("name", "")] = join(items)
    return links


def join(items: Sequence[wv.SceneObject]) -> Part:
    """Concatenate objects to one mesh with their materials and textures."""
    first = np.cumsum([0] + [len(item.vertices) for item in items])
    faces = [item.faces + start for item, start in zip(items, first, strict=False)]
    vertices, appearances = np.concatenate([item.vertices for item in items]), [item.appearance for item in items]
    if not any(appearances):
        return Part(vertices, np.concatenate(faces), None)
    materials: list[Material] = []
    rows, uv = [], []
    for item, found in zip(items, appearances, strict=True):
        appearance = found or Appearance()
        of_faces, corners = appearance.face_materials, appearance.corner_uv(item.faces)
        rows.append(np.full(len(item.faces), len(materials)) + (0 if of_faces is None else of_faces))
        uv.append(np.zeros((len(item.faces), 3, 2)) if corners is None else corners)
        materials += appearance.materials
    joined = Appearance(tuple(materials), face_materials=np.concatenate(rows), uv=np.concatenate(uv))
    return Part(vertices, np.concatenate(faces), joined)


def build_scene(
    file: str = "", urdf: str = "", *, movable: str = "", search_path: Sequence[str] = (), device: str = "cpu"
) -> tuple[wv.Scene, list[str]]:
    """Build a scene of a file, movable objects, and a robot's links; return it with the links' names."""
    scene = wv.Scene.load(file, device=device) if file else wv.Scene(device=device)
    for item in movable.split():
        name, _, part = item.partition("=")
        thing = join(wv.Scene.load(part).objects)
        scene.add(thing.mesh, name=name, label="object", movable=True, appearance=thing.appearance)
    links = read_links(urdf, search_path) if urdf else {}
    for name, link in links.items():
        scene.add(link.mesh, name=name, label="robot", movable=True, appearance=link.appearance)
    return scene, list(links)


def pose_of(message: Any) -> list[float]:
    """Convert a TransformStamped to ``x y z qx qy qz qw``: the child's pose in the frame of the header."""
    position, rotation = message.transform.translation, message.transform.rotation
    return [position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w]


class Eye:
    """A camera in a scene whose objects move."""

    def __init__(
        self,
        scene: wv.Scene,
        camera: wv.Camera,
        *,
        links: Iterable[str] = (),
        objects: Iterable[str] = (),
        exclude: Iterable[str] = (),
        **colors: Any,
    ) -> None:
        """Initialize with a scene, and names of the robot's links, of reported objects, and of invisible objects.

        `colors` are options of colors of `warpvis.Renderer`, such as `shadows`.
        """
        self.scene, self.camera = scene, camera
        self.lost: set[str] = set()
        """Objects whose pose was never found in tf."""
        self._exclude = set(exclude)
        objects_of_scene = [item.name for item in scene.objects if item.name not in set(links)]
        self._objects = list(objects) or objects_of_scene or list(links)
        has_color = any(item.appearance is not None for item in scene)
        self._renderer = wv.Renderer(scene, camera, outputs=("depth", "color") if has_color else ("depth",), **colors)
        self._poses = np.array([scene.objects[index].pose for index in scene.movable]).reshape(-1, 7)
        self._placed: set[str] = set()

    def follow(self, lookup: Lookup) -> None:
        """Update the poses of movable objects from tf; objects unknown to tf keep their last pose."""
        names = [self.scene.objects[index].name for index in self.scene.movable]
        for row, name in enumerate(names):
            pose = lookup(name)
            if pose is not None:
                self._poses[row] = pose
                self._placed.add(name)
        self.lost = set(names) - self._placed

    def look(self, camera_to_world: Sequence[float] | np.ndarray) -> tuple[wv.Views, dict[str, dict[str, Any]]]:
        """Render the camera's image, and compute the visibility of every object."""
        hidden = sorted(self._exclude | self.lost)  # lost objects would be at the origin
        world: dict[str, Any] = {"object_poses": self._poses if len(self._poses) else None, "exclude": hidden or None}
        views = self._renderer.render(camera_to_world, **world)
        report = wv.object_visibility(self.scene, self.camera, camera_to_world, objects=self._objects, **world)
        columns = (report.status, report.fraction, report.visible_pixels, report.occluder)
        rows = zip(report.names, *(column.numpy()[0].tolist() for column in columns), strict=True)
        return views, {
            name: {
                "status": wv.Visibility(status).name.lower(),
                "fraction": round(fraction, 4),
                "pixels": pixels,
                "hidden_by": self.scene.objects[occluder].name if occluder >= 0 else None,
            }
            for name, status, fraction, pixels, occluder in rows
        }


def describe(objects: dict[str, dict[str, Any]], frame_id: str, stamp: Any) -> str:
    """Format visibility as JSON, with the header of its images."""
    header = {"stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec}, "frame_id": frame_id}
    return json.dumps({"header": header, "objects": objects})


class Viewer:
    """Connects an `Eye` to the topics of a node."""

    def __init__(self, node: Any, ros: Any, search_path: Sequence[str] = ()) -> None:
        """Initialize with a node and the required parts of ROS; see `main`."""
        self._node, self._ros, self._search_path = node, ros, search_path
        self._set = {name: node.declare_parameter(name, value).value for name, value in PARAMETERS.items()}
        self._urdf = ""
        self._warned: set[str] = set()
        self._eye: Eye | None = None
        self._camera: wv.Camera | None = None
        if self._set["camera_info"]:
            node.create_subscription(ros.CameraInfo, self._set["camera_info"], self.take_camera, ros.sensor_qos)
        else:
            sizes = {name: self._set[name] for name in ("width", "height", "hfov", "near", "far")}
            self._camera = wv.Camera.from_fov(**sizes)
        node.create_subscription(ros.String, "robot_description", self.take_robot, ros.latched_qos)
        self._images = node.create_publisher(ros.Image, "depth/image_rect", 5)
        self._colors = node.create_publisher(ros.Image, "color/image_rect", 5)
        self._infos = node.create_publisher(ros.CameraInfo, "camera_info", 5)
        self._clouds = node.create_publisher(ros.PointCloud2, "points", 5)
        self._texts = node.create_publisher(ros.String, "visibility", 5)
        node.create_timer(1 / self._set["rate"], self.tick)
        self._open()

    def take_robot(self, message: Any) -> None:
        """Rebuild the scene with the robot of a message."""
        self._urdf = message.data
        self._open()

    def take_camera(self, message: Any) -> None:
        """Use a real camera's size and intrinsics."""
        camera = wv.Camera.from_camera_info(message, near=self._set["near"], far=self._set["far"])
        if camera != self._camera:
            self._camera = camera
            self._open()

    def _open(self) -> None:
        if self._camera is None or not (self._set["scene"] or self._urdf):
            return
        objects, exclude = (self._set[name].split() for name in ("objects", "exclude"))
        options = {"movable": self._set["movable"], "search_path": self._search_path, "device": self._set["device"]}
        scene, links = build_scene(self._set["scene"], self._urdf, **options)
        if not self._urdf:  # names of links are not known yet
            objects, exclude = ([name for name in names if name in scene] for names in (objects, exclude))
        colors = {name: self._set[name] for name in ("shadows", "reflections", "samples")}
        if self._set["ambient_occlusion"]:
            colors["ambient_occlusion"] = AmbientOcclusion(self._set["ambient_occlusion"])
        self._eye = Eye(scene, self._camera, links=links, objects=objects, exclude=exclude, **colors)

    def tick(self) -> None:
        """Render and publish images and visibility; do nothing while the camera is unknown to tf."""
        if self._eye is None or self._camera is None:
            return
        frame = self._set["camera_frame"]
        seen_from = self._find(frame, None)
        if seen_from is None:
            self._tell_once(frame, f"tf does not know {frame} in {self._set['fixed_frame']} yet")
            return
        stamp = seen_from.header.stamp
        if not (stamp.sec or stamp.nanosec):  # static transforms have no time
            stamp = self._node.get_clock().now().to_msg()
        self._eye.follow(lambda name: self._pose(name, stamp))
        for name in sorted(self._eye.lost):
            self._tell_once(name, f"tf does not know {name} yet, so it is not shown")
        views, objects = self._eye.look(pose_of(seen_from))
        header = {"frame_id": frame, "stamp": stamp}
        self._images.publish(wv.io.to_image_msg(views.depth, encoding=self._set["encoding"], **header))
        if views.color is not None:
            self._colors.publish(wv.io.to_color_msg(views.color, **header))
        self._infos.publish(self._camera.to_camera_info(**header))
        self._clouds.publish(wv.io.to_pointcloud2(views.depth, self._camera, colors=views.color, **header))
        self._texts.publish(self._ros.String(data=describe(objects, frame, stamp)))

    def _pose(self, name: str, stamp: Any) -> list[float] | None:
        """Find the pose of a frame at the time of the image, or else its latest pose."""
        found = self._find(name, stamp) or self._find(name, None)
        return None if found is None else pose_of(found)

    def _find(self, name: str, stamp: Any) -> Any:
        time = self._ros.Time() if stamp is None else self._ros.Time.from_msg(stamp)
        try:
            return self._ros.buffer.lookup_transform(self._set["fixed_frame"], name, time)
        except self._ros.TransformException:
            return None

    def _tell_once(self, name: str, text: str) -> None:
        if name not in self._warned:
            self._warned.add(name)
            self._node.get_logger().warning(text)


@dataclasses.dataclass
class Ros:
    """The parts of ROS that a `Viewer` uses."""

    Image: Any
    CameraInfo: Any
    PointCloud2: Any
    String: Any
    Time: Any
    buffer: Any
    TransformException: Any
    sensor_qos: Any
    latched_qos: Any


def main() -> None:
    """Run the node until it is stopped."""
    try:
        import rclpy
    except ImportError:
        show()
        return
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
    from rclpy.time import Time
    from sensor_msgs.msg import CameraInfo, Image, PointCloud2
    from std_msgs.msg import String
    from tf2_ros import Buffer, TransformException, TransformListener

    rclpy.init()
    node = rclpy.create_node("warpvis")
    buffer = Buffer()
    listener = TransformListener(buffer, node)  # listens as long as it is referenced
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    ros = Ros(
        Image, CameraInfo, PointCloud2, String, Time, buffer, TransformException, qos_profile_sensor_data, latched
    )
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    shares = [str(Path(prefix) / "share") for prefix in prefixes if prefix and (Path(prefix) / "share").is_dir()]
    viewer = Viewer(node, ros, search_path=shares)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        del viewer, listener
        node.destroy_node()
        rclpy.try_shutdown()


ROBOT = """
<robot name="stand">
  <link name="mast">
    <visual><origin xyz="0 0 0.5"/><geometry><box size="0.1 0.1 1"/></geometry></visual>
  </link>
  <link name="arm">
    <visual><origin xyz="0.3 0 0"/><geometry><cylinder radius="0.04" length="0.1"/></geometry></visual>
    <visual><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.04 0.04"/></geometry></visual>
  </link>
  <joint name="shoulder" type="continuous"><parent link="mast"/><child link="arm"/></joint>
</robot>
"""


def show() -> None:
    """Render one view with fixed poses instead of tf: an arm in front of a camera, and a cup behind it."""
    scene, links = build_scene(urdf=ROBOT)
    for name, x, y in (("cup", 1.5, 0.0), ("bowl", 1.5, 0.4), ("lamp", -2.0, 0.0)):
        scene.add(trimesh.creation.icosphere(radius=0.08), name=name, label="object", pose=(x, y, 0.95, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(320, 240, hfov=math.radians(60), near=0.1)
    eye = Eye(scene, camera, links=links, exclude=["mast"])
    frames = {"mast": (0, 0, 0, 0, 0, 0, 1), "arm": (0.4, 0, 0.95, 0, 0, 0, 1)}
    eye.follow(frames.get)
    _, objects = eye.look(wv.look_at((0, 0, 1), (1, 0, 1)))
    print("no ROS here; a camera on a mast sees")
    for name, seen in objects.items():
        print(f"{name}: {json.dumps(seen)}")


if __name__ == "__main__":
    main()

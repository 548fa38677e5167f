"""Cameras and lidars of SDF files."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import FileFormatError
from warpvis.io import read_sensors

from support.sdf_files import load, visual, world, write


def sensors(folder, body, **options):
    link = f'<link name="l"><pose>0 0 1 0 0 0</pose>{body}</link>'
    text = world(f'<model name="m"><pose>2 0 0 0 0 1.5707963267948966</pose>{link}</model>')
    return read_sensors(write(folder, text), **options)


def sensor(kind, content, more=""):
    return f'<sensor name="s" type="{kind}">{more}{content}</sensor>'


IMAGE = "<image><width>{}</width><height>{}</height></image>"


def test_camera_by_its_field_of_view(tmp_path):
    content = f"<camera><horizontal_fov>1.0</horizontal_fov>{IMAGE.format(64, 48)}"
    content += "<clip><near>0.2</near><far>30</far></clip></camera>"
    found = sensors(tmp_path, sensor("depth_camera", content, "<update_rate>30</update_rate>"))["m::l::s"]
    assert found.camera == wv.Camera.from_fov(64, 48, hfov=1.0, near=0.2, far=30)
    assert (found.kind, found.link, found.rate, found.is_lidar) == ("depth_camera", "m::l", 30, False)


def test_camera_looks_along_x_of_its_link_in_the_scene_of_the_file(tmp_path):
    """The model is rotated by 90 degrees, so that the camera looks along y: at a wall at a distance of 4 m."""
    camera = f"<camera><horizontal_fov>1.0</horizontal_fov>{IMAGE.format(9, 7)}</camera>"
    link = f'<link name="l"><pose>0 0 1 0 0 0</pose>{sensor("camera", camera)}</link>'
    wall = f'<link name="l">{visual("<box><size>20 1 20</size></box>")}</link>'
    text = world(
        f'<model name="m"><pose>2 0 0 0 0 1.5707963267948966</pose>{link}</model>'
        f'<model name="w"><static>1</static><pose>0 4.5 0 0 0 0</pose>{wall}</model>'
    )
    found = read_sensors(write(tmp_path, text))["m::l::s"]
    depth = wv.render(load(tmp_path, text), found.camera, found.pose).depth.numpy()
    assert np.allclose(depth, 4, atol=1e-5)


def test_intrinsics_of_a_lens(tmp_path):
    lens = "<lens><intrinsics><fx>50</fx><fy>51</fy><cx>30</cx><cy>25</cy></intrinsics></lens>"
    found = sensors(tmp_path, sensor("camera", f"<camera>{IMAGE.format(64, 48)}{lens}</camera>"))["m::l::s"]
    assert (found.camera.fx, found.camera.fy, found.camera.cx, found.camera.cy) == (50, 51, 30, 25)


@pytest.mark.parametrize(
    ("lens", "angle"),
    [("equidistant", 0.75), ("stereographic", 2 * np.arctan(0.5 * np.tan(0.75))), ("gnomonical", None)],
)
def test_wide_angle_cameras(tmp_path, lens, angle):
    """Halfway between the center and the edge of an image of 3 rad."""
    hfov = 3.0 if angle is not None else 1.0
    angle = np.arctan(0.5 * np.tan(0.5)) if angle is None else angle
    content = f"<camera><horizontal_fov>{hfov}</horizontal_fov>{IMAGE.format(2, 2)}"
    content += f"<lens><type>{lens}</type><cutoff_angle>3</cutoff_angle></lens></camera>"
    found = sensors(tmp_path, sensor("wideanglecamera", content))["m::l::s"]
    ray = found.camera.directions[0, 0]
    radius = np.hypot(0.5, 0.5)
    assert np.allclose(ray[:2] / np.hypot(*ray[:2]), (-(0.5**0.5), -(0.5**0.5)))
    if lens == "equidistant":
        assert np.isclose(np.arccos(ray[2]), angle * 2 * radius)


def test_lidar(tmp_path):
    scan = "<scan><horizontal><samples>5</samples><min_angle>-1</min_angle><max_angle>1</max_angle></horizontal>"
    scan += "<vertical><samples>3</samples><min_angle>-0.2</min_angle><max_angle>0.2</max_angle></vertical></scan>"
    content = f"<lidar>{scan}<range><min>0.1</min><max>12</max></range></lidar>"
    found = sensors(tmp_path, sensor("gpu_lidar", content))["m::l::s"]
    rays = found.camera
    assert found.is_lidar and rays.shape == (3, 5) and rays.axes == "ros_body" and (rays.near, rays.far) == (0.1, 12)
    assert np.allclose(rays.directions[1, 2], (1, 0, 0)) and np.allclose(rays.directions[0, 0, 2], np.sin(-0.2))
    assert rays.directions[0, 0, 1] < 0
    assert np.allclose(found.pose, (2, 0, 1, 0, 0, 0.5**0.5, 0.5**0.5))


def test_old_rays_and_several_cameras(tmp_path):
    ray = "<ray><scan><horizontal><samples>4</samples></horizontal></scan></ray>"
    assert sensors(tmp_path, sensor("ray", ray))["m::l::s"].camera.shape == (1, 4)
    cameras = '<camera name="left"><pose>0 0.1 0 0 0 0</pose></camera><camera name="right"/>'
    found = sensors(tmp_path, sensor("multicamera", cameras))
    assert list(found) == ["m::l::s::left", "m::l::s::right"]
    assert np.allclose(found["m::l::s::left"].pose[:3], (1.9, 0, 1))
    assert sensors(tmp_path, sensor("imu", "")) == {}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (f"<camera>{IMAGE.format(0, 10)}</camera>", "greater than 0"),
        ("<camera><horizontal_fov>9</horizontal_fov></camera>", "no valid sensor"),
        (f"<camera>{IMAGE.format(100000, 100000)}</camera>", "pixels"),
    ],
)
def test_bad_sensors(tmp_path, content, message):
    with pytest.raises(FileFormatError, match=message):
        sensors(tmp_path, sensor("camera", content))

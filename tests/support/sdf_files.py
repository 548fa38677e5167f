"""SDF files for tests."""

import warnings

import numpy as np
from PIL import Image

import warpvis as wv
from warpvis.io import read_parts


def world(body, version="1.9"):
    return f'<?xml version="1.0"?><sdf version="{version}"><world name="w">{body}</world></sdf>'


def model(body, name="m", version="1.9", more=""):
    return f'<sdf version="{version}"><model name="{name}" {more}>{body}</model></sdf>'


def visual(shape, name="v", more=""):
    return f'<visual name="{name}">{more}<geometry>{shape}</geometry></visual>'


BOX = "<box><size>1 2 3</size></box>"
BOX_LINK = f'<link name="l">{visual(BOX)}</link>'


def write(folder, text, name="file.sdf"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def read(folder, text, name="file.sdf", **options):
    """Return the parts of a file, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_parts(write(folder, text, name), **options)
    assert not found.warnings, found.warnings
    return found


def load(folder, text, name="file.sdf", **options):
    """Return the scene of a file, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(write(folder, text, name), **options)


def only(found):
    """Return the only part."""
    (part,) = found.parts
    return part


def image(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.asarray(pixels, dtype=np.uint8)).save(path)
    return path


def model_folder(folder, name, text, *, config=None):
    """Write a model's folder, with a model.config that names model.sdf."""
    write(folder / name, text, "model.sdf")
    config = config or f'<model><name>{name}</name><sdf version="1.9">model.sdf</sdf></model>'
    return write(folder / name, config, "model.config")


_LINKS = """
<link name="base"><pose degrees="true">0 0 1 0 0 90</pose>
<visual name="v"><geometry><mesh><uri>model://table/hand.stl</uri><scale>1 2 -1</scale></mesh></geometry>
<material><diffuse>1 0 0 0.5</diffuse><script><name>Gazebo/Red</name></script></material></visual>
<visual name="w"><pose relative_to="f"/><geometry><polyline><point>0 0</point><point>1 0</point><point>0 1</point>
<height>2</height></polyline></geometry><transparency>0.5</transparency></visual>
<light name="lamp" type="spot"><spot><outer_angle>1</outer_angle><falloff>1</falloff></spot></light>
<sensor name="c" type="wideanglecamera"><camera><horizontal_fov>2</horizontal_fov><image><width>4</width>
<height>3</height></image><lens><type>equidistant</type></lens></camera></sensor>
<sensor name="r" type="gpu_lidar"><lidar><scan><horizontal><samples>3</samples><min_angle>-1</min_angle>
<max_angle>1</max_angle></horizontal></scan><range><min>0.1</min><max>9</max></range></lidar></sensor></link>
<frame name="f" attached_to="base"><pose rotation_format="quat_xyzw">1 0 0 0 0 0 1</pose></frame>
<link name="arm"><pose relative_to="f"/><visual name="v"><geometry><capsule/></geometry></visual>
<visual name="x"><geometry><cone><radius>1</radius></cone></geometry></visual></link>
<joint name="j" type="revolute"><parent>base</parent><child>arm</child><axis><xyz expressed_in="f">0 1 0</xyz>
<limit><lower>-1</lower><upper>1</upper></limit></axis></joint>
"""
WHOLE = f"""<sdf version="1.9"><world name="w"><scene><ambient>1 1 1 1</ambient></scene>
<model name="r">{_LINKS}</model><light name="sun" type="directional"><direction>1 0 -1</direction></light>
<include><uri>model://table</uri><name>t</name><pose relative_to="r">1 0 0 0 0 0</pose></include>
<state><model name="r"><pose>1 2 3 0 0 0</pose></model></state></world></sdf>"""
"""A world with most elements, which includes the model `TABLE`."""
TABLE = """<sdf version="1.6"><model name="table"><static>1</static><link name="l"><visual name="v">
<geometry><plane><normal>0 0 1</normal><size>3 2</size></plane></geometry></visual></link></model></sdf>"""
CONFIG = '<model><name>table</name><sdf version="1.6">model.sdf</sdf></model>'

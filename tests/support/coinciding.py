# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo models with surfaces that coincide."""

import mujoco

import warpvis as wv
from warpvis.mujoco import camera_poses, scene_from_mujoco
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer

WEDGE = "0 0 0  .3 0 0  .3 .2 0  0 .2 0  0 .1 .2  .3 .1 .2"
# Each shape twice at one position: first the collision geom, then the visual geom.
TWICE = {
    "box": 'type="box" size=".2 .15 .1"',
    "sphere": 'type="sphere" size=".2"',
    "ellipsoid": 'type="ellipsoid" size=".2 .15 .1"',
    "capsule": 'type="capsule" size=".1 .15"',
    "cylinder": 'type="cylinder" size=".15 .1"',
    "mesh": 'type="mesh" mesh="wedge"',
    "plane": 'type="plane" size=".3 .3 .1"',
}
HEAD = f"""<mujoco><statistic extent="2"/><visual><map znear=".005" zfar="20"/><quality offsamples="0"/></visual>
  <asset><mesh name="wedge" vertex="{WEDGE}"/></asset><worldbody>
  <camera name="eye" pos="-.4 -.9 .8" xyaxes="1 -.4 0 .25 .6 .8" fovy="60"/>"""
# Flush surfaces of different shapes, fixed and moving, and objects that rest on others without coinciding.
FLUSH = f"""{HEAD}
  <geom name="table" type="box" size=".6 .5 .05" pos="0 0 -.05"/>
  <geom name="mat" type="box" size=".2 .2 .02" pos=".1 .1 -.02" euler="0 0 25"/>
  <geom name="spot" type="cylinder" size=".12 .01" pos="-.25 .1 -.01"/>
  <geom name="spot2" type="cylinder" size=".1 .02" pos="-.2 .15 -.02"/>
  <geom name="brick" type="box" size=".05 .05 .05" pos=".4 -.3 .05"/>
  <geom name="paper" type="box" size=".05 .05 .0005" pos=".2 -.3 .0005"/>
  <body name="tool" pos="-.1 -.2 .3" quat="1 .2 .3 .1"><freejoint/>
    <geom name="block" type="box" size=".1 .06 .06"/>
    <geom name="plate" type="box" size=".06 .09 .02" pos=".05 0 .04"/>
    <geom name="rod" type="capsule" size=".03 .08" pos="-.15 0 0"/>
    <geom name="knob" type="sphere" size=".03" pos="-.15 0 .08"/>
    <geom name="tube" type="cylinder" size=".03 .05" pos="-.15 0 -.02"/>
    <geom name="hoof" type="mesh" mesh="wedge" pos=".1 .1 0"/>
  </body></worldbody></mujoco>"""


def model_of(text):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def twice(kind, *, moving):
    joint = "<freejoint/>" if moving else ""
    pair = "".join(f'<geom name="{name}" {TWICE[kind]}/>' for name in ("collision", "visual"))
    wall = '<geom name="wall" type="box" size="3 .1 3" pos="0 2 0"/>'
    return model_of(f'{HEAD}<body pos="0 0 .1" euler="20 0 30">{joint}{pair}</body>{wall}</worldbody></mujoco>')


def renderer_of(model, device, **options):
    geoms = scene_from_mujoco(model, device=device)
    camera = wv.mujoco.camera_from_mujoco(model, "eye", 160, 120)
    return geoms, GeomRenderer(geoms.scene, camera, CoincidingGeoms(model, geoms.scene, geoms.geom_ids), **options)


def eye_of(model, data):
    return camera_poses(data, model, [0])

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Files with lights."""

import mujoco
import numpy as np
from gltf_files import GltfWriter

MODEL = """<mujoco><visual><headlight ambient=".1 .1 .1" diffuse=".2 .1 .1" specular=".3 .3 .3"/>
<quality offsamples="0"/></visual><worldbody>
<geom name="floor" type="plane" size="2 2 .01" rgba=".6 .7 .8 1"/>
<body pos="1 0 0" euler="0 0 90"><geom size=".001" pos="0 0 -1"/>
<light name="lamp" type="spot" pos="0 0.5 1" dir="0 1 -2" diffuse=".9 .5 .3" ambient=".1 .2 .1" specular=".4 .4 .4"
attenuation="1 .2 .1" cutoff="40" exponent="5" castshadow="false"/></body>
<light name="sun" type="directional" dir="1 0 -1" diffuse=".3 .3 .5" specular="0 0 0" castshadow="false"/>
<light name="off" active="false"/></worldbody></mujoco>"""
SIZE = 64


def picture(model, eye, forward, up=(0.0, 1, 0), tangent=0.5):
    """Return an image of MuJoCo's renderer and the rays of its pixels."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, SIZE, SIZE) as renderer:
        renderer.update_scene(data)
        forward = np.array(forward) / np.linalg.norm(forward)
        right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
        for camera in renderer.scene.camera:
            camera.pos, camera.forward, camera.up = eye, forward, np.cross(right, forward)
            camera.frustum_center, camera.frustum_top = 0, tangent * camera.frustum_near
            camera.frustum_bottom = -camera.frustum_top
        for light in renderer.scene.lights[: renderer.scene.nlight]:
            if light.headlight:
                light.pos, light.dir = eye, forward
        image = renderer.render().astype(np.float64) / 255
    steps = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * tangent
    rays = forward + steps[None, :, None] * right - steps[:, None, None] * np.cross(right, forward)
    return image, rays


def lit_file():
    """Return a glTF file with lights, two of them invalid."""
    lights = [
        {"type": "directional", "color": [1, 0.5, 0], "intensity": 3},
        {"type": "spot", "name": "spot", "range": 2, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}},
        {"type": "point"},
        {"type": "area"},
    ]
    writer = GltfWriter(extensions={"KHR_lights_punctual": {"lights": lights}})
    writer.node(writer.primitive([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    turned = {"translation": [1, 2, 3], "rotation": [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], "scale": [2, 2, 2]}
    for number in (0, 1, 2, 3, 9):
        writer.node(name=f"n{number}", extensions={"KHR_lights_punctual": {"light": number}}, **turned)
    return writer.bytes()


WORLD = """#VRML_SIM R2023b utf8
WorldInfo {}
Background { skyColor [ 0.5 0.25 0 ] luminosity 2 %s }
Background { skyColor [ 1 1 1 ] }
DirectionalLight { ambientIntensity 0.5 color 1 0.5 0 direction 0 1 -1 intensity 2 castShadows TRUE }
PointLight { on FALSE }
PointLight { color "red" }
Solid { translation 0 0 1 rotation 0 0 1 1.5707963267948966 children [
  DEF LAMP PointLight { location 1 0 0 attenuation 0 0 1 ambientIntensity 1 radius 5 }
  SpotLight { direction 1 0 0 beamWidth 0.2 cutOffAngle 0.6 }
  Shape { geometry Box {} } ] }
"""

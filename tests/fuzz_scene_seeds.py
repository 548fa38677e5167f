# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small files of every scene format, written by the tests' writers, and their readers, for `fuzz_files`."""

from __future__ import annotations

import base64
import bz2
import gzip
import io
import json
import lzma
import tarfile
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

import warpvis as wv

Item = tuple[str, dict[str, bytes | str], Sequence[str], Callable[[Path], None]]
"""A format; files by name; the names to change (empty for all); and a reader that takes their folder."""

_BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
_BOX = trimesh.creation.box((1, 2, 3))


def see(scene: wv.Scene) -> None:
    """Describe and render a scene."""
    from warpvis.cli._info import describe
    from warpvis.pose_generators import framing

    describe(scene)
    _ask_for_colors(scene)
    assert all(np.isfinite(light.strength(np.full((1, 3), 7.5))).all() for light in scene.lights)
    if len(scene):
        whole = wv.Camera.from_fov(12, 9, hfov=1.0)
        wv.render(scene, whole, framing(scene, whole))


def _ask_for_colors(scene: wv.Scene) -> None:
    """Read the appearance of objects: damaged image files only warn."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sky = None if scene.background is None else scene.background.image
        assert sky is None or sky.shape[0] == 6 * sky.shape[1]
        for item in scene:
            found = item.appearance
            for material in () if found is None else found.materials:
                assert material.texture is None or material.texture.image.shape[2] in (3, 4)
            assert found is None or found.uv is None or found.corner_uv(item.faces).shape == (*item.faces.shape, 2)


def _see_file(name: str, **options: object) -> Callable[[Path], None]:
    return lambda folder: see(wv.Scene.load(folder / name, **options))


def _see_sensors(name: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        for sensor in wv.io.read_sensors(folder / name).values():
            assert np.isfinite(sensor.pose).all() and sensor.camera.width > 0

    return read


def _see_world(name: str, *search_path: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        world = wv.webots.load_webots(folder / name, search_path=[folder / place for place in search_path])
        see(world.scene)
        assert all(np.isfinite(pose).all() for pose in world.scene.joints.link_poses().values())
        for scan, lidar in world.lidars.items():
            if lidar.layers * lidar.columns <= 10_000:
                lidar.points(wv.webots.render_lidar(world, scan, webots_version="header"))

    return read


def meshes(root: Path) -> Iterator[Item]:
    from support.appearance_files import MTL, OBJ as COLORED, png as picture
    from support.damaged_files import ply
    from support.mesh_files import OBJ, SOLIDS, dae, threemf

    mtl = "newmtl red\nKd 1 0 0\nmap_Kd red.png\n"
    box = trimesh.exchange.obj.export_obj(_BOX)
    relative = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nf -3/1/1 -2//1 -1 \\\n 1\n"
    for text in (f"mtllib a.mtl\n{OBJ}", box, relative):
        yield "OBJ and MTL", {"a.obj": text, "a.mtl": mtl}, (), _see_file("a.obj")
    seen = {"a.obj": COLORED, "m.mtl": MTL, "my tex.png": picture()}
    yield "OBJ and MTL", seen, (), _see_file("a.obj")
    yield "STL", {"a.stl": _BOX.export(file_type="stl")}, (), _see_file("a.stl")
    for text in (SOLIDS, _BOX.export(file_type="stl_ascii")):
        yield "STL", {"a.stl": text}, (), _see_file("a.stl")
    cloud = trimesh.PointCloud(_BALL.vertices).export(file_type="ply")
    colors = trimesh.creation.box()
    colors.visual.vertex_colors = np.arange(32).reshape(8, 4).astype(np.uint8)
    for data in (
        _BALL.export(file_type="ply"),
        _BOX.export(file_type="ply", encoding="ascii"),
        colors.export(file_type="ply"),
        cloud,
        ply("<", [(0, 1, 2, 3), (0, 1, 4), (0, 1, 5, 2, 3)]),
        ply(">", [(0, 1, 2, 3), (0, 1, 4)], more="property uchar red\n", tail=b"\7"),
    ):
        yield "PLY", {"a.ply": data}, (), _see_file("a.ply")
    textured = colors.export(file_type="ply", encoding="ascii").replace(
        b"comment", b"comment TextureFile a.png\ncomment", 1
    )
    textured = textured.replace(b"property uchar red", b"property uchar s").replace(
        b"property uchar green", b"property uchar t"
    )
    yield "PLY", {"a.ply": textured, "a.png": picture()}, (), _see_file("a.ply")
    yield "OFF", {"a.off": _BOX.export(file_type="off")}, (), _see_file("a.off")
    for data in (threemf("", ["a", "b"]), threemf(' unit="inch"', ["a"])):
        yield "3MF", {"a.3mf": data}, (), _see_file("a.3mf")
    asset = '<unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis>'
    yield "DAE", {"a.dae": dae(asset, geometries=("a", "b"))}, (), _see_file("a.dae")
    yield "DAE", {"a.dae": trimesh.exchange.dae.export_collada(_BOX)}, (), _see_file("a.dae")


def gltf(root: Path) -> Iterator[Item]:
    from support.appearance_files import KTX2, basis_textured, triangle
    from support.gltf_rest import FIRST, WHOLE, skinned
    from support.lights import lit_file
    from support.mesh_files import car, draco_file, meshopt_file

    scene = trimesh.Scene([_BOX, _BALL])
    plain = scene.export(file_type="gltf")
    yield (
        "glTF",
        {"model.gltf" if name.endswith(".gltf") else name: data for name, data in plain.items()},
        (),
        (_see_file("model.gltf")),
    )
    yield "glTF", {"a.gltf": _embedded(plain)}, (), _see_file("a.gltf")
    colored = triangle({"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 1, "scale": [2, 1]}}}).bytes()
    for data in (
        colored,
        lit_file(),
        car(),
        scene.export(file_type="glb"),
        _varied().bytes(),
        skinned(FIRST, WHOLE).bytes(roots=[0, 2]),
    ):
        yield "GLB", {"a.glb": data}, (), _see_file("a.glb")
    yield "GLB, Draco", {"a.glb": draco_file(_BALL)}, (), _see_file("a.glb")
    for picture in KTX2.values():
        yield "GLB, KTX2", {"a.glb": basis_textured(picture).bytes()}, (), _see_file("a.glb")
    # Not installed on every machine: it is often built from source.
    for mesh_filter in (None, "EXPONENTIAL") if find_spec("meshoptimizer") else ():
        yield "GLB, meshopt", {"a.glb": meshopt_file(filter=mesh_filter)}, (), _see_file("a.glb")


def _embedded(files: dict[str, bytes]) -> str:
    content = json.loads(next(data for name, data in files.items() if name.endswith(".gltf")))
    for buffer in content["buffers"]:
        buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(files[buffer["uri"]]).decode()
    return json.dumps(content)


def _varied():
    """Return a file with strips, fans, sparse and normalized accessors, morph targets, instances and transforms."""
    from gltf_files import GltfWriter

    writer = GltfWriter(extensionsUsed=["KHR_mesh_quantization"])
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    whole = writer.accessor(np.int16(32767 * np.pad(corners, ((0, 0), (0, 1)))[:, :3]), normalized=True)
    strip = writer.primitive(corners, faces=[0, 1, 2, 3], mode=5)
    fan = {"attributes": {"POSITION": whole}, "mode": 6}
    sparse = writer.accessor(corners)
    places, values = writer.view(np.uint8([1, 3]).tobytes()), writer.view(np.float32([[5, 0, 0], [5, 5, 0]]).tobytes())
    writer.content["accessors"][sparse]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": places, "componentType": 5121},
        "values": {"bufferView": values},
    }
    strip["targets"] = [{"POSITION": whole}, {"POSITION": sparse}]
    many = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": whole, "SCALE": sparse}}}
    leaf = writer.node(
        strip,
        fan,
        {"attributes": {"POSITION": sparse}, "mode": 5},
        extras={"label": "human"},
        weights=[0.5, 1],
        extensions=many,
    )
    turned = writer.node(children=[leaf], rotation=[0, 0, 0.6, 0.8], translation=[1, 2, 3], scale=[1, -1, 2])
    writer.node(children=[turned], matrix=np.diag([2.0, 1, 1, 1]).ravel().tolist())
    return writer


def labels(root: Path) -> Iterator[Item]:
    """Yield label maps, class maps, and a glTF file with custom classes."""
    from gltf_files import GltfWriter

    from support.labels import TEXTS

    writer = GltfWriter()
    for name, label in (("road_0", "human"), ("car_0", 252), ("thing", "road")):
        corners = np.eye(3, dtype=np.float32)
        writer.node(writer.primitive(corners, faces=[0, 1, 2]), name=name, extras={"label": label})
    street = writer.bytes()
    for name, text in TEXTS.items():
        yield "labels", {name: text, "a.glb": street}, (name,), _labeled(name)


def _labeled(name: str) -> Callable[[Path], None]:
    return lambda folder: see(wv.Scene.load(folder / "a.glb", labels=folder / name))


def archives(root: Path) -> Iterator[Item]:
    from support.mesh_files import OBJ

    stl = _BOX.export(file_type="stl")
    files = {"in/box.stl": stl, "in/a.obj": OBJ.encode(), "read.me": b"no mesh"}
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    yield "ZIP", {"a.zip": whole.getvalue()}, (), _see_file("a.zip")
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr(zipfile.ZipInfo("a.dae"), trimesh.exchange.dae.export_collada(_BOX))
    yield "ZIP", {"a.zae": whole.getvalue()}, (), _see_file("a.zae")
    tar = io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as archive:
        for name, content in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    packed = {"": bytes, ".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}
    for suffix, pack in packed.items():
        yield "tar", {f"a.tar{suffix}": pack(tar.getvalue())}, (), _see_file(f"a.tar{suffix}")
    yield "compressed mesh", {"a.stl.gz": gzip.compress(stl)}, (), _see_file("a.stl.gz")


_LUA = """#VRML_SIM R2021b utf8
PROTO Old [ field SFFloat size 1 field MFVec3f points [ 0 0 0 1 0 0 0 1 0 ] ]
{ Solid { children [
  %{ for i = 1, 3 do }% Shape { geometry Box { size %{= fields.size.value }% 1 %{= i }% } } %{ end }%
] } }
"""
_JAVASCRIPT = """#VRML_SIM R2023b utf8
# template language: javascript
PROTO New [ field SFInt32 steps 2 field SFString name "stairs" field SFVec3f translation 0 0 0 ]
{ Solid { translation IS translation name IS name children [
  %< for (let i = 0; i < fields.steps.value; ++i) { >% Shape { geometry Box { size 1 1 %<= i + 1 >% } } %< } >%
] } }
"""
_WORLD = """#VRML_SIM R2023b utf8
EXTERNPROTO "New.proto"
EXTERNPROTO "Old.proto"
WorldInfo { basicTimeStep 16 coordinateSystem "ENU" }
Viewpoint { position 1 2 3 orientation 0 0 1 0.5 }
DEF A Solid { translation 1.5 -.25 3e-1 rotation 0 0 1 1.57 scale 1 2 1
  children [
    DEF CUBE Shape { geometry Box { size 1 2 3 } castShadows FALSE }
    Pose { translation 1 0 0 children [ USE CUBE Shape { geometry Capsule { height 1 radius 0.2 subdivision 8 } } ] }
    Shape { geometry IndexedFaceSet {
      coord Coordinate { point [ 0 0 0 1 0 0 1 1 0 0 1 0 ] } coordIndex [ 0 1 2 3 -1 ] } }
    Shape { geometry ElevationGrid { xDimension 3 yDimension 2 height [ 0 1 0 1 0 1 ] xSpacing 0.5 } }
    Shape { geometry Extrusion { crossSection [ 0 0 1 0 1 1 0 0 ] spine [ 0 0 0 0 1 0 0 1 1 ] scale [ 1 1 ] } }
    Shape { geometry Mesh { url [ "box.stl" ] } }
    CadShape { url [ "box.dae" ] }
    Shape { geometry Cylinder { subdivision 5 } } Shape { geometry Cone { } } Shape { geometry Plane { size 2 2 } }
  ]
  name "a" boundingObject USE CUBE physics NULL
}
New { steps 3 translation 0 0 1 }
Old { size 0.5 }
Robot { controller "<none>" children [ Camera { width 64 height 48 fieldOfView 0.8 recognition Recognition { } }
  RangeFinder { name "eye" width 64 height 48 minRange 0.1 maxRange 5 lens Lens { } }
  Lidar { tiltAngle 0.1 fieldOfView 2 numberOfLayers 3 type "rotating" defaultFrequency 5 } ] }
"""


def worlds(root: Path) -> Iterator[Item]:
    from arguments_shared import WORLD

    from support.lights import WORLD as LIT
    from support.webots_grammar import SMALL
    from support.webots_joints import JOINTS
    from support.webots_textures import ROUND, SHAPES

    old = _WORLD.replace("R2023b", "R2021b").replace('EXTERNPROTO "New.proto"\nEXTERNPROTO "Old.proto"\n', "")
    old = old.replace("New { steps 3 translation 0 0 1 }", "")
    shared = {"box.stl": _BOX.export(file_type="stl"), "box.dae": trimesh.exchange.dae.export_collada(_BOX)}
    for text in (WORLD, SMALL, LIT % "", SHAPES % ("R2023b", ""), ROUND % "", JOINTS):
        yield "Webots world", {"worlds/a.wbt": text}, (), _see_world("worlds/a.wbt")
    yield "Webots world", {"a.wbt": JOINTS}, (), _see_file("a.wbt", movable=True)
    plain = _WORLD.replace("New { steps 3 translation 0 0 1 }\nOld { size 0.5 }\n", "")
    yield (
        "Webots world",
        {"worlds/a.wbt": plain} | {f"worlds/{name}": data for name, data in shared.items()},
        (),
        (_see_world("worlds/a.wbt")),
    )
    files = {"a.wbt": _WORLD, "New.proto": _JAVASCRIPT, "Old.proto": _LUA.replace("R2021b", "R2023b"), **shared}
    yield "Webots PROTO", files, ("New.proto", "Old.proto"), _see_world("a.wbt")
    files = {"worlds/a.wbt": old, "protos/Old.proto": _LUA}
    yield "Webots PROTO", files, ("protos/Old.proto",), _see_world("worlds/a.wbt", ".")


def models(root: Path) -> Iterator[Item]:
    from mujoco_models import SHAPES

    from support.lights import MODEL
    from support.model_files import ROBOT
    from support.sdf_files import CONFIG, TABLE, WHOLE

    stl, obj = _BOX.export(file_type="stl"), trimesh.exchange.obj.export_obj(_BOX)
    files = {
        "a.xml": '<mujoco><compiler meshdir="m"/><include file="more.xml"/><asset><mesh name="box" file="box.stl"/>'
        '<mesh name="ball" file="ball.obj" scale="1 2 1"/><hfield name="h" file="h.png" size="1 1 1 .1"/></asset>'
        '<worldbody><geom type="mesh" mesh="box"/><geom type="hfield" hfield="h"/></worldbody></mujoco>',
        "more.xml": '<mujoco><worldbody><body name="b"><freejoint/><geom type="mesh" mesh="ball"/></body></worldbody>'
        "</mujoco>",
        "m/box.stl": stl,
        "m/ball.obj": obj,
        "m/h.png": png(8, 6),
    }
    yield "MJCF", {"a.xml": SHAPES}, (), _see_file("a.xml", movable=True)
    yield "MJCF", {"a.xml": MODEL}, (), _see_file("a.xml")
    yield "MJCF", files, (), _see_file("a.xml")
    robot = {"robots/urdf/a.urdf": ROBOT, "robots/meshes/hand.stl": stl}
    yield "URDF", robot, (), _see_file("robots/urdf/a.urdf", movable=True)
    gazebo = {"a.sdf": WHOLE, "table/model.sdf": TABLE, "table/model.config": CONFIG, "table/hand.stl": stl}
    yield "SDF", gazebo, ("a.sdf", "table/model.sdf", "table/model.config"), _see_file("a.sdf", movable=True)
    yield "SDF", gazebo, ("a.sdf",), _see_sensors("a.sdf")


def usd(root: Path) -> Iterator[Item]:
    from support.usd_stages import METERS, VARIED, textured

    if not find_spec("pxr"):
        return
    from pxr import Sdf, UsdUtils

    text, image = METERS + VARIED + textured("a.png"), png(4, 4)
    yield "USDA", {"a.usda": text, "a.png": image}, ("a.usda",), _see_file("a.usda", movable=["*"])
    folder = root / "usd"
    folder.mkdir(exist_ok=True)
    (folder / "a.usda").write_text(text)
    (folder / "a.png").write_bytes(image)
    # Not USDC: usd-core allocates the sizes that a damaged file states, gigabytes of them.
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(folder / "a.usda")), str(folder / "a.usdz"))
    yield "USDZ", {"a.usdz": (folder / "a.usdz").read_bytes()}, (), _see_file("a.usdz")


def png(width: int, height: int, dtype: type = np.uint8) -> bytes:
    whole = io.BytesIO()
    pixels = (np.arange(width * height) % 251).reshape(height, width).astype(dtype)
    Image.fromarray(pixels).save(whole, "png")
    return whole.getvalue()


MAKERS = (meshes, gltf, labels, archives, worlds, models, usd)

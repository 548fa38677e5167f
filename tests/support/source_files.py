# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small files of scene sources, in their own units and axes, nested and labeled, and the rows of equal scenes."""

import io
import re
import zipfile
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter
from trimesh.transformations import compose_matrix, quaternion_from_matrix, rotation_from_matrix

from warpvis.scene import Y_UP_TO_Z_UP as UPRIGHT

from support import scans
from support.bop_scene import MODELS, write_bop
from support.habitat import make_dataset, write
from support.mesh_files import THREE
from support.sdf_files import model_folder, visual, world


class Row(NamedTuple):
    """An object of a scene built by hand."""

    name: str
    mesh: Any
    matrix: np.ndarray  # mesh to the scene, in meters
    label: str
    category: str = ""


IDENTITY = np.eye(4)


def place(xyz, rpy):
    return compose_matrix(angles=rpy, translate=xyz)


def size(*factors):
    return np.diag([*factors, 1.0])


# A tetrahedron without any symmetry, in millimeters.
WEDGE = trimesh.Trimesh(
    [(0, 0, 0), (800, 0, 0), (0, 600, 0), (0, 0, 400)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
)
FLOOR = trimesh.creation.box((3.0, 2.0, 0.1))
BASE_XYZ, BASE_RPY = (0.1, -0.2, -0.3), (0.1, 0.2, 0.3)
GROUP_XYZ, GROUP_RPY = (0.3, -0.2, 0.5), (0.2, -0.1, 0.6)
LEFT_XYZ, LEFT_RPY = (0.6, 0.1, 0.2), (0.3, -0.4, 0.5)
RIGHT_XYZ, RIGHT_RPY = (-0.7, 0.2, 0.1), (-0.2, 0.1, 2.0)
BASE, GROUP = place(BASE_XYZ, BASE_RPY), place(GROUP_XYZ, GROUP_RPY)
LEFT, RIGHT = place(LEFT_XYZ, LEFT_RPY), place(RIGHT_XYZ, RIGHT_RPY)
FACTORS = (0.001, 0.002, 0.0005)  # millimeters to meters, and stretched


def rows(upright=IDENTITY, names=("floor", "left", "right"), categories=("", "", ""), factors=FACTORS, turn=IDENTITY):
    """Return a floor, and two wedges in a group, rotated upright."""
    wedges = [upright @ GROUP @ matrix @ size(*factors) @ turn for matrix in (LEFT, RIGHT)]
    return [
        Row(names[0], FLOOR, upright @ BASE, "ground", categories[0]),
        Row(names[1], WEDGE, wedges[0], "object", categories[1]),
        Row(names[2], WEDGE, wedges[1], "object", categories[2]),
    ]


def text(*values):
    return " ".join(map(repr, map(float, np.ravel(values))))


def millimeters(matrix):
    return size(1000, 1000, 1000) @ matrix @ size(0.001, 0.001, 0.001)


def quaternion(matrix):
    """Return w x y z."""
    return quaternion_from_matrix(matrix).tolist()


def export_meshes(folder):
    for name, mesh in (("wedge", WEDGE), ("floor", FLOOR)):
        mesh.export(folder / f"{name}.stl")


def urdf_link(name, xyz, rpy):
    mesh = f'<mesh filename="wedge.stl" scale="{text(FACTORS)}"/>'
    return f"""<link name="{name}"><visual><origin xyz="{text(xyz)}" rpy="{text(rpy)}"/><geometry>{mesh}</geometry>
    </visual></link><joint name="to_{name}" type="revolute"><parent link="group"/><child link="{name}"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


def write_urdf(folder, wedges="", name="robot.urdf"):
    export_meshes(folder)
    wedges = wedges or urdf_link("left", LEFT_XYZ, LEFT_RPY) + urdf_link("right", RIGHT_XYZ, RIGHT_RPY)
    floor = f'<origin xyz="{text(BASE_XYZ)}" rpy="{text(BASE_RPY)}"/><geometry><mesh filename="floor.stl"/></geometry>'
    return write(
        folder,
        name,
        f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
    <link name="floor"><visual>{floor}</visual></link><link name="group"/>
    <joint name="to_group" type="fixed"><parent link="floor"/><child link="group"/>
    <origin xyz="{text(GROUP_XYZ)}" rpy="{text(GROUP_RPY)}"/></joint>{wedges}</robot>""",
    )


def write_xacro(folder):
    macro = f'<xacro:macro name="wedge" params="side xyz yaw">{urdf_link("${side}", (1,), (1,))}</xacro:macro>'
    macro = macro.replace('xyz="1.0" rpy="1.0"', 'xyz="${xyz}" rpy="${yaw}"')
    calls = "".join(
        f'<xacro:wedge side="{side}" xyz="{text(xyz)}" yaw="{text(rpy[:2])} ${{{rpy[2]} / 2 * 2}}"/>'
        for side, xyz, rpy in (("left", LEFT_XYZ, LEFT_RPY), ("right", RIGHT_XYZ, RIGHT_RPY))
    )
    return write_urdf(folder, macro + calls, "robot.urdf.xacro")


def write_mjcf(folder):
    export_meshes(folder)
    bodies = "".join(
        f'<body pos="{text(xyz)}" quat="{text(quaternion(matrix))}"><joint/>'
        f'<geom name="{name}" type="mesh" mesh="w"/></body>'
        for name, xyz, matrix in (("left", LEFT_XYZ, LEFT), ("right", RIGHT_XYZ, RIGHT))
    )
    frame = f'pos="{text(BASE_XYZ)}" quat="{text(quaternion(BASE))}"'
    return write(
        folder,
        "model.xml",
        f"""<mujoco><asset><mesh name="w" file="wedge.stl" scale="{text(FACTORS)}"/><mesh file="floor.stl"/></asset>
    <worldbody><geom name="floor" type="mesh" mesh="floor" {frame}/>
    <body pos="{text(GROUP_XYZ)}" quat="{text(quaternion(GROUP))}">{bodies}</body></worldbody></mujoco>""",
    )


def write_usd(folder):
    pytest.importorskip("pxr")
    from pxr import Gf, Usd, UsdGeom, UsdSemantics

    stage = Usd.Stage.CreateNew(str(folder / "room.usdc"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.001)
    UsdGeom.SetStageUpAxis(stage, "Y")

    def add(path, mesh):
        prim = UsdGeom.Mesh.Define(stage, path)
        prim.CreatePointsAttr(np.float32(mesh.vertices))
        prim.CreateFaceVertexCountsAttr([3] * len(mesh.faces))
        prim.CreateFaceVertexIndicesAttr(mesh.faces.ravel().tolist())
        prim.CreateSubdivisionSchemeAttr("none")

    def transform(path, matrix, word=""):
        form = UsdGeom.Xform.Define(stage, path)
        form.AddTransformOp().Set(Gf.Matrix4d(millimeters(matrix).T.tolist()))
        if word:
            UsdSemantics.LabelsAPI.Apply(form.GetPrim(), "class").CreateLabelsAttr([word])
        return form.GetPrim()

    stage.CreateClassPrim("/Wedge")
    add("/Wedge/mesh", WEDGE)
    transform("/Room", np.eye(4))
    transform("/Room/Floor", BASE, "floor")
    add("/Room/Floor/mesh", trimesh.creation.box((3000, 2000, 100)))
    transform("/Room/Group", GROUP, "cup")
    for name, matrix in (("Left", LEFT), ("Right", RIGHT)):
        prim = transform(f"/Room/Group/{name}", matrix @ size(1, 2, 0.5))
        prim.GetReferences().AddInternalReference("/Wedge")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    return folder / "room.usdc"


def write_sdf(folder):
    export_meshes(folder)
    mesh = f"<mesh><uri>../wedge.stl</uri><scale>{text(FACTORS)}</scale></mesh>"
    wedge = f'<sdf version="1.9"><model name="wedge"><link name="l">{visual(mesh)}</link></model></sdf>'
    model_folder(folder, "wedge", wedge)
    floor = visual("<mesh><uri>floor.stl</uri></mesh>")
    includes = "".join(
        f"<include><uri>model://wedge</uri><name>{name}</name><pose>{text(xyz, rpy)}</pose></include>"
        for name, xyz, rpy in (("left", LEFT_XYZ, LEFT_RPY), ("right", RIGHT_XYZ, RIGHT_RPY))
    )
    pose = text(BASE_XYZ, BASE_RPY)
    body = f'<model name="floor"><static>1</static><pose>{pose}</pose><link name="l">{floor}</link></model>'
    body += f'<model name="group"><pose>{text(GROUP_XYZ, GROUP_RPY)}</pose>{includes}</model>'
    return write(folder, "room.sdf", world(body))


def write_webots(folder):
    """Write a world of R2021b, with y up."""
    export_meshes(folder)

    def frame(matrix):
        angle, axis, _ = rotation_from_matrix(matrix)
        return f"translation {text(matrix[:3, 3])} rotation {text(*axis, angle)}"

    shape = 'DEF WEDGE Shape { geometry Mesh { url "wedge.stl" } }'
    solids = "".join(
        f'Solid {{ {frame(matrix)} name "{name}" recognitionColors [ 1 0 0 ] '
        f"children [ Transform {{ scale {text(FACTORS)} children [ {node} ] }} ] }} "
        for name, matrix, node in (("left", LEFT, shape), ("right", RIGHT, "USE WEDGE"))
    )
    floor = f'Solid {{ {frame(BASE)} name "floor" children [ Shape {{ geometry Mesh {{ url "floor.stl" }} }} ] }}'
    info = 'WorldInfo { coordinateSystem "NUE" }'
    group = f"Transform {{ {frame(GROUP)} children [ {solids} ] }}"
    content = f"#VRML_SIM R2021b utf8\n{info} {floor} {group}"
    return write(folder, "room.wbt", content)


def write_habitat(folder):
    """Write assets with z up in a dataset with y up, and classes of a lexicon."""
    items = [{"template_name": "floor", "translation": BASE_XYZ, "rotation": quaternion(BASE)}]
    for matrix in (GROUP @ LEFT, GROUP @ RIGHT):
        pose = {"translation": matrix[:3, 3].tolist(), "rotation": quaternion(matrix)}
        items.append({"template_name": "wedge", **pose, "uniform_scale": 0.5, "non_uniform_scale": [1, 2, 0.5]})
    write(folder, "objects/f/floor.glb", FLOOR)
    write(folder, "objects/f/floor.object_config.json", {"render_asset": "floor.glb", "semantic_id": 1})
    write(folder, "objects/w/wedge.glb", WEDGE)
    axes = {"up": [0, 0, 1], "front": [0, 1, 0], "scale": [0.002, 0.002, 0.002], "semantic_id": 2}
    write(folder, "objects/w/wedge.object_config.json", {"render_asset": "wedge.glb", **axes})
    lexicon = {"classes": [{"id": 1, "name": "floor"}, {"id": 2, "name": "cup"}]}
    config = {"semantic_scene_descriptor_instances": {"words": "semantics/words_lexicon.json"}}
    scene = {"object_instances": items, "semantic_scene_instance": "words"}
    return make_dataset(folder, scene, config=config, **{"semantics__words_lexicon.json": lexicon})


def write_gltf(folder):
    """Write nested nodes in millimeters, with y up, and one that its parent shears."""
    writer = GltfWriter()
    triangles = {mesh: writer.primitive(mesh.vertices, mesh.faces) for mesh in (FLOOR, WEDGE)}
    floor = {
        "mesh": {"extras": {"label": "ground", "category": "floor"}},
        "name": "floor",
        "matrix": BASE.T.ravel().tolist(),
    }
    roots = [writer.node(triangles[FLOOR], **floor)]
    children = []
    for name, matrix in (("left", LEFT), ("right", RIGHT), ("sheared", LEFT)):
        pose = {"rotation": np.roll(quaternion(matrix), -1).tolist(), "translation": (1000 * matrix[:3, 3]).tolist()}
        extras = {"label": "OBJECT", "category": "cup"}
        if children:
            writer.content["nodes"].append({"name": name, "mesh": 1, "extras": extras, **pose, "scale": [1, 2, 0.5]})
            children.append(len(writer.content["nodes"]) - 1)
        else:
            children.append(writer.node(triangles[WEDGE], name=name, extras=extras, **pose, scale=[1, 2, 0.5]))
    group = {"rotation": np.roll(quaternion(GROUP), -1).tolist(), "translation": list(GROUP_XYZ)}
    roots.append(writer.node(children=children[:2], scale=[0.001] * 3, **group))
    roots.append(writer.node(children=children[2:], scale=[0.001, -0.001, 0.002], **group))
    path = folder / "room.glb"
    path.write_bytes(writer.bytes(roots=roots))
    return path


def gltf_rows():
    sheared = UPRIGHT @ GROUP @ size(0.001, -0.001, 0.002) @ millimeters(LEFT) @ size(1, 2, 0.5)
    found = rows(UPRIGHT, categories=("floor", "cup", "cup"))
    return [*found, Row("sheared", WEDGE, sheared, "object", "cup")]


def flat(unit=0.001):
    """Return the meshes of `rows` in one frame, in a unit in meters."""
    scale = size(*[1 / unit] * 3)
    return {row.name: row.mesh.copy().apply_transform(scale @ row.matrix) for row in rows()}


def write_ply(folder):
    trimesh.util.concatenate([*flat().values()]).export(folder / "room.ply")
    return folder / "room.ply"


def write_obj(folder):
    lines, first = [], 1
    for name, mesh in flat().items():
        lines += [f"o {name}", *(f"v {text(corner)}" for corner in mesh.vertices)]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + first]
        first += len(mesh.vertices)
    return write(folder, "room.obj", "\n".join(lines))


def write_stl(folder):
    facets = {
        name: "".join(
            "facet normal 0 0 0 outer loop\n"
            + "".join(f"vertex {text(corner)}\n" for corner in corners)
            + "endloop endfacet\n"
            for corners in mesh.triangles
        )
        for name, mesh in flat().items()
    }
    return write(
        folder, "room.stl", "".join(f"solid {name}\n{facet}endsolid {name}\n" for name, facet in facets.items())
    )


INCH = 0.0254
IN_INCHES = size(*[1 / INCH] * 3)


def inches(matrix):
    return IN_INCHES @ matrix @ np.linalg.inv(IN_INCHES)


def write_3mf(folder):
    """Write components in inches."""
    pytest.importorskip("lxml")
    pytest.importorskip("networkx")

    def moved(kind, number, matrix):
        return f'<{kind} objectid="{number}" transform="{text(matrix.T[:, :3])}"/>'

    def shape(mesh):
        corners = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*corner) for corner in mesh.vertices)
        faces = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in mesh.faces)
        return f"<mesh><vertices>{corners}</vertices><triangles>{faces}</triangles></mesh>"

    contents = [("floor", shape(FLOOR)), ("wedge", shape(WEDGE))]
    for name, matrix in (("left", LEFT), ("right", RIGHT)):
        part = moved("component", 2, IN_INCHES @ matrix @ size(*FACTORS))
        contents.append((name, f"<components>{part}</components>"))
    objects = "".join(
        f'<object id="{number}" name="{name}" type="model">{content}</object>'
        for number, (name, content) in enumerate(contents, 1)
    )
    # trimesh numbers the instances of an object from the last one.
    items = moved("item", 1, IN_INCHES @ BASE) + "".join(moved("item", number, inches(GROUP)) for number in (4, 3))
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("3D/3dmodel.model", THREE.format(unit=' unit="inch"', objects=objects, items=items))
    (folder / "room.3mf").write_bytes(data.getvalue())
    return folder / "room.3mf"


def write_collada(folder):
    """Write nested nodes in inches, with y up, and geometries by trimesh."""
    content = trimesh.exchange.dae.export_collada([FLOOR, WEDGE]).decode()
    floor, wedge = re.findall('<geometry id="([^"]*)"', content)

    def node(name, matrix, inner):
        return f'<node id="{name}" name="{name}"><matrix>{text(matrix)}</matrix>{inner}</node>'

    shape = '<instance_geometry url="#{}"/>'.format
    sides = (("left", LEFT), ("right", RIGHT))
    wedges = "".join(node(name, IN_INCHES @ matrix @ size(*FACTORS), shape("wedge")) for name, matrix in sides)
    nodes = node("floor", IN_INCHES @ BASE, shape("floor")) + node("group", inches(GROUP), wedges)
    scenes = f'<visual_scene id="scene">{nodes}</visual_scene>'
    content = content.replace(floor, "floor").replace(wedge, "wedge")
    content = re.sub(r"<visual_scene .*</visual_scene>", scenes, content, flags=re.DOTALL)
    content = content.replace("<up_axis>", '<unit name="inch" meter="0.0254"/><up_axis>')
    return write(folder, "room.dae", content)


def scan_rows(numbers, upright=IDENTITY, lamp="lamp"):
    words = ("floor", "office chair", lamp, "")
    names = [f"{word.replace(' ', '_')}_{number}" for word, number in zip(words, numbers, strict=False)]
    labels = ("ground", "obstacle", "object", "obstacle")
    found = zip([*names, "unlabeled"], scans.MESHES, [upright] * 4, labels, words, strict=True)
    return [Row(*values) for values in found]


def write_bop_scene(folder):
    scene = write_bop(folder, {3: BASE}, {3: [(5, GROUP @ LEFT), (11, GROUP), (5, GROUP @ RIGHT)]})
    return scene / "scene_gt.json"


def bop_rows():
    placed = (("obj_000005", 5, GROUP @ LEFT), ("obj_000011", 11, GROUP), ("obj_000005_1", 5, GROUP @ RIGHT))
    return [Row(name, MODELS[number], matrix @ size(0.001, 0.001, 0.001), "object") for name, number, matrix in placed]


FEET = 1200 / 3937  # of the US survey
ELEVATIONS = np.array([[3, 5, 4], [6, 2, 7], [1, 8, 3], [4, 4, 9]], np.int16)
TURNED = (3.0, 1.0, 900_000.0, 0.5, -2.0, 200_000.0)  # x, and y, from column, row and 1, in feet


def write_terrain(folder):
    """Write elevations in tenths of feet over 10 feet, in a rotated raster."""
    rasterio = pytest.importorskip("rasterio")
    shape = {"height": 4, "width": 3, "count": 1, "dtype": "int16"}
    with rasterio.open(
        folder / "dem.tif", "w", "GTiff", crs="EPSG:2263", transform=rasterio.Affine(*TURNED), **shape
    ) as file:
        file.write(ELEVATIONS, 1)
        file.units, file.scales, file.offsets = ["US survey foot"], [0.1], [10.0]
    return folder / "dem.tif"


def terrain_rows():
    row, column = np.indices(ELEVATIONS.shape).reshape(2, -1)
    offsets = np.stack([column - 1.0, row - 1.5])
    x, y = np.reshape(TURNED, (2, 3))[:, :2] @ offsets
    vertices = FEET * np.stack([x, y, 10 + 0.1 * ELEVATIONS.ravel()], axis=1)
    first = [3 * row + column for row in range(3) for column in range(2)]
    faces = [face for a in first for face in ((a, a + 3, a + 1), (a + 3, a + 4, a + 1))]
    return [Row("terrain", trimesh.Trimesh(vertices, faces, process=False), np.eye(4), "ground", "terrain")]

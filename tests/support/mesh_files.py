# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files of several formats."""

import io
import zipfile

import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


def car():
    """Return meshes of several primitives, duplicate and missing names, and names like the generated ones."""
    writer = GltfWriter()
    body = [writer.primitive(TRIANGLE + k) for k in range(3)]
    wheels = writer.node(writer.primitive(TRIANGLE), name="wheel")
    again = writer.node(writer.primitive(TRIANGLE), name="wheel", translation=[1, 0, 0])
    writer.node(writer.primitive(TRIANGLE), name="wheel_1")
    writer.node(*body, mesh={"name": "body"}, children=[again, wheels])
    writer.node(writer.primitive(TRIANGLE), writer.primitive(TRIANGLE))
    writer.node(writer.primitive(TRIANGLE))
    return writer.bytes(roots=[3, 2, 5, 4])


OBJ = (
    "o zebra\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 3 2\no apple\nf 3 2 1\no mid\nf 2 1 3\n"
)
SOLIDS = "".join(
    f"solid {name}\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    f"endsolid {name}\n"
    for name in ("zebra", "apple")
)


def draco_file(mesh=BALL, names=("ball",)):
    whole = trimesh.Scene()
    for name in names:
        whole.add_geometry(mesh, node_name=name, geom_name=name)
    return trimesh.exchange.gltf.export_glb(whole, extension_draco=True)


def meshopt_file(extension="EXT_meshopt_compression", filter=None):
    """Return a ball with compressed vertices and indices; positions are plain or use a shared exponent."""
    meshopt = pytest.importorskip("meshoptimizer")
    vertices, faces = BALL.vertices.astype(np.float32), BALL.faces.astype(np.uint32).reshape(-1)
    stored = vertices
    if filter == "EXPONENTIAL":  # 24-bit mantissa, 8-bit exponent
        stored = ((-20 & 0xFF) << 24 | np.round(vertices * 2.0**20).astype(np.int64) & 0xFFFFFF).astype(np.uint32)
    writer = GltfWriter(extensionsRequired=[extension])
    writer.content["buffers"] = [{"byteLength": 0}, {"byteLength": 0, "extensions": {extension: {"fallback": True}}}]

    def compressed(data, raw, stride, mode, **more):
        item = {"buffer": 0, "byteOffset": len(writer.data), "byteLength": len(data), "byteStride": stride}
        item |= {"count": len(raw) // stride, "mode": mode, **more}
        writer.data += data + b"\0" * (-len(data) % 4)
        view = {"buffer": 1, "byteLength": len(raw), "extensions": {extension: item}}
        writer.content["bufferViews"].append(view | ({"byteStride": stride} if mode == "ATTRIBUTES" else {}))
        return len(writer.content["bufferViews"]) - 1

    more = {} if filter is None else {"filter": filter}
    places = compressed(meshopt.encode_vertex_buffer(stored), stored.tobytes(), 12, "ATTRIBUTES", **more)
    order = compressed(meshopt.encode_index_buffer(faces), faces.tobytes(), 4, "TRIANGLES")
    again = compressed(meshopt.encode_index_sequence(faces), faces.tobytes(), 4, "INDICES")
    position = writer.accessor(vertices, view=places)
    for name, view in (("ball", order), ("twin", again)):
        indices = writer.accessor(faces, view=view)
        writer.node({"attributes": {"POSITION": position}, "indices": indices}, name=name)
    return writer.bytes()


def dae(asset, *, geometries=("part",)):
    """Return a COLLADA file of triangles (1, 0, 0), (0, 2, 0), (0, 0, 3)."""
    shapes = "".join(
        f"""<geometry id="{name}"><mesh>
        <source id="{name}-p"><float_array id="{name}-a" count="9">1 0 0 0 2 0 0 0 3</float_array><technique_common>
        <accessor source="#{name}-a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
        <param name="Z" type="float"/></accessor></technique_common></source>
        <vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>
        <triangles count="1"><input semantic="VERTEX" source="#{name}-v" offset="0"/><p>0 1 2</p></triangles>
        </mesh></geometry>"""
        for name in geometries
    )
    nodes = "".join(f'<node id="n-{name}"><instance_geometry url="#{name}"/></node>' for name in geometries)
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<asset>{asset}</asset><library_geometries>{shapes}</library_geometries>"
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


THREE = (
    '<?xml version="1.0"?><model{unit} xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
    "{objects}</resources><build>{items}</build></model>"
)


def threemf(unit, names):
    """Return a 3MF file of triangles (1, 0, 0), (0, 2, 0), (0, 0, 3)."""
    corners = '<vertex x="1" y="0" z="0"/><vertex x="0" y="2" z="0"/><vertex x="0" y="0" z="3"/>'
    mesh = f'<mesh><vertices>{corners}</vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>'
    objects = "".join(f'<object id="{k}" name="{name}" type="model">{mesh}</object>' for k, name in enumerate(names, 1))
    items = "".join(f'<item objectid="{k}"/>' for k in range(1, len(names) + 1))
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr("3D/3dmodel.model", THREE.format(unit=unit, objects=objects, items=items))
    return whole.getvalue()

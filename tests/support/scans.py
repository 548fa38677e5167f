# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small scans with objects, in the formats of public datasets."""

import json

import numpy as np
import trimesh
from numpy.lib.recfunctions import repack_fields
from plyfile import PlyData, PlyElement

FLOOR = trimesh.creation.box((4.0, 3.0, 0.1))
CHAIR = trimesh.creation.box((0.5, 0.5, 1.0)).apply_translation((1, 0, 0.55))
LAMP = trimesh.creation.icosphere(subdivisions=1, radius=0.2).apply_translation((-1, 0, 2))
DUST = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((0, 1, 1))
MESHES = (FLOOR, CHAIR, LAMP, DUST)  # the last one has no label
COLORS = np.array([(200, 180, 160), (250, 20, 30), (10, 240, 50), (90, 90, 90)], dtype=np.uint8)


def joined():
    """Return the vertices, faces and the number of the object of each vertex and face."""
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in MESHES)])
    faces = np.concatenate([mesh.faces + first for mesh, first in zip(MESHES, firsts, strict=False)])
    of_vertices = np.repeat(range(len(MESHES)), [len(mesh.vertices) for mesh in MESHES])
    of_faces = np.repeat(range(len(MESHES)), [len(mesh.faces) for mesh in MESHES])
    return np.concatenate([mesh.vertices for mesh in MESHES]), faces, of_vertices, of_faces


def write_ply(path, *, vertex=(), face=(), faces=None, text=False, order="<", colors=True):
    """Write the scan by plyfile, by default with colors, and more properties ``{name: (type, values)}``."""
    vertices, triangles, of_vertices, _ = joined()
    polygons = triangles if faces is None else faces
    vertex, face = dict(vertex), dict(face)
    kinds = [(name, "f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue", "alpha")]
    rows = np.zeros(len(vertices), dtype=[*kinds, *((name, kind) for name, (kind, _) in vertex.items())])
    for axis, name in enumerate("xyz"):
        rows[name] = vertices[:, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        rows[name] = COLORS[of_vertices, channel]
    rows["alpha"] = 255
    rows = rows if colors else repack_fields(rows[list("xyz")])
    for name, (_, values) in vertex.items():
        rows[name] = values
    corners = (
        [("vertex_indices", "i4", (polygons.shape[1],))]
        if isinstance(polygons, np.ndarray)
        else [("vertex_indices", "O")]
    )
    cells = np.zeros(len(polygons), dtype=[*corners, *((name, kind) for name, (kind, _) in face.items())])
    for number, polygon in enumerate(polygons):
        cells["vertex_indices"][number] = np.asarray(polygon, dtype=np.int32)
    for name, (_, values) in face.items():
        cells[name] = values
    elements = [
        PlyElement.describe(rows, "vertex"),
        PlyElement.describe(cells, "face", val_types={"vertex_indices": "i4"}),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    PlyData(elements, text=text, byte_order="=" if text else order).write(path)
    return path


GROUPS = [
    {"id": 5, "objectId": 0, "segments": [10], "label": "floor"},
    {"id": 6, "objectId": 1, "segments": [20, 21], "label": "office chair"},
    {"id": 7, "objectId": 2, "segments": [30], "label": "lamp"},
]
TABLE = "id\traw_category\tcategory\tnyu40id\tnyu40class\n1\toffice chair\tchair\t5\tchair\n2\tlamp\tlamp\t35\tlamp\n"


def segments_of(numbers):
    """Return the segment of each vertex or face of an object; the chair has two."""
    segments = np.array([10, 20, 30, 99])[numbers]
    segments[np.flatnonzero(numbers == 1)[::2]] = 21
    return segments.tolist()


def write_json(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def write_scannet(folder, name="scene0000_00", *, table=True):
    """Write a scan of ScanNet, and return its mesh."""
    path = write_ply(folder / f"{name}_vh_clean_2.ply")
    indices = segments_of(joined()[2])
    write_json(folder / f"{name}_vh_clean_2.0.010000.segs.json", {"sceneId": name, "segIndices": indices})
    write_json(folder / f"{name}.aggregation.json", {"sceneId": name, "segGroups": GROUPS})
    if table:
        write_json(folder / "scannetv2-labels.combined.tsv", TABLE)
    return path


def write_scannetpp(folder):
    """Write a scan of ScanNet++, and return its mesh."""
    path = write_ply(folder / "mesh_aligned_0.05.ply")
    write_json(folder / "segments.json", {"segIndices": segments_of(joined()[2])})
    write_json(folder / "segments_anno.json", {"segGroups": GROUPS})
    return path


def write_replica(folder):
    """Write a scene of Replica, whose faces have four corners, and return its mesh."""
    _, triangles, _, of_faces = joined()
    quads = triangles[:, [0, 1, 2, 2]]
    path = write_ply(folder / "mesh_semantic.ply", faces=quads, face={"object_id": ("i4", of_faces + 3)})
    classes = [{"id": 20, "name": "floor"}, {"id": 30, "name": "office chair"}, {"id": 47, "name": "lamp"}]
    objects = [
        {"id": number + 3, "class_id": item["id"], "class_name": item["name"]} for number, item in enumerate(classes)
    ]
    write_json(folder / "info_semantic.json", {"classes": classes, "objects": objects, "id_to_label": []})
    return path


HOUSE = """ASCII 1.1
H house label 0 0 0 0 4 3 3 1 0 1 0 0 0 0 0 -1 -1 -1 1 1 1 0 0 0 0 0
L 0 1 l 0 0 0 -1 -1 -1 1 1 1 0 0 0 0 0
R 0 0 0 0 k 0 0 0 -1 -1 -1 1 1 1 2 0 0 0 0
C 0 4 floor 2 floor 0 0 0 0 0
C 1 6 office#chair 3 chair 0 0 0 0 0
C 2 9 lamp 28 lighting 0 0 0 0 0
O 0 0 0 0 0 0 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0
O 1 0 1 0 0 0 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0
O 2 0 2 0 0 0 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0
E 0 0 10 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0
E 1 1 20 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0
E 2 1 21 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0
E 3 2 30 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0
"""


def write_matterport(folder, *, objects=False):
    """Write a house of Matterport3D, as published or for Habitat with numbers of objects, and return its mesh."""
    _, _, _, of_faces = joined()
    values = np.where(of_faces == 3, -1, of_faces) if objects else segments_of(of_faces)
    name = "object_id" if objects else "material_id"
    path = write_ply(folder / ("house_semantic.ply" if objects else "house.ply"), face={name: ("i4", values)})
    write_json(folder / "house.house", HOUSE)
    return path


def write_region(folder):
    """Write a region of Matterport3D, and return its mesh."""
    path = write_ply(folder / "region0.ply", text=True)
    write_json(folder / "region0.fsegs.json", {"segIndices": segments_of(joined()[3])})
    write_json(folder / "region0.semseg.json", {"segGroups": GROUPS})
    return path


HM3D = """HM3D Semantic Annotations
1,C8B4A0,"floor",0
2,FA141E,"office chair",1
3,0AF032,"lamp, standing",1
"""


def write_hm3d(folder, *, textured=True):
    """Write a scene of HM3D, with colors of objects in a texture or at vertices, and return its mesh."""
    from PIL import Image

    vertices, faces, of_vertices, _ = joined()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if textured:
        image = Image.fromarray(COLORS[None].repeat(2, axis=0))
        uv = np.stack([(of_vertices + 0.5) / 4, np.full(len(vertices), 0.5)], axis=1)
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
        mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    else:
        mesh.visual.vertex_colors = np.concatenate([COLORS[of_vertices], np.full((len(vertices), 1), 255)], axis=1)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "00800-TEEsavR23oF.semantic.glb"
    mesh.export(path)
    write_json(folder / "00800-TEEsavR23oF.semantic.txt", HM3D)
    return path

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small mesh files with materials and textures, and a loader."""

import base64
import io
import warnings

import numpy as np
from gltf_files import GltfWriter
from PIL import Image

import warpvis as wv

IMAGE = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
ROWS, FACES = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
UV = np.float32([[0, 0], [1, 0.25], [0, 2]])


def png():
    file = io.BytesIO()
    Image.fromarray(IMAGE).save(file, "PNG")
    return file.getvalue()


# 8 x 8 pixels: red and green above blue and yellow. Written by Basis Universal 2.10 in both of its modes, UASTC with
# Zstandard and an opacity of 64 in the lower half.
QUARTERS = np.array([[[200, 40, 40], [40, 200, 40]], [[40, 40, 200], [220, 220, 40]]], dtype=np.uint8)
KTX2 = {
    name: base64.b64decode(text)
    for name, text in {
        "ETC1S": (
            "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAACwAAACUAAAAJAAAALgAAAAAAAAAkwAA"
            "AAAAAABLAQAAAAAAAAIAAAAAAAAAAAAAAAAAAAAsAAAAAAAAAAIAKACjAQIAAwMAAAgAAAAAAAAAAAA/AAAAAAAAAAAA/////x8A"
            "AABLVFh3cml0ZXIAQmFzaXMgVW5pdmVyc2FsIDIuMTAAAAQAAwAyAAAADQAAACwAAAAAAAAAAAAAAAAAAAACAAAAAAAAAAAAAAAg"
            "QNwAAQAAQBC9EDp7AUwJAAAAAAAg2QEPwIQAAQAAAAByQA6AKQACAAAAIEgaYV7LCgQAAACoqqqqUlVVVQUAwUQAAAAAAADyX00A"
            "mAAAAAAAAEAoASIECAAAAEDCFQHABAAAAAAAAAIIANQc"
        ),
        "UASTC": (
            "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAACAAAAaAAAACwAAACUAAAAJAAAAAAAAAAAAAAAAAAA"
            "AAAAAAC4AAAAAAAAADIAAAAAAAAAQAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AwAAAAAAAAAA/////x8A"
            "AABLVFh3cml0ZXIAQmFzaXMgVW5pdmVyc2FsIDIuMTAAACi1L/0gQE0BAOgXGQXlP8jGABcFGeU/MNkFGSgwJgOXmxsFKNq7AAQA"
            "gHBAykxjCMAF"
        ),
    }.items()
}


def load(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(path, **options)


def triangle(info=None, **material):
    """Return a textured triangle; `info` holds its texture index and further texture properties."""
    writer = GltfWriter()
    made = writer.primitive(ROWS, FACES, material=0)
    made["attributes"]["TEXCOORD_0"] = writer.accessor(UV)
    made["attributes"]["TEXCOORD_1"] = writer.accessor(np.uint8([[0, 0], [255, 51], [0, 255]]), normalized=True)
    writer.node(made, name="t")
    rough = {"baseColorFactor": [1, 0.5, 0.25, 0.5]} | ({"baseColorTexture": info} if info else {})
    writer.content["images"] = [{"bufferView": writer.view(png()), "mimeType": "image/png"}, {"uri": "my%20tex.png"}]
    writer.content["samplers"] = [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}, {}]
    writer.content["textures"] = [{"source": 0, "sampler": 0}, {"source": 1, "sampler": 1}]
    writer.content["materials"] = [{"name": "m", "pbrMetallicRoughness": rough, **material}]
    return writer


def basis_textured(picture):
    """Return a textured triangle whose image is a KTX2 file, by the extension alone."""
    writer = triangle({"index": 0}, alphaMode="BLEND")
    writer.content["extensionsUsed"] = writer.content["extensionsRequired"] = ["KHR_texture_basisu"]
    writer.content["images"][0] = {"bufferView": writer.view(picture), "mimeType": "image/ktx2", "name": "bricks"}
    writer.content["textures"][0] = {"extensions": {"KHR_texture_basisu": {"source": 0}}, "sampler": 0}
    return writer


OBJ = "\n".join(
    ["mtllib m.mtl"]
    + [f"v {number} {number * number % 7} 0" for number in range(1, 13)]
    + ["vt 0 0\nvt 1 0\nvt 0 3"]
    + ["o triangles\nusemtl red\nf 1/1 2/2 3/3\nf 2/1 3/2 4/3\nusemtl blue\nf 3/1 4/1 5/2"]
    + ["o quads\nf 1 2 3 4\nusemtl red\nf 5 6 7 8"]
    + ["o mixed\nf 1 2 3 4 5\nusemtl green\nf 5 6 7"]
    + ["o polygons\nusemtl red\nf 1 2 3 4 5\nusemtl blue\nf 5 6 7 8 9"]
    + ["o unlike\nusemtl red\nf 1/1 2/1 3/1 4/1\nusemtl blue\nf 5 6 7 8\n"]
)
MTL = """
newmtl red
Kd 1 0 0
d 0.5
Ns 10
Ks .1 .2 .3
newmtl blue
Kd 0 0 1
map_Kd -clamp on -s 2 3 1 -o 1 my tex.png
newmtl green
Kd 0 1
Tr 0.25
Ns many
"""

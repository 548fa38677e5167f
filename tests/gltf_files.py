# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of small glTF files: primitives whose data is in one buffer, plain or compressed."""

import json

import numpy as np

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class GltfWriter:
    """Collects accessors and nodes and returns the bytes of a binary file."""

    def __init__(self, **content):
        self.content = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "meshes": [], "nodes": []}
        self.content |= content
        self.data = b""

    def view(self, data, **more):
        self.data += b"\0" * (-len(self.data) % 4)
        self.content["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.content["bufferViews"]) - 1

    def accessor(self, rows, view=None, **more):
        rows = np.asarray(rows)
        width = 1 if rows.ndim == 1 else rows.shape[1]
        view = self.view(rows.tobytes()) if view is None else view
        code = COMPONENTS[rows.dtype.str[1:]]
        kind = ("SCALAR", "VEC2", "VEC3", "VEC4")[width - 1]
        item = {"bufferView": view, "componentType": code, "count": len(rows), "type": kind, **more}
        self.content["accessors"].append(item)
        return len(self.content["accessors"]) - 1

    def primitive(self, vertices, faces=None, mode=4, **more):
        made = {"attributes": {"POSITION": self.accessor(np.float32(vertices))}, "mode": mode, **more}
        if faces is not None:
            made["indices"] = self.accessor(np.uint16(faces).reshape(-1))
        return made

    def node(self, *primitives, mesh=None, **more):
        if primitives:
            self.content["meshes"].append({"primitives": list(primitives), **(mesh or {})})
            more["mesh"] = len(self.content["meshes"]) - 1
        self.content["nodes"].append(more)
        return len(self.content["nodes"]) - 1

    def bytes(self, roots=None, **scene):
        roots = list(range(len(self.content["nodes"]))) if roots is None else roots
        content = {"buffers": [{"byteLength": len(self.data)}], **self.content, "scenes": [{"nodes": roots, **scene}]}
        text = json.dumps(content).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        chunks = b"".join(
            len(chunk).to_bytes(4, "little") + kind + chunk for kind, chunk in ((b"JSON", text), (b"BIN\0", data))
        )
        return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks

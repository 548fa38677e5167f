# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A Webots project with PROTO files."""

from warpvis.webots._grammar import parse_text
from warpvis.webots.protos._expansion import Protos


class Project:
    def __init__(self, root):
        self.root = root
        (root / "worlds").mkdir()
        (root / "protos").mkdir()

    def proto(self, name, interface, body, *, head="", version="R2023b", folder="protos"):
        path = self.root / folder / f"{name}.proto"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#VRML_SIM {version} utf8\n{head}PROTO {name} [\n{interface}\n]\n{{\n{body}\n}}\n")
        return path

    def world(self, text, *, version="R2023b"):
        return parse_text(f"#VRML_SIM {version} utf8\n{text}", str(self.root / "worlds" / "w.wbt"))

    def expand(self, text, *search_path, version="R2023b"):
        """Return the expansion of the last node of a world."""
        world = self.world(text, version=version)
        return Protos(world, search_path).expand(world.nodes[-1])

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots shapes with textures."""

SHAPES = """#VRML_SIM %s utf8
WorldInfo { %s }
Solid { name "old" children [
  Shape { appearance Appearance { material Material { diffuseColor 1 0 0 transparency 0.5 }
            texture ImageTexture { url [ "tex.png" ] repeatS FALSE filtering 0 } } geometry Plane { size 4 2 } }
  Shape { appearance PBRAppearance { baseColor 0 1 0 metalness 0 } geometry Plane {} } ] }
Solid { name "moved" children [ Shape { appearance DEF P PBRAppearance { baseColorMap ImageTexture { url "tex.png" }
  textureTransform TextureTransform { center 0.5 0.25 rotation 1.5707963267948966 scale 2 4 translation 0.125 0 } }
  geometry Plane {} } ] }
Solid { name "box" children [ Shape { appearance PBRAppearance { baseColorMap ImageTexture { url "tex.png" } }
  geometry Box { size 1 2 3 } } ] }
Solid { name "missing" children [ Shape { appearance PBRAppearance { baseColorMap ImageTexture { url "no.png" } }
  geometry Plane {} } ] }
"""
ROUND = """#VRML_SIM R2023b utf8
WorldInfo {}
%s
Solid { name "set" children [ Shape { appearance DEF P PBRAppearance { baseColorMap ImageTexture { url "tex.png" } }
  geometry IndexedFaceSet { coord Coordinate { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0, 2 0 1 ] }
    coordIndex [ 0 1 2 3 -1 1 4 2 -1 1 1 2 -1 ] texCoord TextureCoordinate { point [ 0 0, 1 0, 1 1, 0 1, 5 6 ] }
    texCoordIndex [ 0 1 2 3 -1 4 1 0 -1 0 1 2 -1 ] } } ] }
Solid { name "torn" children [ Shape { appearance USE P geometry IndexedFaceSet {
  coord Coordinate { point [ 0 0 0, 1 0 0, 1 1 0 ] } coordIndex [ 0 1 2 -1 ]
  texCoord TextureCoordinate { point [ 0 0 ] } } } ] }
"""

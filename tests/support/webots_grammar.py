# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A small Webots world."""

HEADER = "#VRML_SIM R2023b utf8\n"
SMALL = (
    HEADER
    + """
EXTERNPROTO "webots://projects/objects/floors/protos/Floor.proto"
IMPORTABLE EXTERNPROTO "../protos/Later.proto"
# a comment with "quotes" and { brackets
WorldInfo { basicTimeStep 16 coordinateSystem "NUE" }
Solid {
  translation 1.5, -.25 3e-1
  children [
    DEF CUBE Shape { geometry Box { size 1 2 3 } castShadows FALSE }
    USE CUBE
    NULL
  ]
  name "a \\"quoted\\" name, with \\\\ and # in it"
  boundingObject USE CUBE
  physics NULL
}
DEF CUBE Floor {
  size 4 5
  hidden translation_0 1 2 3
  hidden name_1 "state"
  url "one.png"
}
USE CUBE
"""
)

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Robot model files."""

BOX = '<geometry><box size="1 2 4"/></geometry>'
MESH = '<geometry><mesh filename="%s" scale=".5 .5 .5"/></geometry>'
ROBOT = f"""<robot name="arm">
  <link name="base"><visual>{BOX}</visual><collision><geometry><sphere radius="9"/></geometry></collision></link>
  <link name="upper"><visual name="v"><origin xyz="0 0 1"/><geometry><cylinder radius=".1" length="1"/></geometry>
  </visual></link>
  <link name="hand"><visual name="v">{MESH % "package://robots/meshes/hand.stl"}</visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="2 0 0" rpy="0 1.5707963 0"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="upper"/><child link="hand"/><origin xyz="0 0 3"/></joint>
</robot>"""

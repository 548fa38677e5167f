# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A Webots world with joints of all types."""

_BOX = "Shape { geometry Box { size 0.1 0.2 0.3 } }"
JOINTS = f"""#VRML_SIM R2023b utf8
Robot {{ name "r" translation 1 0 1 rotation 0 0 1 0.5 children [ {_BOX}
  DEF A HingeJoint {{
    jointParameters HingeJointParameters {{ position 0.3 axis 0 1 0 anchor 0.1 0 0 minStop -1 maxStop 2 }}
    device [ RotationalMotor {{ name "m" maxVelocity 2 minPosition -0.5 maxPosition 0.5 }} PositionSensor {{ }} ]
    endPoint Solid {{ name "one" translation 0.2 0 0.1 rotation 0 1 0 0.3 children [ {_BOX} Camera {{ }}
      SliderJoint {{ jointParameters JointParameters {{ position 0.1 axis 1 0 0 }}
        device LinearMotor {{ maxPosition 0.4 }} endPoint Solid {{ translation 0.3 0 0 children [ {_BOX} ] }} }}
      Hinge2Joint {{ jointParameters HingeJointParameters {{ axis 0 0 1 }}
        jointParameters2 JointParameters {{ axis 1 0 0 }} device2 RotationalMotor {{ name "n" }}
        endPoint Solid {{ translation 0 0 0.5 children [ {_BOX} ] }} }} ] }} }}
  BallJoint {{ jointParameters BallJointParameters {{ anchor 0 0 0.2 }}
    jointParameters3 JointParameters {{ axis 0 1 0 }} endPoint DEF BALL Solid {{ name "ball" children [ {_BOX} ] }} }}
  HingeJointWithBacklash {{ startPoint {_BOX} endPoint USE BALL }}
] }}
"""

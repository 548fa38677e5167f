# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for a ROS 2 node and tf, for tests of the examples."""

from types import SimpleNamespace


class Missing(Exception):
    """Stand-in for tf's TransformException."""


class Buffer:
    """Stand-in for tf's buffer: poses of frames in the map, known only at given times [s]."""

    def __init__(self, messages):
        self._messages, self._poses = messages, {}

    def tell(self, frame, row, time):
        self._poses.setdefault(frame, {})[time] = row

    def lookup_transform(self, target, source, time):
        known = self._poses.get(source, {}) if target == "map" else {}
        at = max(known, default=None) if time.stamp is None else time.stamp.sec + 1e-9 * time.stamp.nanosec
        if at not in known:
            raise Missing(source)
        make, (x, y, z, qx, qy, qz, qw) = self._messages, known[at]
        stamp = make["builtin_interfaces/msg/Time"](sec=int(at), nanosec=round(at % 1 * 1e9))
        return make["geometry_msgs/msg/TransformStamped"](
            header=make["std_msgs/msg/Header"](stamp=stamp, frame_id=target),
            child_frame_id=source,
            transform=make["geometry_msgs/msg/Transform"](
                translation=make["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                rotation=make["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
            ),
        )


class Time:
    """Stand-in for rclpy's Time: without a stamp, the latest."""

    def __init__(self, stamp=None):
        self.stamp = stamp

    @staticmethod
    def from_msg(stamp):
        return Time(stamp)


class Node:
    """Stand-in for rclpy's node: it stores published messages and runs no callbacks."""

    def __init__(self, messages, parameters):
        self._messages, self._parameters = messages, parameters
        self.published, self.takes, self.warned, self.timers = {}, {}, [], []

    def declare_parameter(self, name, default):
        value = self._parameters.get(name, default)
        assert type(value) is type(default), name
        return SimpleNamespace(value=value)

    def create_publisher(self, kind, topic, depth):
        sent = self.published[topic] = []

        def publish(message):
            assert isinstance(message, kind), topic
            sent.append(message)

        return SimpleNamespace(publish=publish)

    def create_subscription(self, kind, topic, callback, qos):
        self.takes[topic] = (kind, callback, qos)

    def create_timer(self, period, callback):
        self.timers.append((period, callback))

    def get_logger(self):
        return SimpleNamespace(warning=self.warned.append)

    def get_clock(self):
        now = self._messages["builtin_interfaces/msg/Time"](sec=77, nanosec=5)
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: now))

    def destroy_node(self):
        self.destroyed = True

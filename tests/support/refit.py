# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes with moving vertices."""

import numpy as np
import trimesh

import warpvis as wv

from compare import assert_matches_reference

ALL = ("depth", "points", "normals", "labels", "segmentation")
SMALL = wv.Camera.from_fov(64, 48, hfov=0.994837, near=0.05, far=100.0)
BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.4)


def eyes(count):
    angles = 2 * np.pi * np.arange(count) / count + 0.3
    places = [(2.6 * np.cos(a), 2.6 * np.sin(a), 1.2) for a in angles]
    return np.array([wv.look_at(place, (0, 0, 0.5)) for place in places]).astype(np.float32)


def assert_seen(scene, twin, caster, poses=None, **options):
    """Check that the scene renders as its equivalent of static objects."""
    poses = eyes(2) if poses is None else poses
    views = wv.render(scene, SMALL, poses, outputs=ALL, caster=caster, **options)
    assert_matches_reference(views, twin, SMALL, poses, cull_backfaces=options.get("cull_backfaces", False))
    return views

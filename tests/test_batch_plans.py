# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs and options that a dataset format does not support raise one sentence."""

from __future__ import annotations

import pytest

import warpvis as wv
from warpvis.batch import find_format

from support import batch_layouts
from support.batch_layouts import plan_of

rendered = batch_layouts.rendered  # a fixture

BAD_PLANS = {
    "png normals": (
        "png",
        {"outputs": ("depth", "normals")},
        "albedo, color, depth, labels, reasons, segmentation, true_depth for format 'png', got normals",
    ),
    "png nothing": (
        "png",
        {"outputs": ()},
        "albedo, color, depth, labels, reasons, segmentation, true_depth for format 'png', got none",
    ),
    "tum labels": (
        "tum",
        {"outputs": ("depth", "labels")},
        "outputs must be from color, depth for format 'tum', got labels",
    ),
    "ply depth": (
        "ply",
        {"outputs": ("depth",)},
        "color, labels, normals, points, segmentation for format 'ply', got depth",
    ),
    "ply pointless": ("ply", {"outputs": ("labels",)}, "outputs must include points for format 'ply', got labels"),
    "colmap objects": (
        "colmap",
        {"outputs": ("segmentation",)},
        "outputs must be from color, depth, normals for format 'colmap', got segmentation",
    ),
    "nerfstudio points": (
        "nerfstudio",
        {"outputs": ("points",)},
        "outputs must be from color, depth, labels for format 'nerfstudio', got points",
    ),
    "nerfstudio colorless": (
        "nerfstudio",
        {"outputs": ("depth", "labels")},
        "outputs must include color for format 'nerfstudio', which trains on color images, got depth, labels. Use",
    ),
    "unknown option": ("tum", {"options": {"scale": 1}}, "format 'tum' has no option 'scale'; its options: color=png"),
    "color file": ("tum", {"options": {"color": "gif"}}, "option color must be png, jpeg or webp for 'tum', got 'gif'"),
    "bop webp": (
        "bop",
        {
            "outputs": ("color", "depth", "visibility"),
            "options": {"color": "webp"},
        },
        "option color must be png or jpeg for 'bop', got 'webp'",
    ),
    "color of depth": (
        "tum",
        {"outputs": ("depth",), "options": {"color": "jpeg"}},
        "option color requires the output color, got depth",
    ),
    "quality of png": ("tum", {"options": {"quality": 90}}, "quality must be given only with color=jpeg or color=webp"),
    "high quality": (
        "tum",
        {"options": {"color": "jpeg", "quality": 101}},
        "option quality must be a whole number from 1 to 100, got 101",
    ),
    "worded quality": (
        "colmap",
        {"options": {"color": "webp", "quality": "best"}},
        "option quality must be a whole number from 1 to 100, got 'best'",
    ),
    "negative scale": ("png", {"options": {"scale": -1}}, "option scale must be a positive number, got -1"),
    "worded scale": ("png", {"options": {"scale": "mm"}}, "option scale must be a positive number, got 'mm'"),
    "no scale": ("png", {"options": {"scale": None}}, "option scale must be a positive number, got None"),
    "true scale": ("png", {"options": {"scale": True}}, "option scale must be a positive number, got True"),
    "endless scale": ("png", {"options": {"scale": "inf"}}, "option scale must be a positive number, got 'inf'"),
    "odd flag": ("ply", {"options": {"organized": "yes"}}, "option organized must be true or false, got 'yes'"),
    "same times": (
        "tum",
        {"timestamps": [0, 1, 1, 2, 3]},
        r"timestamps must increase for format 'tum', got 1.0 s in frame 2 after 1.0 s",
    ),
    "many objects": (
        "png",
        {"object_names": ("a",) * 65536, "object_labels": (2,) * 65536},
        "format 'png' supports at most 65535 objects, got 65536",
    ),
}


@pytest.mark.parametrize("case", BAD_PLANS)
def test_invalid_plans_raise(rendered, case):
    kind, changes, message = BAD_PLANS[case]
    with pytest.raises(wv.errors.FileFormatError, match=message) as caught:
        find_format(kind)(plan_of(rendered, kind, **changes))
    assert "\n" not in str(caught.value)

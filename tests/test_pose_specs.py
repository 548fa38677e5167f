# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pose specs of the command line: equal to the generators, and one-line errors for malformed specs."""

import numpy as np
import pytest

import warpvis as wv
from warpvis import scenes
from warpvis.pose_generators import along, frames_from_spec, grid, looks_like_spec, orbit, random_poses, sphere


def test_specs_match_generators(tmp_path):
    scene = scenes.PRESETS["room"].build("cpu")
    (tmp_path / "my walk.txt").write_text("0 0 1\n1 1 1\n")
    box = np.array([(0, 0, 0), (1, 1, 1)])
    for text, expected, source in (
        (
            "orbit target=0,0,0.5 radius=2 height=1 count=36 start=0.5",
            orbit((0, 0, 0.5), radius=2, height=1, count=36, start=0.5),
            {"generator": "orbit", "target": [0, 0, 0.5], "radius": 2, "height": 1, "count": 36, "start": 0.5},
        ),
        (
            "sphere  count=10 target=0,0,1e-1 radius=2",
            sphere((0, 0, 0.1), radius=2, count=10),
            {"generator": "sphere", "count": 10, "target": [0, 0, 0.1], "radius": 2},
        ),
        (
            "grid step=0.5 bounds=0,0,0,1,1,1 headings=2 pitch=-0.5",
            grid(box, step=0.5, headings=2, pitch=-0.5),
            {"generator": "grid", "step": 0.5, "bounds": box.tolist(), "headings": 2, "pitch": -0.5},
        ),
        (
            "grid step=1 look_at=0,0,0.5",
            grid(scene.bounds, step=1, look_at=(0, 0, 0.5)),
            {"generator": "grid", "step": 1, "look_at": [0, 0, 0.5], "bounds": scene.bounds.tolist()},
        ),
        (
            "random count=50 seed=1 clearance=0.3 look=any",
            random_poses(scene, count=50, seed=1, clearance=0.3, look="any"),
            {
                "generator": "random",
                "count": 50,
                "seed": 1,
                "clearance": 0.3,
                "look": "any",
                "bounds": scene.bounds.tolist(),
            },
        ),
        (
            "random count=5 bounds=0,0,0,1,1,1 look=0,0,5",
            random_poses(box, count=5, seed=0, look=(0, 0, 5)),
            {"generator": "random", "count": 5, "seed": 0, "bounds": box.tolist(), "look": [0, 0, 5]},
        ),
        (
            f"along path='{tmp_path / 'my walk.txt'}' count=5",
            along([(0, 0, 1), (1, 1, 1)], count=5),
            {"generator": "along", "path": "my walk.txt", "count": 5},
        ),
    ):
        assert looks_like_spec(text)
        frames = frames_from_spec(text, scene)
        np.testing.assert_array_equal(frames.camera_to_world, expected)
        assert frames.source == {"up": "z", **source}
        np.testing.assert_array_equal(frames.timestamps, np.arange(len(expected)))


def test_looks_like_spec(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for text in ("orbit", "orbit radius=2", "obrit radius=2 height=1", "random  count=3", "orbit target=0, 0, 1"):
        assert looks_like_spec(text), text
    for text in ("", "poses.txt", "my poses.txt", "out=3/poses.txt", "walk", "'", "a\0b", "s3://x/y.npz"):
        assert not looks_like_spec(text), text
    for name in ("orbit", "random count=3"):
        (tmp_path / name).write_text("")
        assert not looks_like_spec(name)


ORBIT = "orbit target=0,0,0 radius=1 height=1 count=3"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "a pose spec must begin with one of orbit, sphere, grid, random, along, got ''"),
        ("obrit radius=2", "a pose spec must begin with one of orbit, sphere, grid, random, along, got 'obrit'"),
        ("orbit 'a", 'the spec "orbit \'a" cannot be parsed: No closing quotation'),
        ("orbit", "orbit needs target, radius, height, count; its keys are target, radius, height, count, [start]"),
        ("orbit radius=1", "orbit needs target, height, count; its keys are target, radius, height, count, [start]"),
        (
            ORBIT + " color=1",
            "orbit has no 'color'; its keys are target, radius, height, count, [start], each as key",
        ),
        (ORBIT + " 5", "orbit has no '5'; its keys are"),
        (ORBIT + " count=3", "count of orbit must be given once, got it twice"),
        ("orbit radius=1m", "radius of orbit must be a finite number, got '1m'"),
        ("orbit radius=nan", "radius of orbit must be a finite number, got 'nan'"),
        ("orbit target=1,2", "target of orbit must be three finite numbers X,Y,Z, got '1,2'"),
        ("orbit count=3.5", "count of orbit must be a whole number, got '3.5'"),
        ("orbit count=", "count of orbit must be a whole number, got ''"),
        (ORBIT.replace("count=3", "count=0"), "count must be a whole number from 1 up, got 0"),
        (ORBIT.replace("radius=1", "radius=-1"), "radius must be a positive number of meters, got -1.0"),
        (
            "grid bounds=0,0,0,1,1 step=1",
            "bounds of grid must be six finite numbers, the lower and upper corner",
        ),
        ("grid step=1", "grid needs bounds=, or a scene"),
        ("random count=3", "random needs bounds=, or a scene"),
        ("random count=3 look=up", "look of random must be level or any or three finite numbers X,Y,Z, got 'up'"),
        (
            "random count=3 bounds=0,0,0,1,1,1 clearance=1",
            "clearance= requires a scene, since it is a distance",
        ),
        ("along count=3 path=/nowhere/walk.txt", "/nowhere/walk.txt: no such file"),
    ],
)
def test_malformed_specs_are_rejected(text, said):
    with pytest.raises(wv.WarpvisError) as error:
        frames_from_spec(text)
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of methods on situations: each method on a ball that is in view, behind a screen, or out of view."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import look_along

sys.path.append(str(Path(__file__).resolve().parent.parent / "bench"))

import situation_methods as bench

AWAY = (0, 0, -50, 0, 0, 0, 1)


@pytest.fixture(scope="module")
def batch():
    """A ball in view, behind a screen, and behind the viewer."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor", pose=(0, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(3, 0.15), name="ball", pose=(2, 0, 1.2, 0, 0, 0, 1), movable=True)
    scene.add(trimesh.creation.box((0.05, 1, 2)), name="screen", pose=AWAY, movable=True)
    ball, screen = (2, 0, 1.2, 0, 0, 0, 1), (1, 0, 1, 0, 0, 0, 1)
    poses = np.array([[ball, AWAY], [ball, screen], [ball, AWAY]], dtype=np.float32)
    eyes = poses_to_matrices(
        look_along(np.full((3, 3), (0, 0, 1.2)), np.array([(1, 0, 0), (1, 0, 0), (-1, 0, 0.0)]), 2)
    )
    around = np.stack([bench.look_around((0, 0, 1.2))] * 3)
    boxes, sizes = np.repeat(np.eye(4)[None], 3, axis=0), np.full((3, 3), 0.3)
    boxes[:, :3, 3] = ball[:3]
    hidden = np.zeros((3, 3), dtype=np.bool_)
    return bench.Batch(scene, wv.Camera.kinect(), ["ball"] * 3, poses, eyes, hidden, boxes, sizes, around)


def test_methods_agree_on_clear_cases(batch):
    exact, *others = bench.answer(batch, np.random.default_rng(0))
    assert set(exact) == set(bench.METHODS)
    assert not [name for name, found in exact.items() if found.tolist() != [True, False, False]]
    assert all(set(found) == set(bench.METHODS) for found in others)


def test_noise_turns_and_moves_poses(batch):
    turned = bench.disturb(batch.eyes, np.full((3, 3), [0, np.radians(5), 0]), np.full((3, 3), 0.1))
    cosine = np.einsum("wij,wij->w", turned[:, :3, :3], batch.eyes[:, :3, :3])
    np.testing.assert_allclose(np.degrees(np.arccos((cosine - 1) / 2)), 5, atol=1e-4)
    np.testing.assert_allclose(turned[:, :3, 3] - batch.eyes[:, :3, 3], 0.1, atol=1e-6)


def test_tables_count_correct_answers(capsys):
    picture = np.zeros((36, 48, 5), dtype=np.uint8)
    answers = {(bench.EXACT, noise): True for noise in range(len(bench.POSE_NOISE))}
    cases = [
        bench.Case("low", "low 0/0", sees, bench.GROUPS[0 if sees else 2], False, picture, answers)
        for sees in (True, True, True, False)
    ]
    share, low, high, count = bench.accuracy(cases, bench.EXACT)
    assert (share, count) == (0.75, 4)
    assert (round(low, 3), round(high, 3)) == (0.301, 0.954)  # Wilson's interval of 3 in 4
    bench.print_table(cases, [bench.EXACT])
    assert "| exact fractions | 75 ± 33 |" in capsys.readouterr().out

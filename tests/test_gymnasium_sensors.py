# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth-camera models in Gymnasium observations: noise by seed, in single and vector environments."""

import pickle
from functools import partial

import numpy as np
import pytest

import warpvis as wv
from warpvis.sensors import Reason, StereoDepth, TimeOfFlight, randomized

gym = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium_environments import Cup, make_cup  # noqa: E402

from warpvis.mujoco.gymnasium import DepthObservation, VectorDepthObservation  # noqa: E402

NOISY = StereoDepth(0.06, sigma=0.1, dropout=0.05, shadow=False)
LOOK = {"camera": "front", "width": 40, "height": 32, "sensor": NOISY}
ALL = LOOK | {"outputs": ("depth", "reasons", "true_depth", "segmentation"), "objects": ("cup",)}
WALL = (slice(10, 20), slice(24, 30))  # not moved by any joint
STILL = np.zeros(1, dtype=np.float32)


def vector(wrapper, mode="NextStep", length=1000, **options):
    makers = [partial(make_cup, wrapper, length=length, **options)] * 3
    return gym.vector.SyncVectorEnv(makers, autoreset_mode=mode)


def assert_same(one, other):
    """Check equality up to rounding of poses; lost pixels are lost in both."""
    assert set(one) == set(other)
    for name, value in one.items():
        assert np.isclose(value, other[name], rtol=1e-3, atol=1e-3).mean() > 0.995, name


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("camera", ["front", ["front", "chase"]])
def test_gymnasium_env_checker(camera):
    env = DepthObservation(Cup(), **(ALL | {"camera": camera}))
    check_env(env, skip_render_check=True)
    observation, _ = env.reset(seed=1)
    assert observation in env.observation_space
    depth, reasons = observation["depth"], observation["reasons"]
    assert set(np.unique(reasons)) >= {Reason.VALID, Reason.EMPTY, Reason.BAND, Reason.DROPOUT}
    assert (depth[reasons > 0] == 20).all() and (depth[reasons == 0] < 20).all()
    true = observation["true_depth"]
    errors = np.abs(depth - true)[reasons == 0]
    assert 0.01 < np.median(errors) < 0.2  # 0.1 px with 6 cm and 34 px at 3 m: 0.3 m
    np.testing.assert_array_equal(true == np.inf, observation["segmentation"] == -1)


def test_noise_depends_on_seed_and_step():
    env = DepthObservation(Cup(), **LOOK)
    other = DepthObservation(Cup(), **LOOK)
    episodes = [[env.reset(seed=seed)[0]["depth"], env.step(STILL)[0]["depth"]] for seed in (3, 3, 4)]
    np.testing.assert_array_equal(*episodes[:2])
    np.testing.assert_array_equal(other.reset(seed=3)[0]["depth"], episodes[0][0])
    # Static pixels have different noise in the next step, with another seed, and after an unseeded reset.
    images = [*episodes[0], *episodes[2], env.reset()[0]["depth"], DepthObservation(Cup(), **LOOK).reset()[0]["depth"]]
    for index, image in enumerate(images):
        for before in images[:index]:
            assert (image[WALL] != before[WALL]).mean() > 0.5
    with np.errstate(divide="ignore"):
        errors = [1 / image[WALL].ravel() for image in images[:-1]]  # those that are the same in each run
    alike = np.corrcoef(errors) - np.eye(len(errors))
    assert np.abs(alike).max() < 0.5


def test_pickled_copy_continues_the_noise():
    env = DepthObservation(Cup(), **LOOK)
    first = env.reset(seed=5)[0]["depth"]
    again = pickle.loads(pickle.dumps(env))
    second, wanted = again.reset()[0]["depth"][WALL], env.reset()[0]["depth"][WALL]
    np.testing.assert_array_equal(second, wanted)
    assert (second != first[WALL]).mean() > 0.5


@pytest.mark.smoke("*-NextStep")
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("camera", ["front", ["chase", "front"]])
def test_noise_is_equal_alone_and_in_a_vector(mode, camera):
    one = vector("DepthObservation", mode, 3, **(ALL | {"camera": camera}))
    all_ = VectorDepthObservation(vector("PoseObservation", mode, 3), **(ALL | {"camera": camera}))
    assert one.observation_space == all_.observation_space
    wanted, got = one.reset(seed=[7, 1, 5])[0], all_.reset(seed=[7, 1, 5])[0]
    assert_same(wanted, got)
    assert (got["reasons"][0] != got["reasons"][1]).mean() > 0.02
    for _ in range(5):
        actions = np.zeros((3, 1), dtype=np.float32)
        (wanted, *_, expected), (got, *_, infos) = one.step(actions), all_.step(actions)
        assert got in all_.observation_space
        assert_same(wanted, got)
        for last, other in zip(expected.get("final_obs", ()), infos.get("final_obs", ()), strict=True):
            assert_same(last, other)


def test_vector_seeds_are_consecutive():
    envs = VectorDepthObservation(vector("PoseObservation"), **LOOK)
    first = envs.reset(seed=7)[0]["depth"]
    np.testing.assert_array_equal(envs.reset(seed=[7, 8, 9])[0]["depth"], first)
    shifted = envs.reset(seed=8)[0]["depth"]
    np.testing.assert_array_equal(shifted[:2], first[1:])


def test_randomized_sensor_is_drawn_per_episode():
    """The offset is a property of the episode: constant in its steps, and reproducible from the seed."""
    sensor = randomized(TimeOfFlight(1e7, mixing=False), offset=(-0.05, 0.05))
    env = DepthObservation(Cup(), **(LOOK | {"sensor": sensor, "outputs": ("depth", "true_depth")}))

    def offset(observation):
        seen = observation["depth"] < 4.0
        return np.median((observation["depth"] - observation["true_depth"])[seen])

    runs = []
    for seed in (3, 3, 4):
        runs.append([])
        for reset in ({"seed": seed}, {}, {}):
            first, second = offset(env.reset(**reset)[0]), offset(env.step(STILL)[0])
            assert abs(first) < 0.06 and abs(first - second) < 1e-3
            runs[-1].append(first)
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-3)
    differences = np.abs(np.subtract.outer([*runs[0], *runs[2]], [*runs[0], *runs[2]]))
    assert (differences[~np.eye(6, dtype=bool)] > 1e-4).all()


def test_environments_without_reset_continue():
    envs = VectorDepthObservation(vector("PoseObservation", "Disabled"), **LOOK)
    first = envs.reset(seed=0)[0]["depth"]
    before = envs.step(np.zeros((3, 1), dtype=np.float32))[0]["depth"]
    chosen = np.array([True, False, False])
    after = envs.reset(seed=[0, None, None], options={"reset_mask": chosen})[0]["depth"]
    np.testing.assert_array_equal(after[0], first[0])
    np.testing.assert_array_equal(after[1:], before[1:])


def test_invalid_arguments_raise():
    with pytest.raises(wv.errors.ArrayError, match='fill must be "far" or a number with a sensor, got "inf"'):
        DepthObservation(Cup(), **LOOK, fill="inf")
    with pytest.raises(wv.errors.ArrayError, match="sensor must be a model of"):
        DepthObservation(Cup(), **(LOOK | {"sensor": "d435"}))
    with pytest.raises(wv.errors.ArrayError, match="outputs must be"):
        DepthObservation(Cup(), camera="front", outputs=("depth", "reasons"))

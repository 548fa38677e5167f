# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions as rewards and observations of Gymnasium environments, single and in vectors."""

import pickle
from functools import partial

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import ArrayError, SceneError

gym = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium_environments import Cup, make_cup  # noqa: E402

from warpvis.mujoco.gymnasium import (  # noqa: E402
    VectorDepthObservation,
    VectorVisibilityReward,
    VectorVisibleFractions,
    VisibilityReward,
    VisibleFractions,
)

SEEN = {"camera": "front", "width": 24, "height": 18}


class Rolling(Cup):
    """A cup that rolls behind a wall."""

    def reset(self, **options):
        super().reset(**options)
        self.data.qvel[0] = 3
        return self.now(), {}


def rolled(env, steps=12):
    """Return rewards and infos of a cup that rolls behind a wall."""
    env.reset(seed=0)
    results = [env.step(np.ones(1, dtype=np.float32)) for _ in range(steps)]
    return np.array([result[1] for result in results]), [result[4] for result in results]


def measured(steps=12, **options):
    """Return fractions, or shaped values, of the same episode and of its beginning."""
    env = VisibilityReward(Rolling(), ["cup"], **SEEN, **options)
    name = "visible_shaped" if options.get("shaped") else "visible_fraction"
    first = env.reset(seed=0)[1][name][0]
    return first, np.array([info[name][0] for info in rolled(env, steps)[1]], dtype=np.float64)


@pytest.mark.parametrize("shaped", [False, True])
def test_rewards(shaped):
    first, values = measured(shaped=shaped, steps=30)
    assert values.max() >= 1 and values.min() < 0.5, "the wall hides a part of the cup"
    make = partial(VisibilityReward, bodies=["cup"], shaped=shaped, **SEEN)
    assert np.allclose(rolled(make(Rolling(), weight=2), 30)[0], 2 * values)
    before = np.r_[first, values[:-1]]
    assert np.allclose(rolled(make(Rolling(), mode="delta", discount=0.9), 30)[0], 0.9 * values - before)
    expected = -3 * np.maximum(np.maximum(0.6 - values, values - 0.9), 0)
    assert np.allclose(rolled(make(Rolling(), mode="constraint", target=(0.6, 0.9), weight=3), 30)[0], expected)
    earning = gym.wrappers.TransformReward(Rolling(), lambda reward: reward + 5)
    assert np.allclose(rolled(make(earning), 30)[0], values + 5)
    assert np.allclose(rolled(make(earning, replace=True), 30)[0], values)


def test_reasons_and_fractions_of_several_bodies():
    env = VisibilityReward(Cup(), ["cup", "lamp"], **SEEN)
    rewards, infos = rolled(env)
    assert np.allclose(rewards, [info["visible_fraction"].mean() for info in infos])
    for info in infos:
        assert np.array_equal(info["visible_reason"] == wv.Visibility.VISIBLE, info["visible_fraction"] > 0)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("wrapper", [VisibilityReward, VisibleFractions])
def test_gymnasium_env_checker(wrapper):
    env = wrapper(Cup(), ["cup"], **SEEN)
    check_env(env, skip_render_check=True)
    env.reset(seed=3)
    again = pickle.loads(pickle.dumps(env))
    result, expected = again.step(np.ones(1)), env.step(np.ones(1))
    assert result[4]["visible_fraction"] == expected[4]["visible_fraction"]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("wrapper", [VisibilityReward, VisibleFractions])
def test_registered_environment(wrapper):
    pytest.importorskip("imageio")
    env = wrapper(gym.make("Reacher-v5"), ["target"], width=24, height=18)
    again = env.spec.make()
    assert again.observation_space == env.observation_space
    assert env.reset(seed=1)[1]["visible_fraction"] == again.reset(seed=1)[1]["visible_fraction"]


def test_observations():
    env = VisibleFractions(Cup(dictionary=True), ["cup", "lamp"], **SEEN)
    observation, info = env.reset(seed=0)
    assert set(observation) == {"joints", "visible_fraction"} and env.observation_space.contains(observation)
    assert np.array_equal(observation["visible_fraction"], info["visible_fraction"])


def test_fractions_follow_the_model():
    env = VisibleFractions(Cup(), ["cup"], **SEEN)
    env.reset(seed=0)
    hidden = env.unwrapped.model.geom("wall").id
    env.unwrapped.data.qpos[0] = 1.0
    env.unwrapped.set_model("geom_rgba", hidden, [1, 1, 1, 0])
    assert env._look().fraction == 1
    env.unwrapped.set_model("geom_rgba", hidden, [1, 1, 1, 1])
    assert env._look().fraction < 0.5


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("kind", ["sync", "fork"])
def test_vectors_equal_single_environments(kind, mode):
    lengths, options = (3, 5), {"autoreset_mode": mode} | ({} if kind == "sync" else {"context": kind})
    make = gym.vector.SyncVectorEnv if kind == "sync" else gym.vector.AsyncVectorEnv
    rewarded = {**SEEN, "shaped": True, "mode": "delta", "weight": 2.0}

    def run(envs):
        found = [envs.reset(seed=[4, 7])]
        try:
            for _ in range(9):
                found.append(envs.step(np.ones((2, 1), dtype=np.float32)))
        finally:
            envs.close()
        return found

    singles = [partial(make_cup, "VisibilityReward", bodies=["cup"], length=length, **rewarded) for length in lengths]
    posed = [partial(make_cup, "PoseObservation", length=length) for length in lengths]
    expected = run(make(singles, **options))
    found = run(VectorVisibilityReward(make(posed, **options), ["cup"], **rewarded))
    for one, other in zip(found[1:], expected[1:], strict=True):
        assert np.allclose(one[1], other[1], atol=1e-6)
        for name in ("visible_fraction", "visible_reason", "visible_shaped"):
            assert np.allclose(one[4][name], other[4][name], atol=1e-6)
            if "final_info" in other[4]:
                mask = other[4]["final_info"][f"_{name}"]
                assert np.array_equal(mask, one[4]["final_info"][f"_{name}"])
                assert np.allclose(one[4]["final_info"][name][mask], other[4]["final_info"][name][mask], atol=1e-6)
        assert set(one[0]) == {"state"} and np.array_equal(one[0]["state"], other[0])


def test_vectors_with_fractions_and_depth():
    envs = gym.vector.SyncVectorEnv([partial(make_cup, "PoseObservation", length=2)] * 2, autoreset_mode="SameStep")
    envs = VectorVisibleFractions(envs, ["cup", "lamp"], keep_poses=True, **SEEN)
    envs = VectorDepthObservation(envs, **SEEN)
    observations, infos = envs.reset(seed=0)
    assert set(observations) == {"state", "depth", "visible_fraction"}
    assert envs.observation_space.contains(observations)
    assert np.array_equal(observations["visible_fraction"], infos["visible_fraction"])
    for _ in range(2):
        observations, *_, infos = envs.step(np.ones((2, 1), dtype=np.float32))
    final = infos["final_obs"][1]
    assert set(final) == {"state", "depth", "visible_fraction"} and envs.single_observation_space.contains(final)
    envs.close()


def test_bad_input():
    for options, message in (
        ({"mode": "sparse"}, 'mode must be "fraction", "delta" or "constraint", got .sparse.'),
        ({"mode": "constraint"}, 'target must be a range with mode="constraint" and only then, got None'),
        ({"target": (0.5, 1)}, 'target must be a range with mode="constraint" and only then'),
        ({"mode": "constraint", "target": (1, 0)}, "target must be the lower and the upper end of a range"),
        ({"discount": 2}, "discount must be between 0 and 1, got 2"),
        ({"weight": "much"}, "weight must be"),
    ):
        with pytest.raises(ArrayError, match=message):
            VisibilityReward(Cup(), ["cup"], **SEEN, **options)
    with pytest.raises(SceneError, match=r"bodies must be names or ids .*, got 'mug'"):
        VisibleFractions(Cup(), ["mug"])
    with pytest.raises(SceneError, match=r"every environment must be wrapped in .*PoseObservation"):
        VectorVisibilityReward(gym.vector.SyncVectorEnv([make_cup]), ["cup"])

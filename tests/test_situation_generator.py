# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generated situations: answers against measurements of their scenes, twins, moments, and determinism."""

import json
import re
from collections import Counter, defaultdict
from functools import cache

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.situations import QUESTION_KINDS, SituationGenerator, SituationOptions, StageOptions
from warpvis.situations._wording import LEFT, NEVER, NO, YES

OPTIONS = SituationOptions(seed=11, per_shard=60, outputs=())
ORDINALS = ("the first", "the second", "the third", "the fourth")


@cache
def situations():
    return tuple(SituationGenerator(OPTIONS).shard(1)) + tuple(SituationGenerator(OPTIONS).shard(3))


def questions(kind):
    found = [(one, question) for one in situations() for question in one.questions if question.kind == kind]
    assert found, kind
    return found


def bodies(scene, name):
    """Return the indices of the objects of a participant."""
    return [index for index, item in enumerate(scene) if item.name == name or item.name.startswith(f"{name}/")]


@cache
def scene_of(shard, attempt):
    """Return the scene of a room of the options, at any moment."""
    one = next(one for one in situations() if (one.room["shard"], one.room["attempt"]) == (shard, attempt))
    return SituationGenerator(OPTIONS).scene(one)


def shares(situation, agent, moment=0, removed=(), eyes=None):
    """Return the visible share of each object of interest for a participant, by a call of its own."""
    scene = scene_of(situation.room["shard"], situation.room["attempt"])
    now = situation.moments[moment]
    poses = np.array([[now.poses[scene.objects[index].name] for index in scene.movable]])
    who = next(one for one in now.participants if one.name == agent)
    camera = OPTIONS.stage.person_view if who.kind == "person" else OPTIONS.stage.robot_view
    hidden = bodies(scene, agent) + [index for name in removed for index in bodies(scene, name)]
    names = [thing.name for thing in now.things]
    found = wv.visible_fractions(
        scene, camera, who.eyes if eyes is None else eyes, objects=names, exclude=hidden, object_poses=poses
    )
    return dict(zip(names, found.fraction.numpy()[0].tolist(), strict=True))


def share(situation, agent, thing, **options):
    return shares(situation, agent, **options)[thing]


def test_all_kinds_of_questions_occur_and_answers_are_balanced():
    answers = defaultdict(Counter)
    for one in situations():
        for question in one.questions:
            answers[question.kind][question.answer] += 1
            assert question.answer in question.choices and len(set(question.choices)) == len(question.choices)
            assert question.margin >= 0 and len(question.paraphrases) >= 2
            assert question.text[0].isupper() and question.text[-1] in "?."
    assert len(answers) >= len(QUESTION_KINDS) - 2, sorted(answers)
    for kind in {"sees", "left_right", "without", "step"} & answers.keys():
        assert len(set(answers[kind].values())) == 1, answers[kind]  # each answer as often as the other


def test_same_words_have_all_answers_equally_often():
    """A reader of the questions who knows how often each text has each answer is at chance."""
    texts = defaultdict(Counter)
    for one in situations():
        for question in one.questions:
            if question.kind in ("sees", "left_right", "nearer", "meant", "without"):
                texts[one.room["seed"], question.text][question.answer] += 1
    assert all(len(set(counts.values())) == 1 and len(counts) == 2 for counts in texts.values())


def test_visible_shares_are_those_of_the_scene():
    for one in situations()[::7]:
        for moment, now in enumerate(one.moments):
            for who in now.participants:
                expected = shares(one, who.name, moment)
                found = {s.thing: s.fraction for s in one.sights if s.agent == who.name and s.time == moment}
                assert found == pytest.approx(expected, abs=6e-3)


def test_who_sees_what():
    for one, question in questions("sees")[::5]:
        seen = share(one, *question.about)
        assert seen >= 0.25 - 6e-3 if question.answer == YES else seen <= 0.016
    for one, question in questions("who")[::7]:
        first, second, thing = question.about
        by = share(one, first, thing) >= 0.1, share(one, second, thing) >= 0.1
        assert question.choices.index(question.answer) == {(1, 0): 0, (0, 1): 1, (1, 1): 2, (0, 0): 3}[by]
    for one, question in questions("meant")[::5]:
        agent, *things = question.about
        seen = [share(one, agent, thing) >= 0.1 for thing in things]
        assert sum(seen) == 1 and question.answer == question.choices[seen.index(True)]


def test_reasons_name_what_hides_an_object():
    """Without the blocker, more of it is visible; outside of the field of view, nothing is."""
    for one, question in questions("why_not")[::5]:
        agent, thing = question.about
        sight = next(s for s in one.sights if (s.agent, s.thing, s.time) == (agent, thing, 0))
        assert sight.fraction <= 0.01
        if " hides it " in question.answer:
            assert sight.blockers[0][1] >= 0.7
        else:
            assert sight.state in ("out_of_view", "too_far", "too_near")


def test_hypothetical_answers_are_those_of_changed_scenes():
    for one, question in questions("without")[::4]:
        agent, thing, blocker = question.about
        seen = share(one, agent, thing, removed=[blocker.split("/")[0]])
        assert seen >= 0.25 - 6e-3 if question.answer == YES else seen <= 0.016
    for one, question in questions("step")[:6]:
        agent, thing = question.about
        eyes = np.array(next(who for who in one.moments[0].participants if who.name == agent).eyes)
        right = wv.core.poses.poses_to_matrices(eyes[None])[0, :3, 0] * (1, 1, 0)
        side = -0.5 if f"to the {LEFT}" in question.text else 0.5
        eyes[:3] += side * right / np.linalg.norm(right)
        seen = share(one, agent, thing, eyes=eyes)
        assert seen >= 0.25 - 6e-3 if question.answer == YES else seen <= 0.016


def test_left_and_right_are_those_of_the_participant():
    for one, question in questions("left_right"):
        agent, *pair = question.about
        who = next(who for who in one.moments[0].participants if who.name == agent)
        to_eyes = np.linalg.inv(wv.core.poses.poses_to_matrices(np.array([who.eyes]))[0])
        places = [np.array(thing.pose[:3]) for name in pair for thing in one.moments[0].things if thing.name == name]
        x, _, z = (to_eyes[:3, :3] @ np.transpose(places)) + to_eyes[:3, 3:]
        angles = np.arctan2(x, z)
        if abs(angles[0] - angles[1]) > np.radians(8):  # poses are of the objects' frames, not of their centers
            assert (question.answer == LEFT) == (angles[0] < angles[1])


@pytest.mark.parametrize("kind", ["left_right", "nearer"])
def test_half_of_the_answers_are_those_for_the_camera(kind):
    """Otherwise, a model without perspective answers most of the questions."""
    same = []
    for one, question in questions(kind):
        eyes = np.linalg.inv(wv.core.poses.poses_to_matrices(np.array([one.camera["pose"]]))[0])
        places = {thing.name: np.array(thing.pose[:3]) for thing in one.moments[0].things}
        first, second = (eyes[:3, :3] @ places[name] + eyes[:3, 3] for name in question.about[1:])
        if kind == "left_right":
            same.append(
                (np.arctan2(first[0], first[2]) < np.arctan2(second[0], second[2])) == (question.answer == LEFT)
            )
        else:
            answered_first = question.answer == question.choices[0]
            same.append((np.linalg.norm(first) < np.linalg.norm(second)) == answered_first)
    assert len(same) >= 8 and 0.4 <= np.mean(same) <= 0.6, same  # poses are not those of the centers


def test_twins_differ_by_a_small_movement_of_one_object():
    by_name = {one.name: one for one in situations()}
    pairs = [(one, by_name[one.twin]) for one in situations() if one.twin and one.name < one.twin]
    assert pairs
    for one, other in pairs:
        assert other.twin == one.name and one.changed == other.changed
        first, second = one.moments[0].poses, other.moments[0].poses
        moved = [name for name in first if first[name] != second[name]]
        distance = np.linalg.norm(np.subtract(first[moved[0]][:3], second[moved[0]][:3]))
        assert moved == [one.changed["object"]] and 0 < distance <= 0.0501
        assert distance == pytest.approx(one.changed["meters"], abs=1e-3)
        a, b = one.questions[0], other.questions[0]
        assert a.text == b.text and {a.answer, b.answer} == {YES, NO}


def test_situations_over_time():
    for one, question in questions("when"):
        agent, thing = question.about
        seen = [share(one, agent, thing, moment=moment) >= 0.1 for moment in range(len(one.moments))]
        assert question.answer == (ORDINALS[seen.index(True)] if any(seen) else NEVER)
    for one, question in questions("belief"):
        agent, thing = question.about
        seen = [share(one, agent, thing, moment=moment) >= 0.1 for moment in range(3)]
        assert seen[:2] == [True, False]
        places = [next(t.pose for t in moment.things if t.name == thing) for moment in one.moments]
        assert places[0] == places[1] != places[2]
        assert ("did not see that it was moved" in question.reason) == (not seen[2])


def test_shards_depend_only_on_options_and_number():
    options = SituationOptions(seed=2, per_shard=6, outputs=("color", "depth", "segmentation"), views="all")
    first, second = (SituationGenerator(options).shard(3) for _ in range(2))
    assert json.dumps([one.to_dict() for one in first]) == json.dumps([one.to_dict() for one in second])
    for one, other in zip(first, second, strict=True):
        assert one.images.keys() == other.images.keys()
        assert all(image.tobytes() == other.images[name].tobytes() for name, image in one.images.items())
    names = {name.split("/")[0] for name in first[-1].images}
    assert names == {"camera", *(who.name for who in first[-1].moments[0].participants)}
    assert len({one.name for one in first}) == len(first) in (5, 6)
    other = SituationGenerator(SituationOptions(seed=3, per_shard=6, outputs=())).shard(3)
    assert other[0].room != first[0].room


def test_pictures_show_the_objects_of_questions():
    options = SituationOptions(seed=2, per_shard=10, outputs=("segmentation",), questions=("sees",))
    generator = SituationGenerator(options)
    for one in generator.shard(0):
        scene, image = generator.scene(one), one.images["camera/segmentation"]
        for question in one.questions:
            assert (image == scene.index(question.about[1])).any()


def test_rooms_have_the_given_clutter():
    _, _, described = SituationGenerator(SituationOptions(seed=7, clutter=(0, 0.1)))._stage(0, 0)
    assert described["clutter"] <= 0.1


def test_a_fifth_of_the_situations_are_twins_where_blockers_fit():
    assert 0.15 <= np.mean([one.twin is not None for one in situations()]) <= 0.2
    few = SituationGenerator(SituationOptions(seed=11, per_shard=4, outputs=())).shard(1)
    assert not any(one.twin for one in few)


def masked_situations():
    options = SituationOptions(
        seed=5, per_shard=4, views="all", outputs=("depth", "segmentation", "amodal_masks", "seen_by")
    )
    generator = SituationGenerator(options)
    for one in generator.shard(2):
        scene = generator.scene(one)
        poses = np.array([[scene.objects[index].pose for index in scene.movable]])
        yield one, scene, poses, "" if len(one.moments) == 1 else "/0"


def test_amodal_masks_are_silhouettes_without_the_other_objects():
    hidden = 0
    for one, scene, poses, end in masked_situations():
        now = one.moments[0]
        names = [[thing.name] for thing in now.things]
        names += [[scene.objects[index].name for index in bodies(scene, who.name)] for who in now.participants]
        masks, shown = one.images[f"camera/amodal_masks{end}"], one.images[f"camera/segmentation{end}"]
        assert masks.shape == (len(names), *shown.shape) and masks.dtype == np.uint8
        for mask, parts in zip(masks, names, strict=True):
            own = [scene.index(name) for name in parts]
            others = [index for index in range(len(scene)) if index not in own]
            alone = wv.render(
                scene, camera_of(one), one.camera["pose"], outputs=("depth",), exclude=others, object_poses=poses
            )
            assert np.array_equal(mask > 0, np.isfinite(alone.depth.numpy()[0]))
            assert np.array_equal(mask == 2, np.isin(shown, own))
            hidden += (mask == 1).any()
        who = now.participants[0]
        assert not one.images[f"{who.name}/amodal_masks{end}"][len(now.things)].any()
    assert hidden


def camera_of(one):
    names = ("width", "height", "fx", "fy", "cx", "cy")
    return wv.Camera(**{name: one.camera["intrinsics"][name] for name in names}, near=0.05, far=np.inf)


def test_seen_by_marks_surfaces_that_participants_see():
    agree, both, seen_by_none = [], 0, 0
    for one, scene, _, end in masked_situations():
        depth, seen = one.images[f"camera/depth{end}"], one.images[f"camera/seen_by{end}"]
        camera, owners = camera_of(one), one.images[f"camera/segmentation{end}"]
        assert not seen[owners < 0].any() and seen.max() < 1 << len(one.moments[0].participants)
        rows, columns = np.nonzero(np.isfinite(depth))
        z = depth[rows, columns].astype(np.float64)
        local = np.column_stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z])
        pose = wv.core.poses.poses_to_matrices(np.array([one.camera["pose"]]))[0]
        world = local @ pose[:3, :3].T + pose[:3, 3]
        both += (np.bitwise_count(seen) > 1).sum() if hasattr(np, "bitwise_count") else ((seen & 3) == 3).sum()
        seen_by_none += (seen[rows, columns] == 0).sum()
        for bit, who in enumerate(one.moments[0].participants):
            view, image = one.camera["views"][who.name], one.images[f"{who.name}/depth{end}"]
            own = np.isin(owners[rows, columns], bodies(scene, who.name))
            eyes = wv.core.poses.poses_to_matrices(np.array([who.eyes]))[0]
            x, y, z = ((world - eyes[:3, 3]) @ eyes[:3, :3]).T
            ahead = z > view["near"]
            u, v = (np.where(ahead, c / np.where(ahead, z, 1), 1e6) for c in (x, y))
            u, v = np.rint(u * view["fx"] + view["cx"]).astype(int), np.rint(v * view["fy"] + view["cy"]).astype(int)
            inside = ahead & (u >= 0) & (v >= 0) & (u < view["width"]) & (v < view["height"])
            inside &= z < (view["far"] or np.inf)
            nearest = np.full(len(z), -np.inf)
            nearest[inside] = image[v[inside], u[inside]]
            expected = inside & (z <= nearest * 1.02 + 0.01) & ~own
            agree.append(np.mean(expected == (seen[rows, columns] >> bit & 1)))
    assert min(agree) > 0.95 and np.mean(agree) > 0.98, agree
    assert both and seen_by_none


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed must be a whole number from 0 up, got -1"),
        ({"seed": 0.5}, "seed must be a whole number"),
        ({"per_shard": 0}, "per_shard must be"),
        ({"rooms": ("garage",)}, "rooms must be"),
        ({"rooms": ()}, "rooms must be one or more of"),
        ({"questions": ("why",)}, "questions must be"),
        ({"questions": ()}, "questions must be one or more of"),
        ({"outputs": ("normals",)}, "outputs must be"),
        ({"views": "both"}, "views must be"),
        ({"stage": StageOptions}, "stage must be StageOptions"),
        ({"clutter": 0.5}, "clutter must be a list, got 0.5"),
        ({"clutter": (0.7, 0.2)}, "clutter must be two numbers from 0 to 1 in ascending order, got (0.7, 0.2)"),
        ({"clutter": (0.2, float("nan"))}, "clutter must be two numbers"),
    ],
)
def test_wrong_options_are_one_sentence(options, message):
    with pytest.raises(SceneError, match=rf"^{re.escape(message)}"):
        SituationOptions(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"people": 9}, "people must be from 0 to 4, got 9"),
        ({"people": 1.5}, "people must be a whole number"),
        ({"people": 0, "robot": False}, "a stage must have at least one person or the robot"),
        ({"picture": 3}, "picture must be a Camera, got int"),
    ],
)
def test_wrong_stages_are_one_sentence(options, message):
    with pytest.raises(SceneError, match=rf"^{re.escape(message)}"):
        StageOptions(**options)


def test_wrong_calls_are_one_sentence():
    with pytest.raises(SceneError, match=r"^options must be SituationOptions, got dict"):
        SituationGenerator({})
    with pytest.raises(SceneError, match=r"^number must be a whole number from 0 up, got -1"):
        SituationGenerator(OPTIONS).shard(-1)
    with pytest.raises(SceneError, match=r"^situation must be of a generator with the same options"):
        SituationGenerator(SituationOptions(seed=5)).scene(situations()[0])


@pytest.mark.slow
def test_questions_that_no_room_has_are_refused():
    few = SituationOptions(seed=1, per_shard=30, questions=("belief",), outputs=(), stage=StageOptions(people=0))
    with pytest.raises(SceneError, match=r"^questions must occur in at least one room of a shard, got belief, which"):
        SituationGenerator(few).shard(0)

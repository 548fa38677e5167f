# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of the people of `situations`: ``name: (function, arguments)``."""

import warpvis as wv

from support.figures import mixamo_arrays, write_glb


def people_cases(folder):
    """Return the cases; they write to `folder`."""
    made = wv.situations
    person, names = made.Person(posture=made.sitting()), iter(range(10**9))
    colors = dict.fromkeys(("skin", "hair", "shirt", "trousers", "shoes"), (0.5, 0.5, 0.5))
    point = {"point": (0.4, -0.2, 1.2), "base": made.standing()}

    def add(**given):
        scene = given.pop("scene", None)
        name = given.pop("name", None)
        name = f"anna_{next(names)}" if isinstance(name, str) and name == "anna" else name
        return person.add_to(wv.Scene() if isinstance(scene, wv.Scene) else scene, name, **given)

    own = mixamo_arrays()
    figure = made.Figure(**own)
    write_glb(folder / "own.glb", own)
    own |= {"segments": {}, "height": 1.7, "appearance": None}
    group = {"people": [made.Person(), made.Person(height=1.8)]}
    shown = wv.Scene()
    person.add_to(shown, "anna", body="mesh")
    return {
        "Figure": (made.Figure, own),
        "at_table": (
            made.at_table,
            {**group, "size": (2, 1), "height": 0.7, "seat_height": 0.4, "center": (1, 2), "heading": 1.0},
        ),
        "in_circle": (made.in_circle, {**group, "center": (1, 2), "radius": 1.0, "start": 1.0}),
        "in_queue": (made.in_queue, {**group, "first": (1, 2), "heading": 1.0, "spacing": 1.0}),
        "read_figure": (wv.io.read_figure, {"path": folder / "own.glb", "segments": {}, "height": 1.7}),
        "Person.object_names": (person.object_names, {"name": "anna", "body": "mesh"}),
        "Person.object_poses": (person.object_poses, {"body": "mesh"}),
        "Person.update": (person.update, {"scene": shown, "name": "anna"}),
        "Person of a figure": (made.Person, {"figure": figure}),
        "Body": (made.Body, {"height": 1.7, "sex": "male", "build": 1.1}),
        "Body.measurement": (person.body.measurement, {"name": "head_length"}),
        "Body.radius": (person.body.radius, {"name": "neck"}),
        "Colors": (made.Colors, colors),
        "Person": (
            made.Person,
            {
                "height": 1.7,
                "sex": "male",
                "build": 1.1,
                "posture": made.standing(),
                "pose": (0, 0, 1),
                "floor": 0.5,
                "colors": made.Colors(),
                "up": "y",
            },
        ),
        "Person.add_to": (add, {"scene": wv.Scene(), "name": "anna", "body": "solids", "movable": True}),
        "Person.agent": (person.agent, {"name": "anna", "body": "solids", "resolution": 20.0}),
        "Person.at": (person.at, {"x": 1.0, "y": 2.0, "heading": 0.5}),
        "Person.doing": (person.doing, {"posture": made.standing()}),
        "Person.hand_positions": (person.hand_positions, {"hand": "left"}),
        "crouching": (made.crouching, {"depth": 0.5}),
        "looking_at": (made.looking_at, point),
        "pointing": (made.pointing, {**point, "hand": "left"}),
        "pointing along a direction": (made.pointing, {"direction": (1, 0, 0), "base": None, "hand": "left"}),
        "posed": (made.posed, {"angles": {"elbow_flexion_left": 1.0}, "base": made.standing()}),
        "reaching": (made.reaching, {**point, "hand": "nearest"}),
        "sitting": (made.sitting, {"seat_height": 0.4, "recline": 0.1, "table_height": 0.7}),
        "stature": (made.stature, {"percentile": 50, "sex": "male"}),
        "walking": (made.walking, {"phase": 0.5}),
    }

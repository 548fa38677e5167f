# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render a generated room of each kind in color, from above, without its ceiling and the two nearest walls.

Writes rooms.png, or the file that is given.
"""

import sys

import numpy as np
from PIL import Image  # noqa: TID253

import warpvis as wv
from warpvis.situations import ROOM_KINDS, Room, generate_room

SEEDS = {"living room": 8, "office": 1, "kitchen": 10, "workshop": 2, "bedroom": 4, "lab": 3}
WIDTH, HEIGHT = 400, 310


def view(room: Room) -> np.ndarray:
    """Return a picture of a room, seen from the side of positive x and negative y."""
    scene = room.build(ceiling=False)
    low, high = np.array(room.outline.bounds[:2]), np.array(room.outline.bounds[2:])
    hidden = []
    for number, wall in enumerate(room.outline.walls):
        if (wall.dx > 0 and wall.y < high[1] - 0.1) or (wall.dy > 0 and wall.x > low[0] + 0.1):
            hidden += [f"wall_{number + 1}"]
            hidden += [item.name for item in room.items if item.support == f"wall_{number + 1}"]
            hidden += [opening.name for opening in room.outline.openings if opening.wall == number]
    extent = float(np.linalg.norm(high - low))
    eye = extent * np.array([0.62, -0.95, 0.95])
    camera = wv.Camera.from_fov(WIDTH, HEIGHT, hfov=0.72)
    pose = wv.look_at(eye, (0.0, 0.0, 0.35))
    renderer = wv.Renderer(scene, camera, outputs=("color",), samples=4)
    color = renderer.render(pose, exclude=hidden).color.numpy()[0, ..., :3]
    return color


def main() -> None:
    """Render the rooms, and write one picture."""
    tiles = [view(generate_room(SEEDS[kind], kind, clutter=0.7)) for kind in ROOM_KINDS]
    rows = [np.concatenate(tiles[start : start + 3], axis=1) for start in (0, 3)]
    out = sys.argv[1] if len(sys.argv) > 1 else "rooms.png"
    picture = Image.fromarray(np.concatenate(rows)).quantize(256, kmeans=3, dither=Image.Dither.NONE)
    picture.save(out, optimize=True)
    print(f"{len(tiles)} rooms in {out}")


if __name__ == "__main__":
    main()

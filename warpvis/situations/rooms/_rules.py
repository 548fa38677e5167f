# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rules that furnish a room of each kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from warpvis.situations.rooms._plan import Placed, Plan

Size = tuple[float, float]


def _chairs_around(
    plan: Plan, table: Placed, category: str, *, per_side: int, ends: bool = False, color: str | None = None
) -> None:
    """Place chairs at the long sides of a table, and at its ends, partly below its top."""
    width, length = table.shape.size[0], table.shape.size[1]
    shape, word = plan.shape(category), color or plan.color(category)
    pitch = (length - 0.7) / max(per_side - 1, 1)  # chairs are between the legs
    places = [(side, (number - (per_side - 1) / 2) * pitch) for side in (-1, 1) for number in range(per_side)]
    for side, along in plan.draws.shuffled(places):
        if plan.draws.chance(0.12):
            continue
        out = width / 2 + shape.size[0] / 2 - plan.draws.uniform(0.02, 0.16)
        at = table.point(side * out, along)
        plan.put(shape, at, table.yaw + (180 if side > 0 else 0), color=word, group=(table,))
    for side in (-1, 1) if ends else ():
        out = length / 2 + shape.size[0] / 2 - plan.draws.uniform(0.0, 0.1)
        plan.put(shape, table.point(0.0, side * out), table.yaw - side * 90, color=word, group=(table,))


def _round_chairs(plan: Plan, table: Placed, category: str, count: int) -> None:
    """Place chairs around a round table."""
    shape, word = plan.shape(category), plan.color(category)
    radius, start = table.shape.size[0] / 2, 360 * plan.draws.unit()
    for number in range(count):
        angle = start + 360 * number / count
        turned = Placed(table.shape, table.color, table.x, table.y, table.z, angle, None)
        at = turned.point(radius + shape.size[0] / 2 - plan.draws.uniform(0.0, 0.1), 0.0)
        plan.put(shape, at, angle + 180, color=word, group=(table,))


def _free_table(plan: Plan, *, rug: bool = False) -> Placed | None:
    """Place a dining table in the room, with chairs, maybe on a rug."""
    draws = plan.draws
    for attempt in range(8):
        is_round = draws.chance(0.3 if attempt < 4 else 0.6)
        shape = plan.shape("round table" if is_round else "table")
        yaw = 90.0 * draws.below(4)
        room = shape.size[0] + 1.3, shape.size[1] + (1.3 if is_round else 0.3)
        at = plan.clear_spot(room, yaw)
        if at is None:
            table = plan.on_floor(shape, tries=6, yaw=yaw) if attempt == 7 else None
        else:
            if rug and draws.chance(0.4):
                carpet = plan.shape("rug", length=round(shape.size[1] + 1.4, 1), width=round(shape.size[0] + 1.4, 1))
                plan.put(carpet, at, yaw)
            table = plan.put(shape, at, yaw)
        if table is None:
            continue
        if is_round:
            _round_chairs(plan, table, "chair", 3 if shape.size[0] < 1 else 4)
        else:
            per_side = 1 if shape.size[1] < 1 else 2 if shape.size[1] < 1.7 else 3
            _chairs_around(plan, table, "chair", per_side=per_side, ends=draws.chance(0.5))
        return table
    return None


def _wall_things(
    plan: Plan, pictures: tuple[int, int], *, clock: float, others: tuple[tuple[str, float], ...] = ()
) -> None:
    """Hang pictures, a clock and other things at eye height, curtains beside windows and radiators below them."""
    draws = plan.draws
    for opening in [o for o in plan.outline.openings if o.kind == "window"]:
        wall = plan.outline.walls[opening.wall]
        if draws.chance(0.6):
            shape = plan.shape("curtain", height=round(opening.high + 0.1 - 0.15, 2))
            word = plan.color("curtain")
            for along in (opening.start - 0.17, opening.start + opening.width + 0.17):
                at = wall.point(round(along, 3), 0.0)
                plan.put(shape, at, wall.yaw, z=0.15, support=f"wall_{opening.wall + 1}", color=word)
        if draws.chance(0.5):
            shape = plan.shape("radiator")
            at = wall.point(round(opening.start + opening.width / 2, 3), 0.0)
            plan.put(shape, at, wall.yaw, z=0.12, support=f"wall_{opening.wall + 1}")
    for category, probability in others:
        if draws.chance(probability):
            shape = plan.shape(category)
            low = {"mirror": 0.5, "whiteboard": 0.95, "basketball hoop": 1.8}.get(category, 1.45)
            plan.on_wall(shape, low)
    for _ in range(draws.integer(*pictures)):
        shape = plan.shape("picture")
        plan.on_wall(shape, round(1.6 - shape.size[2] / 2, 2))
    if draws.chance(clock):
        plan.on_wall(plan.shape("clock"), 1.8)


def _corner_things(plan: Plan, choices: tuple[tuple[str, float], ...], count: int) -> None:
    """Place free-standing things in corners and along walls."""
    for _ in range(count):
        plan.against_wall(plan.shape(plan.draws.weighted(choices)), gap=0.05, in_corner=True, tries=8)


def living_room(plan: Plan) -> None:
    """Place a sofa that faces a television over a coffee table on a rug, armchairs, bookcases and a dining table."""
    draws = plan.draws
    fabric = plan.color("sofa")
    for _ in range(5):
        sofa = plan.against_wall(plan.shape("sofa"), color=fabric, access=1.0)
        if sofa is None:
            continue
        if draws.chance(0.75):
            rug = plan.shape("rug", length=draws.step(2.0, 2.6, 0.2), width=draws.step(1.2, 1.6, 0.2))
            plan.in_front(rug, sofa, draws.uniform(0.08, 0.2), turn=0.0)
        table = plan.in_front(plan.shape("coffee table"), sofa, draws.uniform(0.42, 0.55), turn=0.0)
        low = plan.shape("cabinet", width=draws.choice((1.2, 1.6)), height=0.5)
        depth = draws.uniform(2.0, 2.8)
        stand = plan.against_wall(low, walls=_opposite(plan, sofa), access=0.3) or plan.in_front(
            low, sofa, depth, access=0.0
        )
        if stand is not None:
            _top(plan, stand, "television", turn=0.0)
        for side in draws.shuffled((-1, 1)):
            if table is not None and draws.chance(0.6):
                shape = plan.shape("armchair")
                out = table.shape.size[1] / 2 + 0.45 + shape.size[0] / 2
                angle = table.yaw - side * draws.choice((90, 75, 60))
                plan.put(shape, table.point(draws.uniform(-0.1, 0.5), side * out), angle, group=(sofa,))
        for side in (-1, 1):
            if draws.chance(0.55):
                plan.beside(
                    plan.shape(draws.weighted((("floor lamp", 2), ("side table", 3), ("plant", 1)))), sofa, side
                )
        break
    for _ in range(draws.integer(1, 2)):
        plan.against_wall(plan.shape("bookcase"))
    if plan.outline.area > 17:
        _free_table(plan, rug=True)
    for category, probability in (
        ("cabinet", 0.6),
        ("dresser", 0.3),
        ("coat rack", 0.2),
        ("pillar", 0.12),
        ("desk", 0.15),
    ):
        if draws.chance(probability):
            _any(plan, category)
    _corner_things(plan, (("plant", 3), ("floor lamp", 1), ("basket", 1)), draws.integer(1, 2))
    if draws.chance(0.12):
        plan.on_floor(plan.shape("screen"), quarter=True)
    _wall_things(plan, (1, 4), clock=0.3, others=(("wall shelf", 0.4), ("mirror", 0.2)))


def bedroom(plan: Plan) -> None:
    """Place a bed with nightstands, a wardrobe, a dresser and a desk."""
    draws = plan.draws
    wood = plan.color("wardrobe")
    for _ in range(5):
        bed = plan.against_wall(plan.shape("bed"), gap=0.05, access=0.5)
        if bed is None:
            continue
        stand = plan.shape("nightstand")
        for side in (-1, 1):
            near = plan.beside(stand, bed, side, color=wood) if draws.chance(0.85) else None
            if near is not None and draws.chance(0.6):
                _top(plan, near, "lamp", forward=-0.05)
        break
    plan.against_wall(plan.shape("wardrobe"), color=wood, in_corner=draws.chance(0.6))
    if draws.chance(0.75):
        plan.against_wall(plan.shape("dresser"), color=wood)
    if draws.chance(0.6):
        _desk_against_wall(plan, "chair")
    if draws.chance(0.5):
        plan.against_wall(plan.shape("bookcase"))
    if draws.chance(0.35):
        plan.on_floor(plan.shape("rug", length=1.6, width=1.0), quarter=True)
    if draws.chance(0.4):
        plan.against_wall(plan.shape("armchair"), in_corner=True, gap=0.1)
    for category, probability in (("bench", 0.25), ("screen", 0.2), ("coat rack", 0.2)):
        if draws.chance(probability):
            _any(plan, category)
    _corner_things(plan, (("plant", 2), ("floor lamp", 1), ("basket", 2), ("suitcase", 1)), draws.integer(1, 2))
    _wall_things(plan, (1, 3), clock=0.25, others=(("mirror", 0.5), ("wall shelf", 0.4)))


def kitchen(plan: Plan) -> None:
    """Place a row of counters with sink and stove, a fridge at its end, wall units, and a table or an island."""
    draws = plan.draws
    front = plan.color("counter")
    _kitchen_row(plan, front)
    if plan.outline.area > 15 and draws.chance(0.5):
        island = plan.on_floor(plan.shape("kitchen island"), color=front, quarter=True)
        if island is not None:
            stool, word = plan.shape("stool", height=0.65), plan.color("stool")
            for number in (-1, 0, 1):
                plan.put(
                    stool,
                    island.point(island.shape.bounds[0][0] - 0.12, number * 0.5),
                    island.yaw,
                    color=word,
                    group=(island,),
                )
    _free_table(plan, rug=False)
    for category, probability in (("cabinet", 0.5), ("shelf", 0.35), ("pillar", 0.08), ("step ladder", 0.1)):
        if draws.chance(probability):
            _any(plan, category)
    _corner_things(plan, (("trash bin", 3), ("plant", 1), ("basket", 1), ("bucket", 1)), draws.integer(1, 3))
    _wall_things(plan, (0, 2), clock=0.6, others=(("wall shelf", 0.5),))


def _kitchen_row(plan: Plan, front: str) -> None:
    """Place kitchen units side by side along a wall."""
    draws = plan.draws
    # Longest runs first: the row has at least a sink, a stove and a counter.
    for wanted in (4.2, 3.4, 2.8, 2.2, 2.0, 0.0):
        units = [plan.shape("sink"), plan.shape("counter", width=draws.choice((0.6, 0.8))), plan.shape("stove")]
        if wanted > 2.5:
            units.insert(0, plan.shape("counter", width=0.6))
        if wanted > 3.5:
            units.append(plan.shape("counter", width=draws.choice((0.6, 0.8))))
        has_fridge = wanted > 2.1
        if has_fridge:
            units.insert(0 if draws.chance(0.5) else len(units), plan.shape("fridge"))
        if draws.chance(0.5):
            units.reverse()
        length = sum(unit.size[1] for unit in units)
        for _ in range(8):
            index = draws.weighted([(i, wall.length) for i, wall in enumerate(plan.outline.walls)])
            wall = plan.outline.walls[index]
            if wall.length < length + 0.05:
                continue
            along = 0.02 + draws.choice((0.0, 1.0, draws.unit())) * (wall.length - length - 0.04)
            placed: list[Placed] = []
            kept = (len(plan.items), len(plan.zones), plan.grid)
            for unit in units:
                low = unit.bounds[0]
                at = wall.point(round(along + unit.size[1] / 2, 3), round(0.02 - low[0], 4))
                color = None if unit.category in ("stove", "fridge") else front
                item = plan.put(unit, at, wall.yaw, color=color, gap=0.0, group=placed)
                if item is None:
                    break
                placed.append(item)
                along += unit.size[1] + 0.002
            if len(placed) == len(units):
                for item in placed:
                    if item.shape.category in ("counter", "sink") and draws.chance(0.6):
                        width = item.shape.size[1]
                        if width >= 0.6:
                            plan.on_wall(
                                plan.shape("wall cabinet", width=0.6 if width < 0.8 else 0.8),
                                1.45,
                                color=front,
                                tries=1,
                                above=item,
                            )
                if not has_fridge:
                    plan.against_wall(plan.shape("fridge"), in_corner=True)
                return
            del plan.items[kept[0] :], plan.zones[kept[1] :]
            plan.grid = kept[2]


def office(plan: Plan) -> None:
    """Place desks with chairs, screens and keyboards in rows or along walls, and cabinets."""
    draws = plan.draws
    if plan.outline.area > 16 and draws.chance(0.6):
        _desk_rows(plan)
    else:
        for _ in range(draws.integer(1, 3)):
            _desk_against_wall(plan, "office chair")
    if not any(item.shape.category == "desk" for item in plan.items):
        _desk_against_wall(plan, "office chair", width=1.2, depth=0.7)
    if plan.outline.area > 20 and draws.chance(0.5):
        yaw = 90.0 * draws.below(4)
        at = plan.clear_spot((2.2, 2.4), yaw)
        table = None if at is None else plan.put(plan.shape("table", length=1.8, width=0.9), at, yaw)
        if table is not None:
            _chairs_around(
                plan, table, "office chair" if draws.chance(0.4) else "chair", per_side=2, ends=draws.chance(0.4)
            )
    for category, count in (("filing cabinet", (0, 2)), ("bookcase", (0, 2)), ("cabinet", (0, 1)), ("shelf", (0, 1))):
        for _ in range(draws.integer(*count)):
            plan.against_wall(plan.shape(category), in_corner=draws.chance(0.4))
    for category, probability in (("screen", 0.45), ("coat rack", 0.35), ("pillar", 0.2), ("armchair", 0.15)):
        if draws.chance(probability):
            _any(plan, category)
    _corner_things(plan, (("plant", 3), ("trash bin", 3), ("box", 1)), draws.integer(1, 3))
    _wall_things(plan, (0, 2), clock=0.5, others=(("whiteboard", 0.75), ("wall shelf", 0.25)))


def _desk_rows(plan: Plan) -> None:
    """Place pairs of desks in rows that face the same direction, with chairs in front of them."""
    draws = plan.draws
    shape, wood, word = plan.shape("desk"), plan.color("desk"), plan.color("office chair")
    yaw = 90.0 * draws.below(4)
    x0, y0, x1, y1 = plan.outline.bounds
    along_x = yaw in (0.0, 180.0)
    depth, width = (x1 - x0, y1 - y0) if along_x else (y1 - y0, x1 - x0)
    pitch, gap = shape.size[0] + 1.15, draws.choice((0.02, 0.02, 0.9))
    start = draws.uniform(0.5, 0.8) + shape.size[0] / 2
    rows, each = int((depth - start - 1.2) / pitch) + 1, int((width - 1.4) / (shape.size[1] + gap))
    for row in range(min(rows, 4)):
        for column in range(min(each, 4)):
            u = start + row * pitch
            v = 0.7 + shape.size[1] / 2 + column * (shape.size[1] + gap)
            forward = u - depth / 2 if yaw in (0.0, 90.0) else depth / 2 - u
            at = (forward, v - width / 2) if along_x else (v - width / 2, forward)
            desk = plan.put(shape, (round(at[0], 3), round(at[1], 3)), yaw, color=wood, access=0.75)
            if desk is not None:
                _equip_desk(plan, desk, "office chair", word)


def _desk_against_wall(plan: Plan, chair: str, **parameters: Any) -> None:
    """Place a desk with its back to a wall, maybe below a window."""
    desk = plan.against_wall(
        plan.shape("desk", **parameters),
        below_window=plan.draws.chance(0.4),
        access=0.75,
        tries=30 if parameters else 14,
    )
    if desk is not None:
        _equip_desk(plan, desk, chair, plan.color(chair))


def _equip_desk(plan: Plan, desk: Placed, chair: str, color: str) -> None:
    """Place a chair at a desk, and a computer on it."""
    draws = plan.draws
    right = -0.15 if desk.shape.parameters.get("drawers", True) else 0.0
    shape = plan.shape(chair)
    plan.put(
        shape,
        desk.point(
            desk.shape.size[0] / 2 + shape.size[0] / 2 + draws.uniform(-0.12, 0.15), right + draws.uniform(-0.05, 0.05)
        ),
        desk.yaw + 180 + draws.choice((0, 0, draws.uniform(-40, 40))),
        color=color,
        group=(desk,),
    )
    if draws.chance(0.7):
        _top(plan, desk, "monitor", forward=-0.17, left=right)
        _top(plan, desk, "keyboard", forward=0.14, left=right)
        _top(plan, desk, "mouse", forward=0.14, left=right + (0.32 if draws.chance(0.12) else -0.32), turn=180.0)
    elif draws.chance(0.8):
        _top(plan, desk, "laptop", forward=0.1, left=right)
    if draws.chance(0.35):
        _top(plan, desk, "lamp", forward=-0.2, left=desk.shape.size[1] / 2 - 0.2)


def _top(
    plan: Plan, item: Placed, category: str, *, forward: float = 0.0, left: float = 0.0, turn: float = 0.0
) -> None:
    """Place an object on the top of an item, in the item's frame."""
    top = next((support for support in item.shape.supports if support.name == "top"), None)
    if top is not None:
        shape = plan.shape(category)
        if shape.size[0] <= 2 * top.half[0] + 0.02 and shape.size[1] <= 2 * top.half[1] + 0.02:
            placed = plan.put(
                shape, item.point(forward, left), item.yaw + turn, z=round(item.z + top.z, 6), support=item, gap=0.0
            )
            if placed is not None:
                placed.level = top.name


def _opposite(plan: Plan, item: Placed) -> list[int]:
    """Return the walls that an item faces."""
    return [i for i, wall in enumerate(plan.outline.walls) if wall.yaw == (item.yaw + 180) % 360]


def _any(plan: Plan, category: str) -> None:
    """Place furniture where its category belongs: pillars and screens are free-standing, others at walls."""
    if category == "pillar":
        width = plan.draws.choice((0.3, 0.4))
        plan.on_floor(plan.shape(category, width=width, height=plan.outline.height), yaw=0.0, tries=6)
    elif category == "screen":
        plan.on_floor(plan.shape(category), quarter=True, tries=8)
    elif category == "desk":
        _desk_against_wall(plan, "chair")
    else:
        plan.against_wall(plan.shape(category), in_corner=plan.draws.chance(0.4))


def workshop(plan: Plan) -> None:
    """Place workbenches with stools, racks, tool cabinets and crates."""
    draws = plan.draws
    for _ in range(draws.integer(1, 3)):
        bench = plan.against_wall(plan.shape("workbench"), below_window=False)
        if bench is not None and draws.chance(0.7):
            plan.in_front(
                plan.shape("stool", height=0.65), bench, draws.uniform(0.05, 0.2), aside=draws.uniform(-0.4, 0.4)
            )
    for category, count in (
        ("shelf", (1, 3)),
        ("tool cabinet", (1, 2)),
        ("cabinet", (0, 1)),
        ("filing cabinet", (0, 1)),
    ):
        for _ in range(draws.integer(*count)):
            plan.against_wall(plan.shape(category), in_corner=draws.chance(0.4))
    if plan.outline.area > 14:
        table = plan.on_floor(plan.shape("table", length=1.8, width=0.9), quarter=True)
        if table is not None and draws.chance(0.5):
            plan.beside(plan.shape("stool"), table, draws.choice((-1, 1)), gap=0.1, align_back=False)
    for category, probability in (("pillar", 0.35), ("screen", 0.15), ("step ladder", 0.6), ("desk", 0.2)):
        if draws.chance(probability):
            _any(plan, category)
    _corner_things(plan, (("crate", 3), ("bucket", 2), ("box", 3), ("trash bin", 2)), draws.integer(2, 4))
    _wall_things(plan, (0, 1), clock=0.5, others=(("wall shelf", 0.6), ("whiteboard", 0.3)))


def lab(plan: Plan) -> None:
    """Place laboratory benches along walls and in rows, with stools, cabinets and a whiteboard."""
    draws = plan.draws
    body = plan.color("lab bench")
    word = plan.color("stool")
    benches = [plan.against_wall(plan.shape("lab bench"), color=body) for _ in range(draws.integer(2, 4))]
    if plan.outline.area > 18:
        shape, yaw = plan.shape("lab bench", width=draws.choice((1.8, 2.4))), 90.0 * draws.below(4)
        for _ in range(6):
            first = plan.on_floor(shape, tries=2, color=body, yaw=yaw)
            if first is not None:
                # Back to back.
                behind = first.point(2 * shape.bounds[0][0] - 0.02, 0.0)
                benches += [first, plan.put(shape, behind, yaw + 180, color=body)]
                break
    stool = plan.shape("stool", height=0.65)
    for bench in benches:
        if bench is not None and draws.chance(0.75):
            plan.in_front(stool, bench, draws.uniform(0.03, 0.15), aside=draws.uniform(-0.5, 0.5), color=word)
    if draws.chance(0.6):
        _desk_against_wall(plan, "office chair")
    for category, count in (("cabinet", (0, 2)), ("shelf", (0, 1)), ("filing cabinet", (0, 1)), ("fridge", (0, 1))):
        for _ in range(draws.integer(*count)):
            plan.against_wall(plan.shape(category), in_corner=draws.chance(0.4))
    for category, probability in (("pillar", 0.2), ("screen", 0.2), ("coat rack", 0.3)):
        if draws.chance(probability):
            _any(plan, category)
    _corner_things(plan, (("trash bin", 3), ("plant", 1), ("box", 1)), draws.integer(1, 2))
    _wall_things(plan, (0, 1), clock=0.7, others=(("whiteboard", 0.8), ("wall shelf", 0.3)))


RULES: dict[str, tuple[Callable[[Plan], None], tuple[Size, Size], tuple[int, int]]] = {
    "living room": (living_room, ((4.0, 6.6), (3.6, 5.6)), (1, 3)),
    "office": (office, ((3.6, 7.6), (3.4, 6.0)), (1, 3)),
    "kitchen": (kitchen, ((3.4, 5.6), (3.2, 4.8)), (1, 2)),
    "workshop": (workshop, ((4.2, 7.6), (3.8, 6.2)), (0, 2)),
    "bedroom": (bedroom, ((3.4, 5.2), (3.2, 4.8)), (1, 2)),
    "lab": (lab, ((4.4, 7.8), (4.0, 6.2)), (1, 3)),
}
"""By kind: the function that furnishes a room, ranges of its two sizes [m], and of the number of windows."""

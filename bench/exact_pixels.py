# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare random images of random and adversarial scenes, pixel by pixel, with all triangles in double precision.

    python bench/exact_pixels.py [--device cuda:0] [--caster packets] [--pixels 1e10] [--limit 120] [--seed 0]

Every pixel is compared with the nearest hit among all triangles, without an acceleration structure or a tolerance. A
depth is right within 1e-5 m, or within a relative error of 1e-5 from 1 m on. Each other pixel is examined again: the
distance in pixels from the ray to an edge that could explain it, and the angle at which the ray meets the true surface
and the rendered one. A ray within 1e-9 px of an edge may hit either side. Exits with 1 if any other pixel is wrong.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
import warp as wp
from exact_scenes import FAMILIES, Case
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

wp.set_module_options({"enable_backward": False})

EDGE = 1e-9
"""Distance to an edge [px] within which a ray may hit either side of it."""
BANDS = (EDGE, 1e-6, 1e-5, 1e-4, 1e-3)
TOLERANCE = 1e-5
MAX_WRONG = 1 << 16
MAX_VIEWS = 1 << 12
_SHOWN = 5


@wp.struct
class Prepared:
    """Triangles in views, ``[view, triangle]``."""

    edges: wp.array3d[wp.vec3d]  # edge functions, linear in u, v and 1: not negative inside
    error_bound: wp.array2d[wp.vec3d]  # rounding error bound of each edge function
    plane: wp.array2d[wp.vec3d]  # 1 / z, linear in u, v and 1
    box: wp.array2d[wp.vec4i]  # x0, y0, x1, y1 in pixels, inclusive


@wp.func
def largest(v: wp.vec3d) -> wp.float64:
    return wp.abs(v[0]) + wp.abs(v[1]) + wp.abs(v[2])


@wp.func
def nearer(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    """Return the nearer end of an edge, from which its plane is found: a far end has a larger rounding error."""
    return wp.where(largest(a) < largest(b), a, b)


@wp.kernel
def prepare_triangles(
    # In:
    corners_in: wp.array2d[wp.vec3d],
    cameras_in: wp.array2d[wp.vec3d],
    lens: wp.array[wp.float64],
    width: int,
    height: int,
    # Out:
    prepared_out: Prepared,
):
    """Set up triangles for a camera's position and axes, three rows, and a lens ``fx fy cx cy``."""
    view, triangle = wp.tid()
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    a, b, c = wp.vec3d(), wp.vec3d(), wp.vec3d()
    for k in range(3):
        seen = corners_in[triangle, k] - cameras_in[view, 0]
        x = fx * wp.dot(cameras_in[view, 1], seen)
        y = fy * wp.dot(cameras_in[view, 2], seen)
        place = wp.vec3d(x, y, wp.dot(cameras_in[view, 3], seen))
        if k == 0:
            a = place
        elif k == 1:
            b = place
        else:
            c = place
    normal = wp.cross(b - a, c - a)
    volume = wp.dot(normal, a)
    ray = wp.vec3d(wp.max(cx, wp.float64(width)), wp.max(cy, wp.float64(height)), wp.float64(1.0))
    epsilon = wp.float64(1.0e-15)
    edge_on = wp.abs(volume) <= epsilon * largest(b - a) * largest(c - a) * largest(a)
    sign = wp.where(volume < wp.float64(0.0), wp.float64(-1.0), wp.float64(1.0))
    near_a, near_b, near_c = nearer(b, c), nearer(c, a), nearer(a, b)  # of the edge opposite each corner
    prepared_out.edges[view, triangle, 0] = sign * wp.cross(b - c, near_a)
    prepared_out.edges[view, triangle, 1] = sign * wp.cross(c - a, near_b)
    prepared_out.edges[view, triangle, 2] = sign * wp.cross(a - b, near_c)
    prepared_out.error_bound[view, triangle] = (
        epsilon
        * largest(ray)
        * wp.vec3d(largest(b - c) * largest(near_a), largest(c - a) * largest(near_b), largest(a - b) * largest(near_c))
    )
    prepared_out.plane[view, triangle] = normal / volume
    zmin, zmax = wp.min(a[2], wp.min(b[2], c[2])), wp.max(a[2], wp.max(b[2], c[2]))
    box = wp.vec4i(0, 0, width - 1, height - 1)
    if edge_on or zmax <= wp.float64(0.0):
        box = wp.vec4i(0, 0, -1, -1)
    elif zmin > wp.float64(1.0e-6) * zmax:
        xs, ys = wp.vec3d(a[0] / a[2], b[0] / b[2], c[0] / c[2]), wp.vec3d(a[1] / a[2], b[1] / b[2], c[1] / c[2])
        slack, wide = wp.float64(1.0e-5), wp.float64(1.0e6)
        x0, x1 = wp.min(xs) + cx - wp.float64(0.5) - slack, wp.max(xs) + cx - wp.float64(0.5) + slack
        y0, y1 = wp.min(ys) + cy - wp.float64(0.5) - slack, wp.max(ys) + cy - wp.float64(0.5) + slack
        x0, x1 = wp.clamp(x0, -wide, wide), wp.clamp(x1, -wide, wide)
        y0, y1 = wp.clamp(y0, -wide, wide), wp.clamp(y1, -wide, wide)
        box = wp.vec4i(
            wp.max(int(wp.ceil(x0)), 0),
            wp.max(int(wp.ceil(y0)), 0),
            wp.min(int(wp.floor(x1)), width - 1),
            wp.min(int(wp.floor(y1)), height - 1),
        )
    prepared_out.box[view, triangle] = box


@wp.kernel
def compare_depth(
    # In:
    prepared_in: Prepared,
    lens: wp.array[wp.float64],
    depth_in: wp.array3d[float],
    # Out:
    count_out: wp.array[int],
    wrong_out: wp.array[wp.vec3i],
):
    """Record the pixels ``(view, y, x)`` that show anything but the nearest triangle."""
    view, y, x = wp.tid()
    u, v = wp.float64(x) + wp.float64(0.5) - lens[2], wp.float64(y) + wp.float64(0.5) - lens[3]
    ray = wp.vec3d(u, v, wp.float64(1.0))
    nearest = wp.float64(0.0)
    for triangle in range(prepared_in.box.shape[1]):
        box = prepared_in.box[view, triangle]
        if x >= box[0] and x <= box[2] and y >= box[1] and y <= box[3]:
            error_bound = prepared_in.error_bound[view, triangle]
            if (
                wp.dot(prepared_in.edges[view, triangle, 0], ray) >= -error_bound[0]
                and wp.dot(prepared_in.edges[view, triangle, 1], ray) >= -error_bound[1]
                and wp.dot(prepared_in.edges[view, triangle, 2], ray) >= -error_bound[2]
            ):
                nearest = wp.max(nearest, wp.dot(prepared_in.plane[view, triangle], ray))
    shown = wp.float64(depth_in[view, y, x])
    right = nearest <= wp.float64(0.0)
    if wp.isfinite(shown):
        z = wp.float64(1.0) / nearest
        right = wp.abs(shown - z) <= wp.float64(1.0e-5) * wp.max(wp.float64(1.0), z)
    if not right:
        place = wp.atomic_add(count_out, 0, 1)
        if place < wrong_out.shape[0]:
            wrong_out[place] = wp.vec3i(view, y, x)


@dataclass
class Wrong:
    """A pixel that does not show the nearest triangle."""

    where: str
    kind: str  # "hole", "no hole" or "depth"
    shown: float
    true_depth: float
    edge: float  # distance to the nearest edge that could explain it [px]
    angle: float  # between the ray and the true or the rendered surface, whichever is less [degrees]

    @property
    def band(self) -> str:
        """Return the distance to the edge, as the table shows it."""
        return next((f"within {band:.0e} px of an edge" for band in BANDS if self.edge <= band), "away from edges")


def look_again(case: Case, matrix: NDArray[np.float64], x: int, y: int, shown: float, location: str) -> Wrong:
    """Return the true hit of a ray, by NumPy, and its distance from another result."""
    camera = case.camera
    u, v = x + 0.5 - camera.cx, y + 0.5 - camera.cy
    local = (case.corners - matrix[:3, 3]) @ matrix[:3, :3]
    places = local * (camera.fx, camera.fy, 1.0)
    ray = np.array([u, v, 1.0])
    normal = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    volume = (normal * places[:, 0]).sum(-1)
    with np.errstate(all="ignore"):
        z = volume / (normal @ ray)
        values, lengths = [], []
        for i, j in ((1, 2), (2, 0), (0, 1)):
            from_i = np.abs(places[:, i]).sum(-1) < np.abs(places[:, j]).sum(-1)
            edge = np.cross(places[:, i] - places[:, j], np.where(from_i[:, None], places[:, i], places[:, j]))
            values.append(np.sign(volume) * (edge @ ray))
            lengths.append(np.hypot(edge[:, 0], edge[:, 1]))
        edge_distance = np.array(values) / np.array(lengths)  # pixels; negative outside
    inside = (edge_distance.min(0) >= -1e-12) & (volume != 0) & (z > 0)
    true_depth = z[inside].min() if inside.any() else np.inf
    # Triangles whose edges decide: those that the ray hits or passes, up to the farther of the two surfaces.
    reach = max(depth for depth in (shown, true_depth, 0.0) if np.isfinite(depth))
    reach = np.inf if not (np.isfinite(shown) and np.isfinite(true_depth)) else reach * (1 + 2 * TOLERANCE)
    deciding = np.isfinite(edge_distance).all(0) & (local[..., 2].max(-1) > 0) & (np.nan_to_num(z, nan=0.0) <= reach)
    # Distance to leave or enter a triangle: to its nearest edge from inside, to the farthest edge passed from outside.
    away = np.where(inside, edge_distance.min(0), np.maximum(-edge_distance, 0).max(0))
    metric = np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 0])
    direction = np.array([u / camera.fx, v / camera.fy, 1.0])
    with np.errstate(all="ignore"):
        sine = np.abs(metric @ direction) / (np.linalg.norm(metric, axis=1) * np.linalg.norm(direction))
    angles = np.degrees(np.arcsin(np.clip(sine, 0, 1)))
    near = inside & (np.abs(z - true_depth) <= 1e-9 * np.abs(true_depth)) if np.isfinite(true_depth) else inside
    if np.isfinite(shown):
        near = near | (deciding & (away < 1e-2) & (np.abs(z - shown) < 1e-3 * shown))
    angle = float(np.nanmin(angles[near])) if near.any() else 90.0
    kind = "hole" if not np.isfinite(shown) else "no hole" if not np.isfinite(true_depth) else "depth"
    return Wrong(location, kind, shown, float(true_depth), float(away[deciding].min(initial=np.inf)), angle)


class Check:
    """Runs cases, and collects what they find."""

    def __init__(self, device: str, caster: str, pixels: int) -> None:
        """Render images with this number of pixels at a time."""
        self.device, self.caster, self.batch = device, caster, pixels
        self.pixels: Counter[str] = Counter()
        self.wrong: dict[str, list[Wrong]] = {name: [] for name in FAMILIES}
        self.more: Counter[str] = Counter()

    def run(self, family: str, seed: int) -> None:
        """Compare one scene's images."""
        rng = np.random.default_rng((seed, list(FAMILIES).index(family)))
        width, height = (int(side) for side in rng.integers(24, 512 if self.batch > 1 << 22 else 96, 2))
        views = min(max(1, self.batch // (width * height)), MAX_VIEWS)
        case = FAMILIES[family](rng, width, height, views)
        outputs = ("depth",) if rng.random() < 0.5 else ("depth", "segmentation")
        renderer = wv.Renderer(case.scene(self.device), case.camera, outputs=outputs, caster=self.caster)
        on_cuda = renderer.scene.device.is_cuda
        poses = wp.array(case.poses, dtype=wp.transform, device=self.device) if on_cuda else case.poses
        taken = renderer._caster.parse_poses(poses, "opencv")  # normalized as the renderer does
        matrices = poses_to_matrices((taken.numpy() if isinstance(taken, wp.array) else taken).reshape(-1, 7))
        depth = renderer.render(poses, object_poses=case.object_poses, object_scales=case.object_scales).depth
        found = self._compare(case, matrices, depth)
        self.pixels[family] += depth.size
        self.more[family] += max(0, len(found) - MAX_WRONG)
        for view, y, x in found[:1000]:
            shown = float(depth[int(view)].numpy()[y, x])
            location = f"{family}, seed {seed}, view {view} of {width}x{height}, x {x}, y {y}"
            self.wrong[family].append(look_again(case, matrices[view], int(x), int(y), shown, location))
        self.more[family] += max(0, len(found) - 1000)

    def _compare(self, case: Case, matrices: NDArray[np.float64], depth: wp.array) -> NDArray[np.int32]:
        device, camera = self.device, case.camera
        rows = np.concatenate([matrices[:, None, :3, 3], matrices[:, :3, :3].transpose(0, 2, 1)], axis=1)
        size = len(case.poses), len(case.corners)
        prepared = Prepared()
        prepared.edges = wp.empty((*size, 3), dtype=wp.vec3d, device=device)
        prepared.error_bound = wp.empty(size, dtype=wp.vec3d, device=device)
        prepared.plane = wp.empty(size, dtype=wp.vec3d, device=device)
        prepared.box = wp.empty(size, dtype=wp.vec4i, device=device)
        lens = wp.array([camera.fx, camera.fy, camera.cx, camera.cy], dtype=wp.float64, device=device)
        corners, cameras = (wp.array(a, dtype=wp.vec3d, device=device) for a in (case.corners, rows))
        inputs = [corners, cameras, lens, camera.width, camera.height]
        wp.launch(prepare_triangles, size, inputs=inputs, outputs=[prepared], device=device)
        count = wp.zeros(1, dtype=int, device=device)
        wrong = wp.empty(MAX_WRONG, dtype=wp.vec3i, device=device)
        wp.launch(compare_depth, depth.shape, inputs=[prepared, lens, depth], outputs=[count, wrong], device=device)
        found = int(count.numpy()[0])
        order = wrong.numpy()[: min(found, MAX_WRONG)]
        return order[np.lexsort(order.T[::-1])]

    def report(self) -> bool:
        """Print the findings, and return whether all pixels are right."""
        right = True
        print(f"{'family':14s} {'pixels':>8s}  wrong, by what")
        for family in FAMILIES:
            kinds = Counter((wrong.band, wrong.kind) for wrong in self.wrong[family])
            text = ", ".join(f"{count} {kind} {band}" for (band, kind), count in sorted(kinds.items())) or "0"
            more = f", and {self.more[family]} more" if self.more[family] else ""
            print(f"{family:14s} {self.pixels[family]:8.1e}  {text}{more}")
            worst = sorted((w for w in self.wrong[family] if w.edge > EDGE), key=lambda w: -w.edge)
            for wrong in worst[:_SHOWN]:
                off = "" if wrong.kind != "depth" else f", {wrong.shown - wrong.true_depth:+.2e} m"
                print(
                    f"    {wrong.where}: {wrong.kind}, {wrong.shown:.7g} shown, {wrong.true_depth:.7g} there{off},",
                    end=" ",
                )
                print(f"edge {wrong.edge:.2e} px, {wrong.angle:.4f} degrees")
            right &= not worst and not self.more[family]
        total, off = sum(self.pixels.values()), [w for ws in self.wrong.values() for w in ws if w.edge > EDGE]
        bound = sum(wrong.edge > 1e-4 for wrong in off)
        print(f"{total:.2e} pixels: {len(off)} wrong, {bound} of them farther than 1e-4 px from an edge")
        return right


def main() -> int:
    """Compare until the number of pixels or the time limit is reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=str(wp.get_preferred_device()))
    parser.add_argument("--caster", default="packets", choices=("packets", "rays"))
    parser.add_argument("--pixels", type=float, default=1e10)
    parser.add_argument("--limit", type=float, default=120.0, help="seconds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES))
    arguments = parser.parse_args()
    begun = time.perf_counter()
    on_cuda = wp.get_device(arguments.device).is_cuda
    check = Check(arguments.device, arguments.caster, 1 << 25 if on_cuda else 1 << 16)
    seed = arguments.seed
    while sum(check.pixels.values()) < arguments.pixels and time.perf_counter() - begun < arguments.limit:
        for family in arguments.families:
            check.run(family, seed)
        seed += 1
    print(
        f"{arguments.caster} on {arguments.device}, seeds {arguments.seed} to {seed - 1}, "
        f"{time.perf_counter() - begun:.0f} s"
    )
    return 0 if check.report() else 1


if __name__ == "__main__":
    wp.config.quiet = True
    sys.exit(main())

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of situations: rendered ones, amodal masks of objects and people, and who else sees each pixel's surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, get_args

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.labels import Visibility
from warpvis.core.outputs import Output
from warpvis.rendering import Renderer
from warpvis.situations._observations import Viewer, Watch
from warpvis.situations._options import ImageName
from warpvis.visibility import object_visibility, point_visibility

Images = dict[tuple[str, str], Sequence[NDArray[Any]]]
"""An image for each of n moments, by view and output."""


def make_images(
    watch: Watch,
    viewers: Sequence[Viewer],
    views: Sequence[Viewer],
    object_poses: NDArray[np.float32],
    present: NDArray[np.bool_],
    outputs: Sequence[ImageName],
) -> Images:
    """Make the images of n moments.

    Args:
        watch: The scene, and the targets that have masks.
        viewers: The participants, each with n poses.
        views: The viewers whose views are rendered.
        object_poses: Poses of the movable objects, shape ``(n, M, 7)``.
        present: Targets that are in the room, which have a mask, shape ``(n, targets)``.
        outputs: Names of the images.
    """
    images: Images = {}
    read: tuple[Output, ...] = ("points", "segmentation") if "seen_by" in outputs else ()
    needed: list[Output] = [name for name in get_args(Output) if name in (*outputs, *read)]
    for view in views:
        hidden = [watch.scene.index(name) for name in view.body]
        eyes = view.eyes.astype(np.float32)
        if needed:
            renderer = Renderer(watch.scene, view.camera, outputs=needed, threads=watch.threads)
            found = renderer.render(eyes, object_poses=object_poses, exclude=hidden or None)
            arrays: dict[str, NDArray[Any]] = {name: getattr(found, name).numpy().copy() for name in needed}
            images |= {(view.name, name): list(arrays[name]) for name in needed if name in outputs}
        if "seen_by" in outputs:
            images[view.name, "seen_by"] = list(_seen_by(watch, viewers, arrays, object_poses))
        if "amodal_masks" in outputs:
            masks = _amodal_masks(watch, view, eyes, object_poses, hidden)
            images[view.name, "amodal_masks"] = [of_all[kept] for of_all, kept in zip(masks, present, strict=True)]
    return images


def _amodal_masks(
    watch: Watch, view: Viewer, eyes: NDArray[np.float32], object_poses: NDArray[np.float32], hidden: list[int]
) -> Iterator[NDArray[np.uint8]]:
    """Yield 2 where a target is visible, 1 elsewhere in its silhouette, else 0, shape ``(targets, H, W)``."""
    members = [name for names in watch.targets.values() for name in names]
    first = np.cumsum([0, *map(len, watch.targets.values())])[:-1]
    options: dict[str, Any] = {"objects": members, "canvas": (0, 0, 0, 0), "masks": True, "exclude": hidden or None}
    options["threads"] = watch.threads
    for pose, moved in zip(eyes, object_poses, strict=True):  # masks of parts of bodies are large
        found = object_visibility(watch.scene, view.camera, pose, object_poses=moved[None], **options)
        assert found.masks is not None
        yield np.maximum.reduceat(found.masks.numpy()[0], first, axis=0)


def _seen_by(
    watch: Watch, viewers: Sequence[Viewer], images: dict[str, NDArray[Any]], object_poses: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Return bit p where participant p sees the pixel's surface, shape ``(n, H, W)``; their bodies are not included."""
    points, owners = images["points"], images["segmentation"]
    seen = np.zeros(owners.shape, dtype=np.uint8)
    for number, viewer in enumerate(viewers):
        body = [watch.scene.index(name) for name in viewer.body]
        for moment, eyes in enumerate(viewer.eyes.astype(np.float32)):
            shown = (owners[moment] >= 0) & ~np.isin(owners[moment], body)
            options: dict[str, Any] = {"object_poses": object_poses[moment : moment + 1], "exclude": body or None}
            options["threads"] = watch.threads
            status = point_visibility(watch.scene, viewer.camera, eyes, points[moment][shown], **options)
            assert isinstance(status, wp.array)
            seen[moment][shown] |= (status.numpy()[0] == Visibility.VISIBLE).astype(np.uint8) << number
    return seen

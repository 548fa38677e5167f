# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of label images, with a legend of their classes."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from warpvis.core.arrays import as_numpy, check_shape
from warpvis.core.checks import check_text
from warpvis.core.labels import LABEL_COUNT, LabelNames
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.maps import label_colors
from warpvis.viz._figures import draw_legend, legend_height, new_figure, save_figure

_WIDTH, _COLUMNS = 5.4, 3
# Height of the title and the axis labels [inches].
_TITLE_HEIGHT = 0.75


def save_labels(
    labels: ArrayInput,
    path: str | os.PathLike[str],
    *,
    label_names: Mapping[int, str] | None = None,
    title: str = "Labels",
) -> None:
    """Write a picture of a label image with a legend of its classes.

    Args:
        labels: The image, whole numbers from 0 to 255, shape ``(H, W)``.
        path: Picture to write.
        label_names: Names of custom classes: `Scene.label_names`, or those of `open_dataset`.
        title: Title of the picture.

    Raises:
        WarpvisError: If `labels` is not one image, names are invalid, or the picture cannot be written.
    """
    check_text(title, "title")
    image, names = as_numpy(labels, name="labels"), LabelNames(label_names)
    check_shape(image.shape, ("H", "W"), name="labels")
    if image.dtype.kind not in "iu" or not image.size or image.min() < 0 or image.max() >= LABEL_COUNT:
        raise ArrayError("labels must be an image of whole numbers from 0 to 255")
    colors = label_colors()
    legend = {number: (names.name(number), tuple(colors[number])) for number in np.unique(image).tolist()}
    height = _WIDTH * image.shape[0] / image.shape[1]
    figure = new_figure(_WIDTH, _TITLE_HEIGHT + height + legend_height(legend, _COLUMNS))
    axes = figure.subplots()
    axes.imshow(colors[image], interpolation="nearest")
    axes.set(title=title, xlabel="x [px]", ylabel="y [px]")
    draw_legend(figure, legend, columns=_COLUMNS)
    save_figure(figure, path)

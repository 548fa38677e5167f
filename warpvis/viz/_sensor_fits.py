# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of depth camera models fitted to images of walls."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from warpvis.core.checks import format_percent
from warpvis.errors import ArrayError
from warpvis.sensors import StereoFit
from warpvis.viz._figures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BINS, _MAX_SIGMAS = 81, 4.0


def save_sensor_fit(fit: StereoFit, path: str | os.PathLike[str]) -> None:
    """Write four panels: errors of one image, histogram of all errors, autocorrelation, and plane-fit errors by depth.

    The panels with curves show the measured data and the fitted model.

    Args:
        fit: Result of `warpvis.sensors.fit`.
        path: Picture to write.
    """
    if not isinstance(fit, StereoFit):
        raise ArrayError(f"fit must be a result of warpvis.sensors.fit, got {type(fit).__name__}")
    figure = new_figure(10, 7.5, gap=0.08)
    panels = figure.subplots(2, 2)
    _draw_errors(panels[0, 0], fit)
    _draw_histogram(panels[0, 1], fit)
    _draw_correlation(panels[1, 0], fit)
    _draw_depths(panels[1, 1], fit)
    figure.suptitle(
        f"f b {fit.focal_baseline:.4g} px m, sigma {fit.sigma:.3g} px, step {fit.step:.3g} px, "
        f"noise spacing {fit.noise_spacing} px, dropout {format_percent(fit.dropout, digits=1)}"
    )
    save_figure(figure, path)


def _spread(fit: StereoFit) -> float:
    """Return the standard deviation of errors, including quantization [px]."""
    return max(float(np.hypot(fit.sigma, fit.step / 12**0.5)), 1e-6)


def _draw_errors(axes: Axes, fit: StereoFit) -> None:
    farthest = int(np.argmax([wall.distance for wall in fit.walls]))
    limit = 3 * _spread(fit)
    image = axes.imshow(fit.errors[farthest], cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
    axes.set_facecolor("0.6")
    axes.set_title(f"Errors at {fit.walls[farthest].distance:.2f} m [px of disparity]")
    axes.get_figure().colorbar(image, ax=axes, shrink=0.8)  # type: ignore[union-attr]


def _draw_histogram(axes: Axes, fit: StereoFit) -> None:
    spread = _spread(fit)
    errors = np.concatenate([wall[np.isfinite(wall)] for wall in fit.errors])
    edges = np.linspace(-_MAX_SIGMAS * spread, _MAX_SIGMAS * spread, _BINS)
    axes.hist(errors, edges.tolist(), density=True, color="tab:blue", alpha=0.6, label="measured")
    centers = (edges[1:] + edges[:-1]) / 2
    axes.plot(
        centers, np.exp(-((centers / spread) ** 2) / 2) / (spread * np.sqrt(2 * np.pi)), "k", label="sigma and step"
    )
    axes.set_xlabel("error of disparity [px]")
    axes.set_title("All errors")
    axes.legend()


def _draw_correlation(axes: Axes, fit: StereoFit) -> None:
    lag = np.arange(len(fit.correlation))
    axes.plot(lag, fit.correlation, "o", color="tab:blue", markersize=4, label="measured")
    axes.plot(lag, fit.expected_correlation, "k", label=f"nodes {fit.noise_spacing} px apart")
    axes.set_xlabel("distance of pixels [px]")
    axes.set_title("Autocorrelation")
    axes.legend()


def _draw_depths(axes: Axes, fit: StereoFit) -> None:
    distance = np.array([wall.distance for wall in fit.walls])
    axes.plot(distance, [1e3 * wall.plane_rms for wall in fit.walls], "o", color="tab:blue", label="measured")
    line = np.linspace(0, distance.max() * 1.1, 60)
    axes.plot(line, 1e3 * line**2 * _spread(fit) / fit.focal_baseline, "k", label="z² sigma / (f b), facing the wall")
    axes.set_xlabel("distance of the wall [m]")
    axes.set_ylabel("plane-fit RMS [mm]")
    axes.set_title("By depth")
    axes.legend()

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the depth of six simulated depth cameras with exact depth, and show the reasons for missing depth.

Prints the fractions of pixels by reason and the error of valid pixels; writes depth_sensors.png.
"""

import numpy as np
from matplotlib import colormaps  # noqa: TID253
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv
from warpvis.sensors import Reason

PROFILES = ("realsense_d415", "realsense_d435", "realsense_d455", "oak_d", "kinect_v1", "structure")

scene = wv.scenes.PRESETS["room"].build()
pose = wv.look_at((2.2, -1.3, 1.0), (0.4, 0.3, 0.4))
figure = Figure(figsize=(9, 13), layout="constrained")
axes = figure.subplots(len(PROFILES), 3)

for row, name in zip(axes, PROFILES, strict=True):
    sensor = getattr(wv.sensors, name)(320, 240)
    views = wv.render(
        scene, sensor.camera(), pose, outputs=("depth", "true_depth", "reasons"), sensor=sensor, seed=1, frame=0
    )
    depth, true, reasons = (image.numpy()[0] for image in (views.depth, views.true_depth, views.reasons))
    error = np.abs(depth - true)[(reasons == Reason.VALID) & np.isfinite(true)]  # surfaces spread over the sky
    shares = {reason.name: float((reasons == reason).mean()) for reason in Reason}
    print(f"{name}: {', '.join(f'{key} {share:.1%}' for key, share in shares.items() if share)}", end="; ")
    print(f"median error {1000 * np.median(error):.1f} mm, 95 % below {1000 * np.quantile(error, 0.95):.0f} mm")
    for image, axis, title in zip((true, depth), row, ("exact", name), strict=False):
        axis.imshow(np.where(np.isfinite(image), image, np.nan), cmap="turbo", vmin=0.3, vmax=4.5)
        axis.set_title(title)
    shown = row[2].imshow(reasons, cmap=colormaps["tab10"].resampled(10), vmin=-0.5, vmax=9.5, interpolation="nearest")
    row[2].set_title("reasons")
    for axis in row:
        axis.set_axis_off()

bar = figure.colorbar(shown, ax=axes[:, 2], ticks=list(Reason), shrink=0.5)
bar.ax.set_yticklabels([reason.name for reason in Reason])
bar.ax.set_ylim(-0.5, len(Reason) - 0.5)
figure.savefig("depth_sensors.png", dpi=80)

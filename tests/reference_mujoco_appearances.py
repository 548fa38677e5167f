# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of `warpvis.kernels.mujoco.appearances`."""

import numpy as np


def object_colors(geom_rgba, geom_matid, mat_rgba, mat_emission, worlds, geoms):
    """Return colors and emission of objects in worlds; NaN for objects without a geom."""
    colors, emission = np.full((len(worlds), len(geoms), 4), np.nan), np.full((len(worlds), len(geoms), 3), np.nan)
    for row, world in enumerate(worlds):
        for index, geom in enumerate(geoms):
            if geom < 0:
                continue
            rgba, material = geom_rgba[world % len(geom_rgba), geom], geom_matid[world % len(geom_matid), geom]
            if material >= 0 and (rgba == [0.5, 0.5, 0.5, 1]).all():
                rgba = mat_rgba[world % len(mat_rgba), material]
            colors[row, index] = np.clip(rgba.astype(np.float64), 0, 1)
            glow = mat_emission[world % len(mat_emission)]
            factor = max(0.0, float(glow[material])) if material >= 0 else 0.0
            emission[row, index] = factor * colors[row, index, :3]
    return colors, emission


def light_vectors(values, original, worlds, lights, lowest):
    """Return a field of lights in worlds; `original` for lights without an id."""
    rows = np.maximum(values[worlds % len(values)][:, np.maximum(lights, 0)], lowest)
    return np.where((lights >= 0)[None, :, None], rows, original[None])


def light_switches(active, types, worlds, lights):
    """Return 1 for lights that are on: headlights (-1), and light of the last resort (-2) if only points are."""
    rows = []
    for world in worlds:
        kinds = types[world % len(types)]
        shines = active[world % len(active)] & (kinds < 3)
        on = [light == -1 or (light >= 0 and shines[light]) for light in lights]
        counted = [is_on and (light < 0 or kinds[light] != 2) for light, is_on in zip(lights, on, strict=True)]
        rows.append([not any(counted) if light == -2 else value for light, value in zip(lights, on, strict=True)])
    return np.array(rows, dtype=np.float64)


def light_shapes(types, cutoffs, exponents, attenuations, worlds, lights, original):
    """Return kinds (1 directional, 2 point, 3 spot), cones (outer angle [rad], exponent) and attenuations."""
    shape = len(worlds), len(lights)
    kinds, cones = np.tile(original, (len(worlds), 1)), np.tile([np.pi, 0.0], (*shape, 1))
    divisors = np.tile([1.0, 0.0, 0.0], (*shape, 1))
    for row, world in enumerate(worlds):
        for column, light in enumerate(lights):
            if light >= 0:
                kinds[row, column] = {0: 3, 1: 1}.get(int(types[world % len(types), light]), 2)
                if kinds[row, column] == 3:
                    cutoff, exponent = cutoffs[world % len(cutoffs), light], exponents[world % len(exponents), light]
                    cones[row, column] = np.radians(np.clip(float(cutoff), 0, 180)), max(float(exponent), 0)
                    divisors[row, column] = np.maximum(attenuations[world % len(attenuations), light], 0)
    return kinds, cones, divisors

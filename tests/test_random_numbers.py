# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the per-pixel random numbers: known answers, distributions, reproducibility."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest
import reference_random
import warp as wp
from gpu_code import gpu_code
from scipy import stats

from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window
from warpvis.kernels.sensors import random_numbers

ROOT = Path(__file__).parent.parent
SHAPE = (3, 37, 54)
SEED, STREAM = 0xDEADBEEF, 7

wp.set_module_options(pixel_options("shared/random.h"))


@wp.func_native(
    """
warpvis::Philox<warpvis::OnePixel> numbers = {{counter.data[0], counter.data[1], counter.data[2], counter.data[3]}};
numbers.mix(key.data[0], key.data[1]);
for (int k = 0; k < 4; ++k) words.data[k] = numbers.word[k];
"""
)
def mix(counter: wp.array[wp.uint32], key: wp.array[wp.uint32], words: wp.array[wp.uint32]): ...


@wp.kernel
def mix_once(counter: wp.array[wp.uint32], key: wp.array[wp.uint32], words: wp.array[wp.uint32]):
    _ = wp.tid()
    mix(counter, key, words)


@wp.kernel
def draw_all(
    window: Window,
    draws: wp.array[wp.vec2ui],
    seed: wp.uint32,
    stream: wp.uint32,
    words: wp.array3d[wp.uint32],
    uniforms: wp.array3d[float],
    normals: wp.array3d[float],
):
    view, y, x = wp.tid()
    view, y = view + window.first_view, y + window.first_row
    number = draws[view]
    word = random_numbers.random_word(seed, stream, number[0], number[1], y, x)
    words[view, y, x] = word
    uniforms[view, y, x] = random_numbers.to_uniform(word)
    normals[view, y, x] = random_numbers.to_normal(word)


@wp.kernel
def make_of(words: wp.array[wp.uint32], uniforms: wp.array[float], normals: wp.array[float]):
    i = wp.tid()
    uniforms[i] = random_numbers.to_uniform(words[i])
    normals[i] = random_numbers.to_normal(words[i])


def as_numbers(pairs, device):
    return wp.array(np.array(pairs, dtype=np.uint32), dtype=wp.vec2ui, device=device)


def draw(pairs, shape, device, seed=SEED, stream=STREAM, threads=1):
    """Return words, uniforms and normals of views, given as pairs of view and frame."""
    made = [wp.empty((len(pairs), *shape), dtype=kind, device=device) for kind in (wp.uint32, float, float)]
    numbers = as_numbers(pairs, device)
    given = [numbers, wp.uint32(seed), wp.uint32(stream), *made]
    launch_images(
        draw_all, made[0].shape, lambda window: [window, *given], device=wp.get_device(device), threads=threads
    )
    return [image.numpy() for image in made]


def made_of(words, device):
    words = wp.array(words, dtype=wp.uint32, device=device)
    made = [wp.empty(len(words), dtype=float, device=device) for _ in range(2)]
    wp.launch(make_of, dim=len(words), inputs=[words, *made], device=device)
    return [numbers.numpy() for numbers in made]


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ],
)
def test_philox_known_answers(device, counter, key, words):
    """Known answers of Random123 for philox4x32-10 (`kat_vectors`)."""
    counter, key, words = (
        np.array([int(word, 16) for word in text.split()], np.uint32) for text in (counter, key, words)
    )
    found = wp.zeros(4, dtype=wp.uint32, device=device)
    given = [wp.array(numbers, dtype=wp.uint32, device=device) for numbers in (counter, key)]
    wp.launch(mix_once, dim=1, inputs=[*given, found], device=device)
    np.testing.assert_array_equal(found.numpy(), words)
    np.testing.assert_array_equal(reference_random.philox(counter, tuple(int(word) for word in key)), words)


def test_words_and_numbers_match_reference(device):
    views, frames = [0, 5, 0xFFFFFFFF], [2, 0xFFFFFFFF, 0]
    words, uniforms, normals = draw(list(zip(views, frames, strict=True)), SHAPE[1:], device)
    np.testing.assert_array_equal(words, reference_random.random_words(views, frames, SHAPE[1:], SEED, STREAM))
    np.testing.assert_array_equal(uniforms, reference_random.to_uniform(words))
    np.testing.assert_allclose(normals, reference_random.to_normal(words), rtol=4e-5)


def test_numbers_at_positions_match_pixels(device):
    """Positions may lie outside the image."""
    views, frames, places = [0, 5, 0xFFFFFFFF], [2, 0xFFFFFFFF, 0], [(0, 0), (36, 53), (7, 2), (2**31 - 1, 2**31 - 2)]
    draws = wp.array(np.array([views, frames], np.uint32).T.copy(), dtype=wp.vec2ui, device=device)
    found = wp.empty((3, 4), dtype=float, device=device)
    given = [draws, wp.array(places, dtype=wp.vec2i, device=device), wp.uint32(SEED), wp.uint32(STREAM), found]
    wp.launch(random_numbers.draw_uniforms, dim=found.shape, inputs=given, device=device)
    wanted = reference_random.draw_uniforms(views, frames, places, SEED, STREAM)
    np.testing.assert_array_equal(found.numpy(), wanted)
    _, uniforms, _ = draw(list(zip(views, frames, strict=True)), SHAPE[1:], device)
    np.testing.assert_array_equal(uniforms[:, [0, 36, 7], [0, 53, 2]], wanted[:, :3])


def test_kernels_draw_equal_normals(device):
    pairs = [(3, 4), (5, 6)]
    normals = wp.empty((2, *SHAPE[1:]), dtype=float, device=device)
    given = [as_numbers(pairs, device), wp.uint32(SEED), wp.uint32(STREAM), normals]
    launch_images(
        random_numbers.draw_normals,
        normals.shape,
        lambda window: [window, *given],
        device=wp.get_device(device),
        span=WHOLE_ROW if device == "cpu" else 1,
    )
    np.testing.assert_array_equal(normals.numpy(), draw(pairs, SHAPE[1:], device)[2])
    expected = reference_random.draw_normals([3, 5], [4, 6], SHAPE[1:], SEED, STREAM)
    np.testing.assert_allclose(normals.numpy(), expected, rtol=4e-5)


def test_normals_match_inverse_cdf_in_tails(device):
    """Words from both ends and the middle: within 4e-5 of the inverse cumulative distribution function."""
    steps = np.unique(np.geomspace(1, 2**31, 4001).astype(np.uint64)) - 1
    half = 2**31
    words = np.concatenate([steps, 2 * half - 1 - steps, half + steps[steps < half], half - 1 - steps]).astype(
        np.uint32
    )
    uniforms, normals = made_of(words, device)
    np.testing.assert_allclose(normals, reference_random.to_normal(words), rtol=4e-5)
    assert uniforms.min() == 2.0**-24
    assert uniforms.max() == 1 - 2.0**-24
    mirrored = made_of(~words, device)[1]
    np.testing.assert_array_equal(normals, -mirrored)


def test_normals_equal_single_precision_formula(device):
    """NumPy's single precision fuses nothing: the bits are the same on every device."""
    words = np.random.default_rng(0).integers(0, 2**32, 100_000, dtype=np.uint32)
    np.testing.assert_array_equal(made_of(words, device)[1], normals_in_single_precision(words))


def normals_in_single_precision(words):
    def polynomial(x, coefficients):
        total = np.full_like(x, np.float32(coefficients[0]))
        for coefficient in coefficients[1:]:
            total = total * x + np.float32(coefficient)
        return total

    one = np.float32(1)
    above = np.where(words >> np.uint32(31), words - np.uint32(2**31), np.uint32(2**31 - 1) - words).astype(np.uint32)
    to_end = ((2**31 - 1 - above.astype(np.int64)).astype(np.float32) + one / 2) * np.float32(2.0**-31)
    to_middle = (above.astype(np.float32) + one / 2) * np.float32(2.0**-31)
    share, exponent = np.frexp(to_end * (2 * one - to_end))
    small = share < np.float32(np.sqrt(0.5))
    r = np.where(small, 2 * share, share) - one
    logarithm = [0.17162392, -0.26931953, 0.2956995, -0.35937172, 0.48062676, -0.72136354, 1.4426965]
    log2 = (exponent - small).astype(np.float32) + polynomial(r, logarithm) * r
    s = np.sqrt(np.float32(5.5) - log2) - np.float32(3.75)
    inverse = [-0.00051696796, 0.002595633, -0.0012092399, -0.014979157, 0.03480383]
    inverse += [-0.02056774, -0.06026775, 1.4751731, 3.2151785]
    size = polynomial(s, inverse) * to_middle
    return np.where(words >> np.uint32(31), size, -size)


def test_distributions_match_theory(device):
    """Kolmogorov-Smirnov tests and moments of a million numbers."""
    _, uniforms, normals = draw([(0, frame) for frame in range(13)], (240, 320), device, seed=1)
    count = uniforms.size
    assert stats.kstest(uniforms.ravel(), "uniform").pvalue > 1e-3
    assert stats.kstest(normals.ravel(), "norm").pvalue > 1e-3
    assert abs(normals.mean()) < 4 / np.sqrt(count)
    assert abs(normals.std() - 1) < 4 / np.sqrt(2 * count)
    assert abs(stats.kurtosis(normals.ravel())) < 4 * np.sqrt(24 / count)


@pytest.mark.parametrize("change", ["seed", "stream", "view", "frame", "y", "x"])
def test_numbers_of_adjacent_keys_are_uncorrelated(device, change):
    """Change one part of the key: neither the numbers nor their squares correlate."""
    first = draw([(0, 0)], (240, 320), device)[2][0]
    if change in ("seed", "stream"):
        other = draw([(0, 0)], (240, 320), device, SEED + (change == "seed"), STREAM + (change == "stream"))[2][0]
    elif change in ("view", "frame"):
        other = draw([(int(change == "view"), int(change == "frame"))], (240, 320), device)[2][0]
    else:
        other = np.roll(first, 1, axis=0 if change == "y" else 1)
    for power in (1, 2):
        found = np.corrcoef(first.ravel() ** power, other.ravel() ** power)[0, 1]
        assert abs(found) < 4 / np.sqrt(first.size)


def test_numbers_are_independent_of_batch_and_image_size(device):
    """A single view, a batch, any split over threads, and images of another width or height."""
    pairs = [(4, 9), (2, 9), (7, 1)]
    whole = draw(pairs, SHAPE[1:], device, threads=3)
    for index, pair in enumerate(pairs):
        for part, image in zip(draw([pair], SHAPE[1:], device), whole, strict=True):
            np.testing.assert_array_equal(part[0], image[index])
    for part, image in zip(draw(pairs, (20, 31), device), whole, strict=True):
        np.testing.assert_array_equal(part, image[:, :20, :31])


def test_random_number_modules_disable_fp_fusion():
    """Products and sums fused on only one device would differ."""
    users = []
    for path in (ROOT / "kernels").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "random_numbers" not in text and "import pixel_options" not in text:
            continue
        calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
        options = [ast.unparse(call) for call in calls if "set_module_options" in ast.unparse(call.func)]
        assert any("'fuse_fp': False" in text or "pixel_options(" in text for text in options), path
        users.append(path)
    assert users
    assert pixel_options("shared/random.h")["fuse_fp"] is False


@pytest.mark.slow
def test_gpu_code_has_no_fused_multiply_add(tmp_path):
    """The PTX code of NVRTC contains no fused multiply-add instruction."""
    text = gpu_code("warpvis.kernels.sensors.random_numbers", tmp_path)
    assert len(re.findall(r"\bmul\.(?:rn\.)?f32", text)) > 10
    assert not re.findall(r"\bfma\.\w+\.f32|\.approx\.|\.ftz\.", text)

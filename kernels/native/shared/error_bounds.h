// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// Rounding error bounds of edge functions, volumes and 1 / z, for both devices. tests/test_error_bounds.py compares
// those of edge functions and volumes with the errors of random triangles.
//
// Let u = 2^-24 be the greatest relative error of one rounding in single precision. Coordinates are the camera's, with
// x and y in pixels times depth. D is the distance of a triangle's corners: twice the greatest depth times the image's
// extent in pixels, plus S; S is the extent of the corners. The corners a, b and c are rounded by multiples of u D.
//
// Edge functions. The function of the edge from a to b is 2 (a x b) . d for a ray in direction d. Moving a by e changes
// it by 2 e . (b x d). The length of b x d is that of b's distance from the ray, which is at most S if the ray passes
// through the triangle, and at most S + m z if it passes m pixels away. The products of (a - b) x (a + b), at most
// S D each, and the sum over the components of d are rounded by multiples of u S D as well. Hence the bound
//
//     EDGE_ERROR_BOUND * D * (S + EDGE_MARGIN * D / extent),
//
// with 2 z < D / extent. The sum of all roundings in the worst case would be several times greater than 2.5 u: they
// have different signs, and not all terms are large at once. The largest error among millions of adversarial triangles
// was 0.81 of this bound. CPU packets multiply it by 1 + reach / focal length, for the components of d that exceed 1.
//
// Volumes. The volume of a, b and c is negative if the camera sees the front. On CPU, it is a . (ab x ac): a factor D,
// and twice S, whose errors are those of edge functions. On CUDA, sides are subtracted before they are transformed, and
// VOLUME_ERROR is a fraction of the product of the lengths of both sides, the distance of their common corner and the
// lengths of the rows of the transformation: 4 sqrt(3) roundings for each side, 5 sqrt(3) for the corner and 5 for the
// products and their sum make 28. It is 0 where two corners coincide, as in unused lanes of a leaf.
//
// 1 / z. It is linear in the image: n . (u, v, 1) / volume, for a normal n. Single precision suffices if the terms are
// not much larger than their sum, and if rounding of the corners does not rotate the plane much. On CPU, terms exceed
// the sum by a factor of MAX_TERMS at most, each rounded twice: 16 * 2 u = 2e-6. A corner moves by `blur` pixels, which
// rotates a triangle of a width and height by blur (width + height) / area of its slope: MAX_PLANE_ROTATION bounds the
// effect on all of the triangle, and ALLOWED_ERROR on its pixels. On CUDA, 1 / z is expanded about a corner, so that
// its terms are the corner's 1 / z, rounded by TERM_ERROR, and the changes from there, whose slopes have an error of
// SLOPE_ERROR of the sides' lengths: their sum must not exceed ALLOWED_ERROR. Otherwise 1 / z is computed in double
// precision.

#pragma once

// Greatest relative error of one rounding in single precision, 2^-24, rounded up.
constexpr float ROUNDING = 6e-8f;

// Relative error bound of an edge function in single precision.
constexpr float EDGE_ERROR_BOUND = 1.5e-7f;

// The bound holds for pixels up to this far outside a triangle [px], however small the triangle is.
constexpr float EDGE_MARGIN = 0.01f;

// Factor of the error bound of edge functions on CPU if u and v of the rays are rounded too.
constexpr float ROUNDED_RAY_FACTOR = 1.5f;

// Relative error bound in double precision: eight roundings.
constexpr double EXACT_ERROR_BOUND = 1e-15;

// Relative error bound of a triangle's volume on CUDA: 28 roundings.
constexpr float VOLUME_ERROR = 28.0f * ROUNDING;

// Error bound of a component of a triangle's normal on CUDA, as a fraction of the product of the lengths of two sides
// and of two rows of the transformation: four roundings.
constexpr float SLOPE_ERROR = 2.4e-7f;

// Relative error of a rounded term of 1 / z on CUDA, and the allowed relative error of 1 / z.
constexpr float TERM_ERROR = 2e-7f, ALLOWED_ERROR = 6e-6f;

// Greatest ratio of the terms of 1 / z on CPU to their sum for which single precision suffices.
constexpr float MAX_TERMS = 16.0f;

// Greatest rotation of a triangle's plane on CPU by rounding of its corners, as a fraction of 1 / z, for which single
// precision suffices.
constexpr float MAX_PLANE_ROTATION = 5e-5f;

// A corner counts as behind the camera if its depth is at most this fraction of the farthest one's, or negligible.
constexpr float CROSSING_SHARE = 1e-6f, CROSSING_MIN = 1e-30f;

// Factor by which traversal exceeds the greatest depth.
constexpr float FARTHER = 1.00001f;

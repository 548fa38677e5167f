// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Rays are from a ray table: the image's packets are those of a `RayTree`.
constexpr bool RAY_TABLE = true;
// All rays begin at the eye; origin_rays.h is for distinct origins.
constexpr bool RAY_ORIGINS = false;

// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Rays are of a table: an image's packets are those of a `RayTree`.
constexpr bool RAY_TABLE = true;
// And all begin at the eye; apart_rays.h says otherwise.
constexpr bool RAY_ORIGINS = false;

// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Rays are from a ray table and have distinct origins: see `RayTree::origins`.
constexpr bool RAY_TABLE = true;
constexpr bool RAY_ORIGINS = true;

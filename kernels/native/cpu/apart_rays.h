// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Rays are of a table, and pass beside the eye: `RayTree::apart` says where.
constexpr bool RAY_TABLE = true;
constexpr bool RAY_ORIGINS = true;

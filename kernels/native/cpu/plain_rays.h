// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Rays pass through pixel centers or points of the image. Alternatives to this header: table_rays.h, origin_rays.h.
constexpr bool RAY_TABLE = false;
// All rays begin at the eye.
constexpr bool RAY_ORIGINS = false;

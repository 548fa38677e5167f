// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

// Rays go through pixels' centres or points of the image; table_rays.h says otherwise where it stands instead of this.
constexpr bool RAY_TABLE = false;
// And all begin at the eye.
constexpr bool RAY_ORIGINS = false;

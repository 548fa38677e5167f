# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Hold what every call is given and checked with: arrays, cameras, poses, labels, frames and threads.

All other packages import these modules. Users take what is public of them from `warpvis` itself: `Camera`, `Frames`,
`Label`, `Visibility`, `look_at`.
"""

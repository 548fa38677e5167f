# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define and check the common arguments: arrays, cameras, poses, labels, frames and threads.

All other packages import these modules. The public names are available in `warpvis` itself: `Camera`, `Frames`,
`Label`, `Visibility`, `look_at`.
"""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read the poses of frames from files, one module a format; `read_frames` chooses one by the file's name."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of frames' poses, one module per format; `read_frames` chooses one by the file name."""

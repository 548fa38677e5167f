# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""From a shard's images to its files: on threads, and where there are many cores, in processes beside."""

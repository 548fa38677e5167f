# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read datasets: `_frames` is the interface for users, `_job` reads manifests, the others read shards of formats."""

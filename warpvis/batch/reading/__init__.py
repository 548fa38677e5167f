# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read datasets back: `_frames` is what users index, `_job` what a manifest says, the others read shards of formats."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""From poses to a dataset on disk, in shards, safe to interrupt: see `warpvis.batch.api.render_batch`."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Engines that render shards: processes of this machine, or actors of a Ray cluster."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Encoding and writing of shards, on threads, and in additional processes on machines with many cores."""

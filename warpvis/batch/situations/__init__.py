# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets of situations: generated in shards, written in formats of machine learning, read back, and described."""

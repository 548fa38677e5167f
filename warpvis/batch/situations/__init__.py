# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets of situations: generated in shards, written in formats of machine learning, read back, and described."""

from __future__ import annotations

from warpvis.batch.situations._base import find_situation_format as find_situation_format
from warpvis.batch.situations._generate import SituationSummary, generate_situations
from warpvis.batch.situations._stored import SituationDataset, open_situations

__all__ = ["SituationDataset", "SituationSummary", "generate_situations", "open_situations"]

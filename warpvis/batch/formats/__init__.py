# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Formats of datasets, one module per format; `_base.Format` is their protocol."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lay out the files of datasets, one module a format; `_base.Format` says what a format must do."""

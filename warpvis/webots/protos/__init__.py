# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Expansion of PROTO nodes, from their files and templates, or from built-in replacements."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find and expand PROTO nodes: from their files, through their templates, and the well-known ones without a file."""

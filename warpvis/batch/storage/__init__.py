# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Storage of datasets: local folders and URLs, locks, and direct I/O."""

# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of recordings of depth cameras, one module per family of formats; `wv.open_recording` chooses one."""

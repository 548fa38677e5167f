# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Device code: Warp functions and kernels, one topic per module. Installed as ``warpvis.kernels``."""

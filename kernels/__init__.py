# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Hold device code: Warp functions and kernels, one topic a module. It installs as ``warpvis.kernels``."""

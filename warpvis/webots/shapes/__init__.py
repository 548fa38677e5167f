# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Make triangles of Webots' geometry nodes, with the winding that Webots gives them."""

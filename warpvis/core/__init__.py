# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What every call is given and checked with: arrays, cameras, poses, labels, frames, threads.

The house's own toolbox: users take what is public of it from `warpvis` itself.
"""

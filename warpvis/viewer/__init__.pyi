# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
# The public names of warpvis.viewer and their modules; `lazy_loader` reads this file.

from ._rerun import save_rerun as save_rerun
from ._stage import MujocoStage as MujocoStage
from ._state import Snapshot as Snapshot, ViewerState as ViewerState
from ._view import Viewer as Viewer, framing_agent as framing_agent
from ._watch import WatchPage as WatchPage

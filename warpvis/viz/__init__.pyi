# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
# The public names of warpvis.viz and where each lives; `lazy_loader` reads this table.

from ._figures import save_map as save_map
from ._overview import save_depth as save_depth, save_overview as save_overview, view_from_outside as view_from_outside
from ._perspective import save_perspective as save_perspective
from ._sightings import save_sightings as save_sightings

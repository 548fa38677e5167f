# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
# The public names of warpvis.viz and their modules; `lazy_loader` reads this file.

from ._drawing import STATE_COLORS as STATE_COLORS, agent_colors as agent_colors
from ._figures import (
    depth_colors as depth_colors,
    save_contact_sheet as save_contact_sheet,
    save_labels as save_labels,
    save_map as save_map,
    save_preview as save_preview,
)
from ._overview import (
    save_depth as save_depth,
    save_overview as save_overview,
    save_point_sightings as save_point_sightings,
    save_sightings as save_sightings,
    view_from_outside as view_from_outside,
)
from ._perspective import save_perspective as save_perspective
from ._placement import save_placement as save_placement
from ._sensor_fits import save_sensor_fit as save_sensor_fit

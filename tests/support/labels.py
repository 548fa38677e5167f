# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Files with labels."""

from __future__ import annotations

import json

RULES = {"label_names": {"40": "road"}, "labels": {"road_*": "road", "*": 7, "car_0": "252"}, "ground_labels": ["road"]}
TEXTS = {
    "rules.json": json.dumps(RULES),
    "rules.toml": """ground_labels = ["road"]
[label_names]
40 = "road"
[labels]
"road_*" = "road"
"*" = 7
car_0 = "252"
""",
    "rules.yaml": """label_names:
  40: road
labels: {"road_*": road, "*": 7, car_0: 252}
ground_labels: [road]
""",
}

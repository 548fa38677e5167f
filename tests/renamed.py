# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Names and options that were renamed before the first release: the old ones must not return."""

RENAMED_NAMES = {
    "wv.check_points": "wv.point_visibility",
    "wv.check_points_measured": "wv.point_visibility_from_depth",
    "wv.visibility_map": "wv.floor_map",
    "wv.voxel_map_of": "wv.voxel_map_from_scene",
    "wv.Field": "wv.FieldOfView",
    "wv.Views.objects": "wv.Views.segmentation",
    "wv.parse_poses": "wv.core.poses.parse_poses",
    "wv.BOP_DELTA": "wv.visibility.BOP_DELTA",
    "wv.Candidate": "wv.visibility.Candidate",
    "wv.State": "wv.visibility.State",
    "wv.Sphere": "wv.maps.Sphere",
    "wv.classify_rendered": "wv.maps.classify_rendered",
    "wv.PlanVisibility": "wv.maps.PlanVisibility",
    "wv.plan_visibility": "wv.maps.plan_visibility",
    "wv.Voxel": "wv.maps.Voxel",
    "wv.BestViews": "wv.planning.BestViews",
    "wv.best_views": "wv.planning.best_views",
    "wv.pose_grid": "wv.planning.pose_grid",
    "wv.clearance": "wv.planning.clearance",
    "wv.standing_room": "wv.planning.standing_room",
    "wv.Coverage": "wv.planning.Coverage",
    "wv.Samples": "wv.planning.Samples",
    "wv.coverage": "wv.planning.coverage",
    "wv.surface_samples": "wv.planning.surface_samples",
    "wv.minimum_height": "wv.planning.minimum_height",
    "wv.Proposal": "wv.planning.Proposal",
    "wv.propose_view": "wv.planning.propose_view",
    "wv.BatchSummary": "wv.batch.BatchSummary",
    "wv.FrameRenderer": "wv.batch.FrameRenderer",
    "wv.ArrayError": "wv.errors.ArrayError",
    "wv.CameraError": "wv.errors.CameraError",
    "wv.FileFormatError": "wv.errors.FileFormatError",
    "wv.PoseError": "wv.errors.PoseError",
    "wv.SceneError": "wv.errors.SceneError",
    "wv.solids": "wv.scene.solids",
    "wv.panorama.render_wide": "wv.rendering.render_wide",
    "wv.webots.world.load_webots": "wv.webots.load_webots",
    "wv.webots.devices.render_range": "wv.webots.render_range",
    "wv.webots.recognition.recognize": "wv.webots.recognize",
    "wv.webots.controller.DepthEye": "wv.webots.DepthEye",
}
"""New names by old names."""

RENAMED_OPTIONS = (
    ("world", "world_index", "render", "Frames"),
    ("cell", "cell_size", "floor_map", "voxel_map", "voxel_map_from_scene"),
    ("sigma", "level_tolerance", "floor_map"),
    ("size", "diameter", "maps.Sphere"),
    ("most", "max_distance", "planning.clearance"),
    ("most", "max_height", "planning.minimum_height"),
    ("reach", "max_distance", "planning.propose_view"),
)
"""Old option, new option, and the functions that take it."""

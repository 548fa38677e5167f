# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Each row of the table of docs/scene_files/usd.md has tests."""

from support.table_rows import check_rows

E = "test_usd_elements"
C = "test_usd_composition"
S = "test_usd_shapes"
A = "test_usd_appearance"
L = "test_usd_lights"
B = "test_usd_bodies"
F = "test_usd_files"

TESTS = {
    "`metersPerUnit`, `upAxis`": f"{F}::test_unit_defaults_to_centimeters_and_y_up, "
    "test_nested_stage_in_centimeters_equals_scene_built_by_hand",
    "time samples": f"{E}::test_first_frame_is_read",
    "references, payloads, sublayers, variants": f"{E}::test_references_and_payloads_are_read, "
    f"test_selected_variants_are_read, test_search_path_finds_references; {C}::test_sublayers_are_composed",
    "references that cannot be opened": "test_usd_bad_files::test_missing_references_are_left_out",
    "`active`, `over`, `class`": f"{E}::test_hidden_prims_are_not_read",
    "`visibility`, inherited": f"{E}::test_hidden_prims_are_not_read",
    "`purpose`, inherited": f"{E}::test_hidden_prims_are_not_read",
    "transforms, `!resetXformStack!`": f"{E}::test_transforms_with_shear_flattening_and_reset_are_exact, "
    f"test_mirrored_meshes_keep_their_front; {C}::test_meshes_are_stored_once_per_size",
    "`Mesh`": f"{E}::test_polygons_are_fans_without_holes",
    "`holeIndices`, `orientation`": f"{E}::test_polygons_are_fans_without_holes",
    "`doubleSided`": f"{E}::test_double_sided_meshes_have_double_sided_materials; {S}::test_depth_has_no_culling",
    "`subdivisionScheme`": f"{E}::test_subdivision_surfaces_are_their_smooth_cage; "
    f"{S}::test_cages_keep_their_own_normals",
    "`normals`, `primvars:normals`": f"{E}::test_normals_are_read, "
    f"test_invalid_normals_are_replaced_by_those_of_faces; {S}::test_normals_of_the_primvar_come_first",
    "`TetMesh`": f"{S}::test_surfaces_of_tetrahedra_are_those_of_usd",
    "`Cube`, `Sphere`, `Cylinder`, `Cone`, `Capsule`, `Plane`, `Cylinder_1`, `Capsule_1`": f"{E}::"
    f"test_simple_shapes_have_the_bounds_of_usd; {S}::test_triangles_of_round_shapes_are_close_to_them; "
    "test_usd_solids::test_moving_round_shapes_are_exact, test_other_moving_shapes_are_triangles",
    "curves, points, NURBS patches, volumes, splats": f"{C}::test_prims_without_triangles_are_left_out; "
    f"{E}::test_other_prims_are_listed",
    "instances (`instanceable`)": f"{C}::test_equal_meshes_and_instances_share_mesh_and_appearance; "
    f"{F}::test_instances_of_a_large_mesh_share_it",
    "point instancers whose arrays do not fit": f"{C}::test_instancers_whose_arrays_do_not_fit_are_left_out",
    "`PointInstancer`, nested, `ids`, `invisibleIds`, `inactiveIds`": f"{F}::test_point_instancers_are_expanded, "
    f"test_nested_point_instancers_multiply; {C}::test_inactive_and_invisible_instances_are_those_of_usd",
    "`UsdSkel`": f"{C}::test_skinned_meshes_have_the_pose_and_shape_of_the_first_frame, "
    "test_skinned_meshes_inside_of_instances_have_the_bind_pose",
    "`SemanticsLabelsAPI`, inherited": f"{E}::test_semantic_labels_are_categories; "
    f"{C}::test_labels_of_other_taxonomies_are_categories",
    "`SemanticsAPI` of Isaac Sim": f"{E}::test_semantic_labels_are_categories; "
    f"{C}::test_labels_of_other_taxonomies_are_categories",
    "`UsdPreviewSurface`": f"{A}::test_constant_inputs, test_opacity_of_the_same_and_of_another_image, "
    "test_metallic_and_roughness_of_separate_images, test_maps_of_normals_occlusion_and_emission",
    "`UsdUVTexture`": f"{A}::test_textures_have_coordinates_wrap_modes_and_scale, test_wrap_modes, "
    "test_missing_textures_use_their_fallback, test_metallic_and_roughness_of_separate_images; "
    f"{E}::test_archives_contain_textures",
    "`UsdPrimvarReader`, `UsdTransform2d`": f"{A}::test_texture_coordinates_are_transformed, "
    "test_textures_have_coordinates_wrap_modes_and_scale, test_primvar_readers_color_materials",
    "`ior`, `clearcoat`, `displacement`, specular workflow": f"{A}::test_other_inputs_of_surfaces_are_ignored",
    "UDIM tiles": f"{A}::test_textures_of_tiles_are_left_out",
    "`GeomSubset` with materials": f"{A}::test_subsets_have_materials",
    "`displayColor`, `displayOpacity`": f"{A}::test_display_colors, test_display_colors_are_inherited_and_indexed",
    "MDL, MaterialX and renderers' materials": f"{A}::test_mdl_materials_have_their_constant_color, "
    "test_materialx_surfaces_have_their_constant_color, test_materials_of_renderers_have_their_constant_color",
    "`DistantLight`": f"{L}::test_distant_lights",
    "`SphereLight`, `CylinderLight`": f"{L}::test_cylinder_lights_are_points_or_spots, "
    "test_shaped_lights_are_spots_in_meters, test_ratios_of_lights_are_physical",
    "`RectLight`, `DiskLight`": f"{L}::test_light_of_flat_lights_falls_with_the_cosine",
    "`DomeLight`, `DomeLight_1`": f"{L}::test_domes_are_ambient_light_and_background, test_domes_about_z, "
    "test_domes_of_linear_light",
    "`intensity`, `exposure`, `color`, `colorTemperature`, `normalize`": f"{L}::"
    "test_white_surfaces_that_face_all_lights_are_white, test_color_temperatures_are_those_of_usd, "
    "test_ratios_of_lights_are_physical, test_normalized_lights_do_not_depend_on_their_size",
    "other lights, light linking, IES profiles": f"{L}::test_other_lights_are_listed, "
    "test_lights_with_a_mesh_are_listed, test_profiles_and_linking_are_ignored",
    "no lights": f"{L}::test_stages_without_lights_have_a_headlight",
    "`Camera`": f"{B}::test_cameras_equal_those_of_usd, test_lenses_of_cameras_are_ignored",
    "`RenderProduct`": f"{B}::test_render_products_and_orthographic_cameras",
    "`PhysicsRigidBodyAPI`": f"{B}::test_joints_move_their_bodies, test_static_bodies_are_static_by_default",
    "`PhysicsFixedJoint`, `PhysicsRevoluteJoint`, `PhysicsPrismaticJoint`": f"{B}::test_joints_move_their_bodies, "
    "test_joint_values_of_the_stage_are_initial",
    "`PhysicsJoint` with at most one free axis": f"{B}::test_generic_joints_with_one_free_axis_are_read, "
    "test_generic_joints_without_a_free_axis_are_fixed",
    "`PhysicsSphericalJoint`, `PhysicsDistanceJoint`, other `PhysicsJoint`": f"{B}::"
    "test_unsupported_joints_are_listed, test_bodies_of_unsupported_joints_float",
    "joints that close a loop": f"{B}::test_unsupported_joints_are_listed, "
    "test_loops_outside_of_articulations_are_left_out_without_a_warning",
    "`NewtonMimicAPI`": f"{B}::test_joints_follow_others",
    "masses, materials and collisions of physics, audio, UI": f"{C}::test_physics_audio_and_ui_are_ignored",
}


def test_each_row_has_tests():
    check_rows("usd.md", TESTS)

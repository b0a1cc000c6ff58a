// SPDX-License-Identifier: Apache-2.0
/// @file  Everything that gsh::gsh offers, floor by floor. io/, check/ and synthetic/ are opt-in folders.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>

#include <gsh/math/activation.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/low_rank.hpp>
#include <gsh/math/nonnegative.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/rotation_increment.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/sh_rotation.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <gsh/backend/backend.hpp>
#include <gsh/backend/fetch_ahead.hpp>
#include <gsh/backend/host_buffer.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/sum.hpp>

#include <gsh/camera/camera_increment.hpp>
#include <gsh/camera/camera_input.hpp>
#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>

#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/coarse_mesh.hpp>
#include <gsh/body/foot_slide.hpp>
#include <gsh/body/geodesic.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_merge.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_span.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/posed_surface.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/resampled_motion.hpp>
#include <gsh/body/retarget.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/rig_pose.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/body/surface_element.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/body/vertex_samples.hpp>

#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/gaussian/rigid_pieces.hpp>
#include <gsh/gaussian/sh_fit.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>

#include <gsh/field/features.hpp>
#include <gsh/field/frequency.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/hash_level.hpp>
#include <gsh/field/mlp.hpp>

#include <gsh/image/chroma.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/reduce.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/image/trimap.hpp>

#include <gsh/optim/adam.hpp>
#include <gsh/optim/schedule.hpp>

#include <gsh/light/coarse_caster.hpp>
#include <gsh/light/environment.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/light_buffers.hpp>
#include <gsh/light/lit_element.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_frame.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/shadow_triangle.hpp>
#include <gsh/light/surface_light.hpp>

#include <gsh/render/arithmetic.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/render/target.hpp>
#include <gsh/render/tiles.hpp>

#include <gsh/prior/bilateral_solver.hpp>
#include <gsh/prior/estimated_view.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/prior/normal_integration.hpp>
#include <gsh/prior/orthographic_camera.hpp>
#include <gsh/prior/prior_features.hpp>
#include <gsh/prior/prior_view.hpp>

#include <gsh/loss/lpips.hpp>
#include <gsh/loss/lpips_network.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/motion_terms.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/loss/ssim.hpp>

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/avatar_part.hpp>
#include <gsh/avatar/colored_mesh.hpp>
#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/moving_pieces.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/poser.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_element.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/avatar/still_frames.hpp>

#include <gsh/pipeline/appearance.hpp>
#include <gsh/pipeline/avatar_config.hpp>
#include <gsh/pipeline/avatar_model.hpp>
#include <gsh/pipeline/backdrop.hpp>
#include <gsh/pipeline/canonical_points.hpp>
#include <gsh/pipeline/configured_avatar.hpp>
#include <gsh/pipeline/density_control.hpp>
#include <gsh/pipeline/density_descent.hpp>
#include <gsh/pipeline/field_appearance.hpp>
#include <gsh/pipeline/field_shadow.hpp>
#include <gsh/pipeline/frame_codes.hpp>
#include <gsh/pipeline/learned_array.hpp>
#include <gsh/pipeline/learned_field.hpp>
#include <gsh/pipeline/learned_light.hpp>
#include <gsh/pipeline/part_size.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/pipeline/photo_gain.hpp>
#include <gsh/pipeline/photo_loss.hpp>
#include <gsh/pipeline/photo_pixels.hpp>
#include <gsh/pipeline/reduced_photos.hpp>
#include <gsh/pipeline/shadow.hpp>
#include <gsh/pipeline/shared_field.hpp>
#include <gsh/pipeline/splat_scene.hpp>
#include <gsh/pipeline/split_appearance.hpp>
#include <gsh/pipeline/static_model.hpp>

#include <gsh/train/avatar_export.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/canonical_setup.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/estimated_motion.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/frame_increments.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/light_estimate.hpp>
#include <gsh/train/light_samples.hpp>
#include <gsh/train/memory.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/posed_priors.hpp>
#include <gsh/train/refinement.hpp>
#include <gsh/train/refinement_config.hpp>
#include <gsh/train/refinement_tables.hpp>
#include <gsh/train/region_labels.hpp>
#include <gsh/train/registration.hpp>
#include <gsh/train/setting.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/static_configuration.hpp>
#include <gsh/train/static_start.hpp>
#include <gsh/train/step_history.hpp>
#include <gsh/train/train_config.hpp>
#include <gsh/train/trainer.hpp>

#include <gsh/cpu.hpp>

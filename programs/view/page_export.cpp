// SPDX-License-Identifier: Apache-2.0
#include "view/page_export.hpp"

#include "common/interrupts.hpp"
#include "common/messages.hpp"
#include "common/progress.hpp"
#include "view/motion_occlusion.hpp"
#include "view/view_package.hpp"
#include "view/view_page.hpp"
#include "view/view_scene.hpp"

#include <gsh/avatar/avatar_part.hpp>
#include <gsh/avatar/coarser_avatar.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/math/low_rank.hpp>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::programs {

namespace {

/// The chosen frames of a motion.
Motion frames_of_motion(const Motion& motion, const std::vector<std::size_t>& frames) {
    Motion part;
    part.joint_count = motion.joint_count, part.expression_count = motion.expression_count, part.betas = motion.betas;
    for (const std::size_t f : frames) {
        const auto pose = motion.pose_at(f);
        const auto expression = motion.expression_at(f);
        part.pose.insert(part.pose.end(), pose.begin(), pose.end());
        part.expression.insert(part.expression.end(), expression.begin(), expression.end());
        part.transl.push_back(motion.transl[f]), part.timestamps.push_back(motion.timestamps[f]);
    }
    return part;
}

/// Keeps the frames that --frame or --frames name.
void keep_frames(Motion& motion, const ExportOptions& o) {
    const std::size_t count = motion.frame_count();
    motion = frames_of_motion(motion, o.frame ? std::vector{chosen_frame(o, count)} : frames_of(o.frames, count));
}

/// Keeps the Gaussians and bands that --gaussians, --largest and --sh ask for.
void keep_gaussians(ViewScene& scene, const ExportOptions& o) {
    GaussianCloud<float>& cloud = scene.people ? scene.people->data[0].gaussians : scene.cloud;
    if (o.gaussians) {
        cpu::Threads backend(o.threads);
        if (scene.people)
            scene.people->data[0] = coarser_avatar(backend, scene.people->data[0], *o.gaussians);
        else
            cloud = coarser_cloud(backend, cloud, *o.gaussians);
    }
    if (o.largest) {
        const std::vector<std::uint32_t> kept = largest_gaussians(cloud, *o.largest);
        if (scene.people)
            scene.people->data[0] = avatar_part(scene.people->data[0], Span<const std::uint32_t>(kept));
        else
            cloud = reordered(cloud, Span<const std::uint32_t>(kept));
    }
    if (o.sh_degree) cloud = with_bands_up_to(std::move(cloud), *o.sh_degree);
}

/// Says by how much the ambient occlusion of a page departs from the avatar's.
void warn_of_occlusion(const ExportOptions& o, const LowRank& occlusion) {
    char text[128];
    std::snprintf(text, sizeof text, ": ambient occlusion departs by %.4f of white, expected at most %.4f",
                  occlusion.error, occlusion_tolerance);
    warn(o.to.string() + text + "; there are too many different poses for one page, leave out motions");
}

} // namespace

ExportResult export_page(const ExportOptions& o) {
    std::vector<std::string> warnings;
    ViewScene scene = load_view_scene({o.input}, o.poses, o.light, o.rig, warnings, o.input_up);
    for (const std::string& warning : warnings) warn(warning);
    watch_interrupts();
    const Progress shown("exporting");
    keep_gaussians(scene, o);
    if (o.frame || o.is_moving()) keep_frames(scene.motions[0][0].motion, o);
    std::optional<LowRank> occlusion;
    if (scene.people && scene.people->data[0].occlusion_field) {
        cpu::Threads backend(o.threads);
        occlusion = occlusion_of_motions(backend, scene.people->data[0], scene.motions[0]);
        if (interrupted) return {};
        if (occlusion->error > occlusion_tolerance) warn_of_occlusion(o, *occlusion);
    }
    const LowRank* const follows = occlusion ? &*occlusion : nullptr;
    std::vector<PageData> data{{"scene", describe(scene)},
                               {"gaussians", package_scene(scene, ScenePacking::compact, follows)}};
    std::size_t row = 0;
    if (scene.people)
        for (std::size_t m = 0; m < scene.motions[0].size(); ++m) {
            const ViewMotion& motion = scene.motions[0][m];
            data.push_back({"motion-0-" + std::to_string(m), package_motion(motion, {}, follows, row)});
            row += motion.motion.frame_count();
        }
    const std::string page = make_page(data);
    if (interrupted) return {};
    write_file(o.to, page);
    return {o.to, scene.people ? scene.people->data[0].gaussians.size() : scene.cloud.size(), 1};
}

} // namespace gsh::programs

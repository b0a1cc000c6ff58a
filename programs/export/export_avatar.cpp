// SPDX-License-Identifier: Apache-2.0
#include "export/export_avatar.hpp"

#include "common/input_files.hpp"
#include "common/interrupts.hpp"
#include "common/messages.hpp"
#include "common/progress.hpp"
#include "export/still_writer.hpp"
#include "show/shown_people.hpp"

#include <gsh/avatar/avatar_part.hpp>
#include <gsh/avatar/coarser_avatar.hpp>
#include <gsh/avatar/moving_pieces.hpp>
#include <gsh/avatar/still_frames.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/file/atomic_folder.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/model/gltf_mesh.hpp>
#include <gsh/io/splat/any_splats.hpp>
#include <gsh/io/splat/gltf_pieces.hpp>
#include <gsh/io/splat/usda.hpp>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

namespace gsh::programs {

namespace {

constexpr int default_clusters = 512;

/// An avatar in its motion, with the Gaussians and in the order that the options and the format ask for.
struct Exported {
    ShownPeople people;
    std::vector<std::size_t> frames;
    cpu::Threads backend;

    Exported(const ExportOptions& o, const FormatTraits& traits)
        : people({o.input}, o.poses, o.light, !o.as_stored && !o.poses.empty(), o.rig), backend(o.threads) {
        AvatarData& avatar = people.data[0];
        if (o.gaussians) avatar = coarser_avatar(backend, avatar, *o.gaussians);
        if (o.largest)
            avatar = avatar_part(avatar, Span<const std::uint32_t>(largest_gaussians(avatar.gaussians, *o.largest)));
        if (const auto order = order_for(traits, avatar.gaussians); !order.empty())
            avatar = avatar_part(avatar, Span<const std::uint32_t>(order));
        const std::size_t count = motion().frame_count();
        frames = o.is_moving() ? frames_of(o.frames, count) : std::vector{chosen_frame(o, count)};
    }

    [[nodiscard]] const AvatarData& avatar() const { return people.data[0]; }
    [[nodiscard]] const Motion& motion() const { return people.motions[0]; }
    /// Seconds of the frames, from 0. Frames without ascending times have 30 a second.
    [[nodiscard]] std::vector<double> times() const {
        std::vector<double> seconds;
        for (const std::size_t f : frames) seconds.push_back(motion().timestamps[f] - motion().timestamps[frames[0]]);
        const bool ascend = std::adjacent_find(seconds.begin(), seconds.end(), std::greater_equal<>()) == seconds.end();
        for (std::size_t k = 0; k < frames.size() && !ascend; ++k)
            seconds[k] = static_cast<double>(frames[k] - frames[0]) / 30;
        return seconds;
    }
};

StillFrames<cpu::Threads> still_frames(Exported& exported, const ExportOptions& o) {
    return StillFrames<cpu::Threads>(exported.backend, exported.avatar(), {.sh_degree = o.sh_degree.value_or(3)});
}

std::string frame_name(std::size_t number, const FormatTraits& traits) {
    char name[32];
    std::snprintf(name, sizeof name, "frame_%04zu", number);
    return name + std::string(traits.ending);
}

/// Numbered files of an earlier sequence, in any format.
bool is_frame_file(const std::string& name) {
    return name.starts_with("frame_") && format_of(name).has_value();
}

/// Calls write(k, Gaussians) for each frame k, with a line of progress. Returns false after an interrupt.
template <class Write>
bool write_frames(const Exported& exported, StillFrames<cpu::Threads>& still, const Write& write) {
    Progress progress("exporting");
    for (std::size_t k = 0; k < exported.frames.size(); ++k) {
        if (interrupted) return false;
        write(k, still.frame(exported.motion(), exported.frames[k]));
        progress.show(static_cast<double>(k + 1) / static_cast<double>(exported.frames.size()),
                      "frame " + std::to_string(exported.frames[k]));
    }
    return true;
}

ExportResult write_sequence(Exported& exported, const ExportOptions& o, const FormatTraits& traits) {
    AtomicFolder folder(without_ending(o.to, traits), is_frame_file);
    auto still = still_frames(exported, o);
    StillWriter writer(o, traits, exported.avatar().filter);
    const bool all = write_frames(exported, still, [&](std::size_t k, const GaussianCloud<float>& cloud) {
        writer.write(folder.file(frame_name(k, traits)), cloud);
    });
    if (!all) return {};
    folder.commit();
    return {folder.path(), still.size(), exported.frames.size(), writer.losses()};
}

ExportResult write_still(Exported& exported, const ExportOptions& o, const FormatTraits& traits) {
    auto still = still_frames(exported, o);
    StillWriter writer(o, traits, exported.avatar().filter);
    const GaussianCloud<float> cloud = still.frame(exported.motion(), exported.frames[0]);
    if (interrupted) return {};
    writer.write(o.to, cloud);
    return {o.to, still.size(), 1, writer.losses()};
}

ExportResult write_pieces(Exported& exported, const ExportOptions& o) {
    auto still = still_frames(exported, o);
    Progress progress("exporting");
    const MovingPieces pieces =
        moving_pieces(exported.backend, still, exported.motion(), Span<const std::size_t>(exported.frames),
                      {.pieces = static_cast<std::size_t>(o.clusters.value_or(default_clusters))}, [&](double share) {
                          progress.show(share, "rigid pieces");
                          return !interrupted;
                      });
    progress.finish();
    if (pieces.poses.empty()) return {};
    write_gltf_pieces(o.to, pieces, exported.times(), exported.avatar().filter);
    return {o.to, still.size(), 1};
}

ExportResult write_mesh(Exported& exported, const ExportOptions& o) {
    // Without --frames the mesh is at rest, unless a frame is named.
    const bool moves = o.is_moving() || o.frame;
    const std::vector<double> times = exported.times();
    const Span<const std::size_t> frames(exported.frames);
    if (interrupted) return {};
    write_gltf_mesh(o.to, exported.avatar(), exported.motion(), frames.subspan(0, moves ? frames.size() : 0),
                    Span<const double>(times).subspan(0, moves ? times.size() : 0));
    return {o.to, exported.avatar().gaussians.size(), 1};
}

ExportResult write_compact(const Exported& exported, const ExportOptions& o) {
    AvatarData avatar = avatar_of_file(o.input); // with the light as trained, not as moved to a motion
    if (o.largest || o.gaussians) {
        auto light = std::move(avatar.light);
        avatar = exported.avatar(), avatar.light = std::move(light);
    }
    avatar.gaussians = with_bands_up_to(std::move(avatar.gaussians), o.sh_degree.value_or(4));
    if (interrupted) return {};
    save_avatar(o.to, avatar, ArrayStorage::compact);
    return {o.to, avatar.gaussians.size(), 1};
}

ExportResult write_usda(Exported& exported, const ExportOptions& o) {
    const std::vector<double> times = exported.times();
    const double rate = times.size() > 1 ? static_cast<double>(times.size() - 1) / times.back() : 30;
    auto still = still_frames(exported, o);
    UsdaSplats file(o.to, exported.avatar().filter, rate);
    if (!write_frames(exported, still, [&](std::size_t, const GaussianCloud<float>& cloud) { file.add(cloud); }))
        return {};
    file.commit();
    return {o.to, still.size(), 1};
}

} // namespace

ExportResult export_avatar_file(const ExportOptions& o, const FormatTraits& traits) {
    Exported exported(o, traits);
    watch_interrupts();
    if (traits.kind == ExportKind::avatar) return write_compact(exported, o);
    if (o.mesh) return write_mesh(exported, o);
    if (!o.is_moving()) return write_still(exported, o, traits);
    if (!traits.splats->holds_motion) return write_sequence(exported, o, traits);
    return traits.is(SplatFormat::usda) ? write_usda(exported, o) : write_pieces(exported, o);
}

std::vector<std::uint32_t> order_for(const FormatTraits& traits, const GaussianCloud<float>& cloud) {
    return traits.splats && traits.splats->order ? traits.splats->order(cloud) : std::vector<std::uint32_t>();
}

std::optional<std::uintmax_t> bytes_of(const std::filesystem::path& path) {
    std::error_code error;
    if (!std::filesystem::is_directory(path, error)) {
        const std::uintmax_t bytes = std::filesystem::file_size(path, error);
        return error ? std::nullopt : std::optional(bytes);
    }
    std::uintmax_t sum = 0;
    (void)gsh::detail::for_each_name(path, [&](std::string_view name) { sum += bytes_of(path / name).value_or(0); });
    return sum;
}

} // namespace gsh::programs

// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes Gaussians as glTF (.glb) with the extension KHR_gaussian_splatting.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/gltf_gaussians.hpp>
#include <gsh/io/splat/gltf_primitive.hpp>
#include <gsh/io/splat/gltf_scales.hpp>
#include <gsh/io/splat/linear_colors.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Writes a cloud as one node, atomically. glTF has y up, as gsh has. The document states author and filter.
///
/// Errors  ValueError for an empty cloud or SH above degree 3; IoError for more than 4 GiB.
inline void write_gltf_splats(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                              std::optional<PixelFilter> filter = {}) {
    GlbWriter file;
    begin_gltf_splats(file, {.filter = filter});
    const GltfSplatArrays arrays(file, cloud);
    file.json["scenes"] = {{{"nodes", {0}}}};
    file.json["nodes"] = {{{"name", "gaussians"}, {"mesh", 0}}};
    nlohmann::ordered_json primitives = nlohmann::ordered_json::array();
    primitives.push_back(arrays.primitive(0, cloud.size()));
    file.json["meshes"] = nlohmann::ordered_json::array();
    file.json["meshes"].push_back({{"primitives", std::move(primitives)}});
    file.write(path);
}

/// Reads all Gaussians that the scene of a glTF file (.glb, .gltf) shows, in the world, in the order of its nodes and
/// of their instances (EXT_mesh_gpu_instancing). Other meshes are left out. With a time in seconds, nodes are where the
/// first animation has them. A node without a size (a scale of 0 on all axes) shows nothing.
///
/// Scales are lengths. In files of the extension's draft of January 2026 they are logarithms: if any is negative, all
/// of the file are read as such. Colours in linear light are converted to sRGB. Both are said in the warnings.
///
/// Errors  IoError for a file that is damaged, requires an extension that is not read, shows no Gaussians, or more than
///         2 GiB of them (512 MiB in a small file whose nodes share meshes), and for nodes that flatten them;
///         ValueError for values that no Gaussian has.
[[nodiscard]] inline StillSplats read_gltf_splats(const InputFile& input, std::optional<double> time = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The maps of a node's instances (EXT_mesh_gpu_instancing) in its frame; of a node without the extension, one that
/// moves nothing.
[[nodiscard]] inline std::vector<Affine<double>> gltf_instances(const GltfFile& file, GltfNumbers& numbers,
                                                                const tinygltf::Node& node, const std::string& where) {
    const auto extension = node.extensions.find("EXT_mesh_gpu_instancing");
    if (extension == node.extensions.end()) return {Affine<double>()};
    const std::string what = where + ": EXT_mesh_gpu_instancing";
    if (!extension->second.Has("attributes") || !extension->second.Get("attributes").IsObject())
        file.fail(what + " has no attributes");
    const tinygltf::Value& attributes = extension->second.Get("attributes");
    std::size_t count = 0;
    const auto read = [&](const char* name, int width) {
        std::vector<double> values;
        if (!attributes.Has(name)) return values;
        if (!attributes.Get(name).IsInt()) file.fail(what + ": " + name + " is not an index");
        values = numbers.read(attributes.Get(name).Get<int>(), width, what + ": " + name);
        const std::size_t found = values.size() / static_cast<std::size_t>(width);
        if (count != 0 && found != count)
            file.fail(what + ": " + name + " has " + std::to_string(found) + " elements, but another attribute " +
                      std::to_string(count));
        count = found;
        return values;
    };
    const auto places = read("TRANSLATION", 3), turns = read("ROTATION", 4), sizes = read("SCALE", 3);
    std::vector<Affine<double>> maps(std::max<std::size_t>(count, 1));
    for (std::size_t i = 0; i < count; ++i) {
        GltfTransform own;
        const auto three = [i](const std::vector<double>& v) {
            return vec3<double>(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
        };
        if (!places.empty()) own.translation = three(places);
        if (!sizes.empty()) own.scale = three(sizes);
        if (!turns.empty())
            own.rotation =
                GltfTransform::rotation_of({turns[4 * i], turns[4 * i + 1], turns[4 * i + 2], turns[4 * i + 3]});
        maps[i] = own.matrix();
    }
    return maps;
}

/// The Gaussians that a file shows: those of each primitive once, however many nodes show it.
class GltfShownSplats {
public:
    GltfShownSplats(const GltfFile& file, const GltfNodes& nodes, std::optional<double> time)
        : file_(file), nodes_(nodes), numbers_(file, most_numbers(file)) {
        const tinygltf::Model& model = file_.model();
        GltfNodes::Channels channels;
        if (time && !model.animations.empty()) channels = nodes_.channels(model.animations[0], numbers_, "animation 0");
        const auto maps = nodes_.world_maps(channels, time.value_or(0));
        for (std::size_t n = 0; n < maps.size(); ++n)
            if (maps[n] && model.nodes[n].mesh != -1) show(n, model.nodes[n].mesh, *maps[n]);
        finish_scales();
        if (linear_)
            warn("colours are in linear light (lin_rec709_display) and were converted to sRGB, in which gsh blends; "
                 "where "
                 "Gaussians overlap, the picture differs from a blend in linear light" +
                 (color_error_ > 0.5 / 255
                      ? ", and SH bands by " + number_text(255 * color_error_) + " of 255 steps (root mean square)"
                      : ""));
    }

    /// All of them, in the world.
    [[nodiscard]] GaussianCloud<float> cloud() const {
        std::size_t count = 0;
        int degree = 0;
        for (const Piece& piece : pieces_)
            count += piece.cloud->size(), degree = std::max(degree, piece.cloud->sh_degree);
        if (count == 0) file_.fail("shows no Gaussians (KHR_gaussian_splatting)");
        const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
        if (const std::size_t most = most_numbers(file_) / (11 + 3 * basis); count > most)
            file_.fail("shows " + std::to_string(count) + " Gaussians, expected at most " + std::to_string(most) +
                       " in a file of its size");
        GaussianCloud<float> all(0, degree);
        all.means.reserve(count), all.quats.reserve(count), all.log_scales.reserve(count);
        all.opacity_logits.reserve(count), all.sh.reserve(count * basis);
        for (const Piece& piece : pieces_) append(all, moved(piece));
        return all;
    }
    /// Each with the file's name.
    [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }

private:
    struct Piece {
        const GaussianCloud<float>* cloud;
        Affine<double> map;
        std::size_t node;
    };
    const GltfFile& file_;
    const GltfNodes& nodes_;
    GltfNumbers numbers_;
    std::map<std::pair<int, std::size_t>, GaussianCloud<float>> clouds_; ///< by mesh and primitive
    std::vector<Piece> pieces_;
    std::vector<std::string> warnings_;
    bool linear_ = false;
    double color_error_ = 0; ///< the largest of a primitive

    void warn(const std::string& what) { warnings_.push_back(file_.name() + ": " + what); }

    /// A file holds a number in a byte or more. Where nodes share meshes, or primitives accessors, a small file could
    /// show any number of Gaussians: it may show 512 MiB, and a large one 2 GiB at most.
    [[nodiscard]] static std::size_t most_numbers(const GltfFile& file) {
        std::size_t bytes = 0;
        for (const auto& buffer : file.model().buffers) bytes += buffer.data.size();
        return std::clamp(bytes, std::size_t(1) << 27, std::size_t(1) << 29);
    }

    void show(std::size_t node, int mesh, const Affine<double>& map) {
        const auto& meshes = file_.model().meshes;
        const std::string place = "node " + std::to_string(node);
        file_.check_index(mesh, meshes.size(), place + ": mesh");
        const auto& primitives = meshes[static_cast<std::size_t>(mesh)].primitives;
        std::vector<Affine<double>> instances;
        for (std::size_t p = 0; p < primitives.size(); ++p) {
            const auto extension = primitives[p].extensions.find("KHR_gaussian_splatting");
            if (extension == primitives[p].extensions.end()) continue;
            if (instances.empty()) instances = gltf_instances(file_, numbers_, file_.model().nodes[node], place);
            const auto [found, is_new] = clouds_.try_emplace({mesh, p});
            if (is_new) found->second = decoded(primitives[p], extension->second, "mesh " + std::to_string(mesh));
            for (const Affine<double>& instance : instances)
                if (const Affine<double> whole = map * instance; whole.linear != mat3<double>(0.0))
                    pieces_.push_back({&found->second, whole, node});
        }
    }

    [[nodiscard]] GaussianCloud<float> decoded(const tinygltf::Primitive& primitive, const tinygltf::Value& extension,
                                               const std::string& where) {
        const GltfSplatTraits traits(file_, extension, where);
        for (const std::string& warning : traits.warnings) warn(warning);
        GaussianCloud<float> cloud = gaussians_of_primitive(file_, numbers_, primitive, traits, where);
        if (traits.linear_colors) linear_ = true, color_error_ = std::max(color_error_, convert_linear_colors(cloud));
        return cloud;
    }

    void finish_scales() {
        bool logarithms = false, perhaps = false;
        for (const auto& [place, cloud] : clouds_)
            logarithms = logarithms || has_negative_scale(cloud), perhaps = perhaps || may_be_logarithms(cloud);
        for (auto& [place, cloud] : clouds_) finish_gltf_scales(cloud, logarithms);
        if (logarithms)
            warn("has negative scales, so all of its scales are read as logarithms, as in the draft of "
                 "KHR_gaussian_splatting of January 2026");
        else if (perhaps)
            warn("has scales that are small beside the distances between Gaussians; they are read as lengths, but may "
                 "be "
                 "the logarithms of the draft of KHR_gaussian_splatting of January 2026");
    }

    [[nodiscard]] GaussianCloud<float> moved(const Piece& piece) const {
        const std::string where = "node " + std::to_string(piece.node);
        if (const double volume = determinant(piece.map.linear); !(volume < 0 || volume > 0))
            file_.fail(where + " flattens its Gaussians, or is not finite; expected scales that are not 0");
        GaussianCloud<float> cloud = *piece.cloud;
        if (piece.map.linear == mat3<double>(1.0))
            for (vec3<float>& mean : cloud.means) mean = vec3<float>(vec3<double>(mean) + piece.map.translation);
        else
            move_cloud(cloud, piece.map);
        check_writable(file_.name() + ": " + where, cloud);
        return cloud;
    }

    /// Degrees that a cloud does not have are zeros.
    static void append(GaussianCloud<float>& all, const GaussianCloud<float>& cloud) {
        const auto add = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
        add(all.means, cloud.means);
        add(all.quats, cloud.quats);
        add(all.log_scales, cloud.log_scales);
        add(all.opacity_logits, cloud.opacity_logits);
        const auto basis = static_cast<std::size_t>(sh_basis_count(all.sh_degree)),
                   width = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        for (std::size_t i = 0; i < cloud.size(); ++i)
            for (std::size_t k = 0; k < basis; ++k)
                all.sh.push_back(k < width ? cloud.sh[i * width + k] : vec3<float>(0));
    }
};

} // namespace detail

inline StillSplats read_gltf_splats(const InputFile& input, std::optional<double> time) {
    const detail::GltfFile file(input, detail::GltfParts::meshes);
    const detail::GltfNodes nodes(file);
    const detail::GltfShownSplats shown(file, nodes, time);
    return {shown.cloud(), detail::notes_of_gltf(file), shown.warnings()};
}

} // namespace gsh

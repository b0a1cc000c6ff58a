// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include <gsh/io/splat/any_splats.hpp>

namespace gsh::fuzz {

namespace {

/// Draws what a reader accepted, and writes small clouds again as PLY, which holds every float.
void read_and_use(const InputFile& file) {
    const StillSplats splats = load_any_splats(file);
    use(splats.cloud); // also one without Gaussians, which PLY may hold, and programs refuse
    if (splats.cloud.size() > 500) return;
    must_come_back(
        "cloud.ply", splats.cloud,
        [](const auto& path, const GaussianCloud<float>& cloud) { write_gaussian_ply(path, cloud); },
        [](const auto& path) { return read_gaussian_ply(path); });
}

const Registered ply_target("ply", "a.ply", read_and_use);
const Registered compressed_ply_target("compressed-ply", "a.compressed.ply", read_and_use);
const Registered spz_target("spz", "a.spz", read_and_use);
const Registered splat_target("splat", "a.splat", read_and_use);
const Registered glb_splats_target("glb-splats", "a.glb", read_and_use);
const Registered gltf_splats_target("gltf-splats", "a.gltf", read_and_use);

} // namespace

} // namespace gsh::fuzz

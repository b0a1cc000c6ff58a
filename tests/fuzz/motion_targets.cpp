// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include "support/skeleton_body.hpp"

#include <gsh/body/joint_names.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/gltf_export.hpp>
#include <gsh/io/motion/joint_map_file.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::fuzz {

namespace {

/// Loads a motion of any layout, poses the body with it, and writes it again.
void read_stored(const InputFile& file, const BodyModel& body) {
    std::vector<std::string> warnings;
    const Motion motion = load_any_motion(file, body, {}, &warnings);
    use(motion, body);
    must_come_back("motion.npz", motion, save_motion,
                   [&](const std::filesystem::path& path) { return load_motion(path, body); });
    check_warnings(warnings);
}

/// The same, and upright.
void read_motion(const InputFile& file, const BodyModel& body) {
    read_stored(file, body);
    std::vector<std::string> warnings;
    MotionFileOptions options;
    options.world = MotionFileOptions::World::upright;
    use(load_any_motion(file, body, options, &warnings), body);
    check_warnings(warnings);
}
void read_for_smplx(const InputFile& file) {
    read_motion(file, small_smplx());
}
void read_for_smpl(const InputFile& file) {
    read_motion(file, small_smpl());
}

/// The same for another rig's motion, which is retargeted, and is also written as a rig's.
void read_rig(const InputFile& file) {
    read_stored(file, test::skeleton_body());
    if (read_file(file).size() % 4 != 0) return; // what follows takes long, so that one size in four is enough
    const std::optional<MotionLayout> layout = recognise_motion(file);
    const std::optional<RigMotion> rig = load_rig_motion(file, *layout);
    if (!rig) return;
    const std::filesystem::path bvh = scratch() / "rig.bvh", glb = scratch() / "rig.glb";
    try {
        save_bvh(bvh, *rig);
        save_gltf_motion(glb, *rig);
    } catch (const Error&) {
        return; // a rig that these formats do not hold
    }
    for (const auto& [path, frames] :
         {std::pair(bvh, load_bvh(bvh).frame_count()), std::pair(glb, load_gltf_motion(glb).frame_count())})
        must(frames == rig->frame_count(), "a rig's motion that is written and read again has other frames");
}

const Registered motion_target("motion", "a.npz", read_for_smplx);
const Registered motion_smpl_target("motion-smpl", "a.npz", read_for_smpl);
const Registered amass_target("amass", "a.npz", read_for_smplx);
const Registered smplifyx_target("smplifyx", "a.npz", read_for_smplx);
const Registered snapshot_target("snapshot-poses", "a.npz", read_for_smpl);
const Registered sam3d_target("sam3d", "a.npz", read_rig);
const Registered bvh_target("bvh", "a.bvh", read_rig);
const Registered glb_motion_target("glb-motion", "a.glb", read_rig);
const Registered gltf_motion_target("gltf-motion", "a.gltf", read_rig);
const Registered smplx_json_target("smplx-json", "a/", read_for_smplx);
const Registered easymocap_target("easymocap-poses", "a/", read_for_smpl);
const Registered npz_frames_target("npz-frames", "a/", read_for_smplx);

const Registered gala_target("gala-poses", "a/", [](const InputFile& folder) {
    const std::filesystem::path model = folder.path() / "model";
    std::vector<std::string> warnings;
    const GalaRig rig = load_gala_rig(model, &warnings);
    use(rig.body);
    read_motion(folder.path() / "scene", rig.body);
    check_warnings(warnings);
});

const Registered joint_map_target("joint-map", "a.json", [](const InputFile& file) {
    for (const auto& [name, joint] : read_joint_map(file).named)
        must(joint.empty() || smplx_joint(joint) >= 0, "a joint map names no joint of SMPL-X");
});

} // namespace

} // namespace gsh::fuzz

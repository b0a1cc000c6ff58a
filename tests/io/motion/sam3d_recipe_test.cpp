// SPDX-License-Identifier: Apache-2.0
/// @file  Runs the program in docs/captures.md that writes motions of SAM 3D Body, with stand-ins for its libraries.

#include "io/temporary.hpp"
#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"
#include "support/skip.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/any_motion.hpp>

#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

/// torch, roma and SAM 3D Body's set-up, as far as the program calls them. The numbers come from rig.npz.
constexpr const char* torch_module = R"python(
import types, numpy as np
class Tensor(np.ndarray):
    def numpy(self): return np.asarray(self)
def tensor(array): return np.asarray(array, dtype=np.float32).view(Tensor)
def zeros(*shape): return tensor(np.zeros(shape))
class Rig:
    data = np.load("rig.npz")
    parents = np.array(data["parents"]).view(Tensor)
    character_torch = types.SimpleNamespace(skeleton=types.SimpleNamespace(joint_parents=parents))
    def get_joint_names(self): return [str(name) for name in self.data["names"]]
    def __call__(self, identity, parameters, expression):
        assert identity.shape == (1, 45) and parameters.shape == (1, 204) and expression.shape == (1, 72)
        return tensor(np.zeros((1, 3, 3))), tensor(self.data["state"])[None]
jit = types.SimpleNamespace(load=lambda path, map_location: Rig())
)python";
constexpr const char* roma_module = R"python(
import numpy as np, torch
def unitquat_to_rotmat(q):
    x, y, z, w = np.moveaxis(np.asarray(q), -1, 0)
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),
            1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x),
            1 - 2 * (x * x + y * y)]
    return torch.tensor(np.stack(rows, -1).reshape(-1, 3, 3))
)python";
constexpr const char* setup_module = R"python(
import numpy as np
class Estimator:
    data = np.load("rig.npz")
    def process_one_image(self, file):
        t = int(file.split("/")[-1].split(".")[0])
        keys = ("pred_joint_coords", "pred_global_rots", "pred_cam_t")
        return [{key: self.data[key][t].astype(np.float32) for key in keys} | {"mask": None}]
def setup_sam_3d_body(hf_repo_id): return Estimator()
)python";

/// The page's block of Python with `word` in it.
std::string block_of_page(const std::string& word) {
    const std::string page = read_file(fs::path(GSH_SOURCE_DIR) / "docs/captures.md"), fence = "```python\n";
    for (std::size_t at = page.find(fence); at != std::string::npos; at = page.find(fence, at + 1)) {
        const std::size_t begin = at + fence.size();
        const std::string block = page.substr(begin, page.find("```", begin) - begin);
        if (block.find(word) != std::string::npos) return block;
    }
    return {};
}

bool run_shell(const std::string& command, const fs::path& output) {
    return std::system((command + " >'" + output.string() + "' 2>&1").c_str()) == 0;
}

void three(std::vector<double>& to, const vec3<double>& v) {
    to.insert(to.end(), {v.x, v.y, v.z});
}

} // namespace

TEST_CASE("the page's program writes a motion that the body follows") {
    const test::Temporary folder;
    const fs::path said = folder / "said.txt";
    std::string python;
    for (const char* command : {"python3", "/usr/bin/python3"})
        if (python.empty() && run_shell(std::string(command) + " -c 'import numpy'", said)) python = command;
    if (python.empty()) {
        test::skip("there is no python3 with NumPy");
        return;
    }
    const std::string program = block_of_page("pred_global_rots");
    REQUIRE(!program.empty());
    fs::create_directories(folder / "notebook");
    fs::create_directories(folder / "frames");
    write_file(folder / "torch.py", torch_module);
    write_file(folder / "roma.py", roma_module);
    write_file(folder / "notebook/__init__.py", "");
    write_file(folder / "notebook/utils.py", setup_module);
    write_file(folder / "recipe.py", program);

    const test::SampleOptions o{.names = test::Names::mhr, .rest = test::Rest::A, .spine = 4};
    const auto sample = test::sample_rig(o);
    const std::size_t J = sample.names.size(), T = sample.root.size();
    test::Rng rng(6);
    std::vector<double> state, joints, rotations, camera;
    std::vector<mat3<double>> axes;
    for (std::size_t j = 0; j < J; ++j) {
        const quat<double> q = normalize(rng.quat());
        axes.push_back(rotation_matrix(q));
        three(state, sample.rest[j] * 100.0); // centimetres
        state.insert(state.end(), {q.x, q.y, q.z, q.w, 1.0});
    }
    for (std::size_t t = 0; t < T; ++t) {
        write_file(folder / ("frames/000" + std::to_string(t) + ".jpg"), "");
        const auto pose = test::pose_of(sample, t, "ZXY");
        for (std::size_t j = 0; j < J; ++j) {
            const vec3<double> x = pose.joints[j] - sample.root[t];
            three(joints, {x.x, -x.y, -x.z});
            const mat3<double> R = pose.rotations[j] * axes[j];
            for (int row = 0; row < 3; ++row) three(rotations, {R[0][row], R[1][row], R[2][row]});
        }
        three(camera, {sample.root[t].x, -sample.root[t].y, -sample.root[t].z});
    }
    NpzWriter rig(folder / "rig.npz");
    rig.add_texts("names", sample.names);
    rig.add("parents", std::vector<std::int64_t>(sample.parents.begin(), sample.parents.end()));
    rig.add("state", state, {J, 8});
    rig.add("pred_joint_coords", joints, {T, J, 3});
    rig.add("pred_global_rots", rotations, {T, J, 3, 3});
    rig.add("pred_cam_t", camera, {T, 3});
    rig.commit();
    const bool done = run_shell("cd '" + (folder / "").string() + "' && PYTHONPATH=. " + python + " recipe.py", said);
    INFO(read_file(said));
    REQUIRE(done);
    MotionFileOptions options;
    options.world = MotionFileOptions::World::upright;
    const Motion motion = load_any_motion(folder / "motion.npz", test::skeleton_body(), options);
    const auto errors =
        test::compare(sample, "ZXY", o, motion, test::skeleton_body(), joint_names_of(test::skeleton_body()));
    CHECK(errors.limbs < 0.01); // degrees; the predictions are floats
    CHECK(errors.trunk < 0.01);
    CHECK(errors.hips < 1e-4);
}

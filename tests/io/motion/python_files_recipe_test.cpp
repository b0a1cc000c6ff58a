// SPDX-License-Identifier: Apache-2.0
/// @file  Runs the program in docs/captures.md that converts files of Python programs, on pickles and .npy files.

#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/skip.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/any_motion.hpp>

#include <cstdlib>
#include <filesystem>
#include <string>

using namespace gsh;

namespace {

/// A motion of two frames in the forms of estimators: one dictionary by pickles of all protocols and in an .npy file,
/// and a dictionary for each person with poses in the camera's frame and in the world's.
constexpr const char* python_maker = R"python(
import pickle, sys, numpy as np
rows = lambda width, value: np.full((2, width), value, np.float32)
motion = {"global_orient": rows(3, 0.25), "body_pose": rows(63, 0.125), "transl": rows(3, 0.5), "betas": np.zeros(3), "name": {}}
for protocol in range(6):
    pickle.dump(motion, open(f"p{protocol}.pkl", "wb"), protocol)
np.save("dictionary.npy", motion, allow_pickle=True)
np.savez("object.npz", params=np.array(motion, dtype=object))
people = {0: {"pose_world": rows(72, 0.125), "trans_world": rows(3, 0.5), "pose": rows(72, 9), "trans": rows(3, 9), "betas": np.zeros((2, 3))}}
pickle.dump(people, open("people.pkl", "wb"))
)python";

/// The page's block of Python that reads files of PyTorch.
std::string python_recipe() {
    const std::string page = read_file(std::filesystem::path(GSH_SOURCE_DIR) / "docs/captures.md");
    const std::string fence = "```python\n";
    for (std::size_t at = page.find(fence); at != std::string::npos; at = page.find(fence, at + 1)) {
        const std::size_t begin = at + fence.size(), end = page.find("```", begin);
        const std::string block = page.substr(begin, end - begin);
        if (block.find("torch.load") != std::string::npos) return block;
    }
    return {};
}

} // namespace

TEST_CASE("the page's program converts pickles, .npy files and dictionaries inside of others") {
    const test::Temporary folder;
    const std::string inside = "cd '" + (folder / "").string() + "' && ";
    const auto run = [&](const std::string& command) {
        return std::system((inside + command + " >said.txt 2>&1").c_str()) == 0;
    };
    std::string python;
    for (const char* candidate : {"python3", "/usr/bin/python3"})
        if (python.empty() && run(std::string(candidate) + " -c 'import numpy'")) python = candidate;
    if (python.empty()) {
        test::skip("there is no python3 with NumPy");
        return;
    }
    REQUIRE(!python_recipe().empty());
    write_file(folder / "convert.py", python_recipe());
    write_file(folder / "maker.py", python_maker);
    const bool made = run(python + " maker.py");
    INFO(read_file(folder / "said.txt"));
    REQUIRE(made);
    const BodyModel smplx = test::small_body(55, 3, 2, true), smpl = test::small_body(24, 3, 0);
    for (const std::string name : {"p0.pkl", "p1.pkl", "p2.pkl", "p3.pkl", "p4.pkl", "p5.pkl", "dictionary.npy",
                                   "object.npz params", "people.pkl 0"}) {
        CAPTURE(name);
        const std::string file = name.substr(0, name.find(' ')), key = name.substr(file.size());
        test::check_throws<IoError>([&] { (void)load_any_motion(folder / file, smplx); }, {file, "docs/captures.md"});
        const bool converted = run(python + " convert.py " + file + " out.npz" + key);
        INFO(read_file(folder / "said.txt"));
        REQUIRE(converted);
        const bool of_smpl = file == "people.pkl";
        const Motion motion = load_any_motion(folder / "out.npz", of_smpl ? smpl : smplx);
        REQUIRE(motion.frame_count() == 2);
        CHECK(motion.pose_at(1)[0] == vec3<double>(of_smpl ? 0.125 : 0.25));
        CHECK(motion.pose_at(1)[21] == vec3<double>(0.125));
        CHECK(motion.transl[1] == vec3<double>(0.5));
    }
    CHECK(!run(python + " convert.py people.pkl out.npz 0 betas"));
    CHECK(read_file(folder / "said.txt") == test::contains("holds ndarray, expected a dictionary"));
}

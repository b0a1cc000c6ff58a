// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/keypoints.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

BodyModel body_with_joints(std::vector<std::string> names) {
    BodyModel body;
    body.parents.assign(names.size(), -1);
    body.joint_names = std::move(names);
    return body;
}

} // namespace

TEST_CASE("joints of SMPL-X are found in a body by name, wherever they are, or not at all") {
    const std::vector<int> whole = joints_by_name(body_with_joints(std::vector<std::string>(55))),
                           smplh = joints_by_name(body_with_joints(std::vector<std::string>(52))),
                           smpl = joints_by_name(body_with_joints(std::vector<std::string>(24)));
    REQUIRE((whole.size() == 55 && smplh.size() == 55 && smpl.size() == 55));
    for (int j = 0; j < 55; ++j) {
        CAPTURE(j);
        const auto at = static_cast<std::size_t>(j);
        CHECK(whole[at] == j);
        CHECK(smplh[at] == (j < 22 ? j : j < 25 ? -1 : j - 3));
        CHECK(smpl[at] == (j < 22 ? j : -1)); // the joints of SMPL's hands are none of SMPL-X
    }

    const std::vector<int> own = joints_by_name(body_with_joints({"tail", "left_knee", "pelvis"}));
    CHECK(own[0] == 2);
    CHECK(own[static_cast<std::size_t>(smplx_joint("left_knee"))] == 1);
    CHECK(std::count(own.begin(), own.end(), -1) == 53);
    CHECK(joints_by_name(BodyModel{}) == std::vector<int>(55, -1));
}

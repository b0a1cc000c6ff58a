// SPDX-License-Identifier: Apache-2.0
#include <gsh/image/image.hpp>

#include "support/gradient.hpp"

#include <string>
#include <vector>

using namespace gsh;

TEST_CASE("planes lie one after another, rows within") {
    Image<float> image(3, 4, 5);
    for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(i);
    CHECK(image.at(0, 0, 0) == 0);
    CHECK(image.at(0, 1, 2) == 7);
    CHECK(image.at(2, 3, 4) == 59);
    const ImageView<const float> view = image.view();
    CHECK(view.size() == 60);
    CHECK(view.plane_size() == 20);
    CHECK(view.row(1, 2) == image.data.data() + 30);
    CHECK_FALSE(view.empty());
    CHECK(ImageView<float>().empty());
    CHECK((Image<float>(1, 2, 2, 0.5f).data == std::vector<float>(4, 0.5f)));
}

TEST_CASE("check_image names both shapes, and finds a view that is too short") {
    Image<float> image(3, 4, 5);
    CHECK_NOTHROW(check_image("here", "image", image.view(), 3, 4, 5));
    try {
        check_image("here", "image", image.view(), 3, 5, 4);
        CHECK(false);
    } catch (const ShapeError& error) {
        CHECK(std::string(error.what()) == "here: image is 3x4x5, expected 3x5x4 (channels x height x width)");
    }
    ImageView<float> torn = image.view();
    torn.data = torn.data.subspan(0, 59);
    CHECK_THROWS_AS(check_image("here", "image", torn, 3, 4, 5), ShapeError);
}

// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/splat_axes.hpp>

#include "io/splat_clouds.hpp"

#include <string_view>

using namespace gsh;

TEST_CASE("each vertical goes to y by a rotation; where it is along y or z, x stays") {
    const vec3<double> p(1, 2, 3);
    const auto turned = [&](UpAxis up) { return y_up_axes(up) * p; };
    CHECK(turned(UpAxis::y) == vec3<double>(1, 2, 3));
    CHECK(turned(UpAxis::minus_y) == vec3<double>(1, -2, -3)); // RDF to RUB, as the owners of SPZ turn a PLY
    CHECK(turned(UpAxis::z) == vec3<double>(1, 3, -2));
    CHECK(turned(UpAxis::minus_z) == vec3<double>(1, -3, 2));
    CHECK(turned(UpAxis::x) == vec3<double>(-2, 1, 3));
    CHECK(turned(UpAxis::minus_x) == vec3<double>(2, -1, 3));
    for (std::size_t k = 0; k < up_axis_names.size(); ++k) {
        const auto up = static_cast<UpAxis>(k);
        vec3<double> direction(0.0);
        direction[static_cast<int>(k / 2)] = k % 2 ? -1 : 1;
        CHECK(y_up_axes(up) * direction == vec3<double>(0, 1, 0));
        CHECK(determinant(y_up_axes(up)) == 1);
        CHECK(up_axis_called(name_of(up)) == up);
    }
    CHECK(!up_axis_called("up").has_value());
    CHECK(!up_axis_called("").has_value());
}

TEST_CASE("letters name axes") {
    CHECK(*axes_of_letters("RUB") == mat3<double>(1.0));
    CHECK(*axes_of_letters("RDF") * vec3<double>(1, 2, 3) == vec3<double>(1, -2, -3));
    CHECK(*axes_of_letters("RFU") * vec3<double>(1, 2, 3) == vec3<double>(1, 3, -2));
    CHECK(determinant(*axes_of_letters("LUB")) == -1);
    for (const std::string_view bad : {"", "RU", "RUX", "RLB", "RUBR", "rub"}) CHECK(!axes_of_letters(bad).has_value());
}

TEST_CASE("what is stored with a vertical comes back, bit for bit along y") {
    const auto cloud = test::splat_cloud(20, 3);
    for (const UpAxis up : {UpAxis::x, UpAxis::minus_x, UpAxis::y, UpAxis::minus_y, UpAxis::z, UpAxis::minus_z}) {
        auto back = as_stored(cloud, up);
        turn_from_stored(back, up);
        test::check_near(back, cloud, {.rotation = 1e-6, .dc = 1e-6, .rest = 1e-6});
        if (up != UpAxis::y && up != UpAxis::minus_y) continue;
        CHECK(back.sh == cloud.sh);
        CHECK(back.quats[7].x == cloud.quats[7].x);
        CHECK(back.quats[7].w == cloud.quats[7].w);
    }
    auto same = cloud;
    turn_from_stored(same, {});
    CHECK(same.means == cloud.means);
}

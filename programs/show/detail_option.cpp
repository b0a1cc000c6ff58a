// SPDX-License-Identifier: Apache-2.0
#include "show/detail_option.hpp"

#include "show/shown_people.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/coarser_avatar.hpp>
#include <gsh/avatar/view_detail.hpp>
#include <gsh/core/error.hpp>

#include <algorithm>
#include <charconv>

namespace gsh::programs {

std::size_t DetailOption::count() const {
    std::size_t number = 0;
    const char* const end = detail.data() + detail.size();
    const auto [next, code] = std::from_chars(detail.data(), end, number);
    check_value(code == std::errc() && next == end && number > 0, "--detail " + detail,
                "is not full, auto or a number above 0");
    return number;
}

void coarsen(cpu::Threads& backend, std::vector<AvatarData>& avatars, std::size_t count) {
    for (AvatarData& avatar : avatars)
        if (avatar.gaussians.size() > count) avatar = coarser_avatar(backend, avatar, count);
}

void coarsen(cpu::Threads& backend, ShownPeople& people, const DetailOption& option, const Camera<double>& camera,
             std::size_t first, std::size_t last) {
    if (option.is_full()) return;
    if (!option.is_auto()) return coarsen(backend, people.data, option.count());
    for (std::size_t p = 0; p < people.data.size(); ++p) {
        AvatarData& avatar = people.data[p];
        double most = 0; // pixels in a metre
        for (std::size_t f = first; f <= last; ++f)
            most = std::max(most, pixels_per_metre(camera, avatar.rig.joints[0] + people.motions[p].transl[f]));
        const std::size_t count = gaussians_for_view(surface_area(avatar.rig), most);
        if (avatar.gaussians.size() > count) avatar = coarser_avatar(backend, avatar, count);
    }
}

} // namespace gsh::programs

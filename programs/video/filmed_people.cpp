// SPDX-License-Identifier: Apache-2.0
#include "video/filmed_people.hpp"

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/fit/associate_people.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/named_path.hpp>

#include <algorithm>
#include <utility>

namespace gsh::programs {

WantedPeople::WantedPeople(const std::string& option) : chosen_(!option.empty()) {
    constexpr const char* where = "--people";
    if (!chosen_) return;
    if (option == "auto") {
        count_.reset();
        return;
    }
    if (option.find_first_not_of("0123456789") == std::string::npos) {
        const long number = gsh::detail::number_of_digits(option);
        constexpr long most = 100;
        check_value(number >= 1 && number <= most, where, "is " + option + ", expected 1 to " + std::to_string(most));
        count_ = static_cast<std::size_t>(number);
        return;
    }
    for (std::size_t begin = 0; begin <= option.size();) {
        const std::size_t end = std::min(option.find(',', begin), option.size());
        std::string name = option.substr(begin, end - begin);
        check_value(!name.empty() && gsh::detail::is_plain_name(name), where,
                    "has the name " + gsh::detail::shortened(name) + ", expected names of files, as in ann,bob");
        check_value(std::find(names_.begin(), names_.end(), name) == names_.end(), where,
                    "has the name " + gsh::detail::shortened(name) + " twice");
        names_.push_back(std::move(name));
        begin = end + 1;
    }
    count_ = names_.size();
}

std::vector<std::string> WantedPeople::names(std::size_t count) const {
    if (!names_.empty()) return names_;
    if (count == 1) return {""};
    std::vector<std::string> result;
    for (std::size_t p = 0; p < count; ++p) result.push_back("person" + std::to_string(p + 1));
    return result;
}

FilmedPeople people_of(const Detections& detections, const WantedPeople& wanted, const std::string& where) {
    std::vector<Camera<double>> cameras;
    for (const NamedCamera& camera : detections.cameras) cameras.push_back(camera.camera);
    const AssociatedPeople who =
        associate_people(cameras, detections.keypoints, detections.times, {.count = wanted.count()});
    check_value(who.count > 0, where,
                "nobody was found in any photograph; look at the pictures, and at the detector's messages");
    check_value(!wanted.count() || who.count == *wanted.count(), "--people",
                "asks for " + std::to_string(wanted.count().value_or(0)) + " people, and " + std::to_string(who.count) +
                    (who.count == 1 ? " was" : " were") + " found; scripts/detect finds one person only");
    FilmedPeople result{.people = {}, .in_view = who.in_view};
    const std::vector<std::string> names = wanted.names(who.count);
    for (std::size_t p = 0; p < who.count; ++p)
        result.people.push_back({names[p], {}, std::vector<bool>(detections.times.size(), false)});
    for (std::size_t i = 0; i < detections.keypoints.size(); ++i) {
        const PhotoKeypoints& photo = detections.keypoints[i];
        for (std::size_t k = 0; k < photo.people.size(); ++k) {
            if (who.person_of[i][k] < 0) continue;
            FilmedPerson& person = result.people[static_cast<std::size_t>(who.person_of[i][k])];
            person.photos.push_back({photo.camera, photo.frame, photo.people[k]});
            person.seen[photo.frame] = true;
        }
    }
    return result;
}

} // namespace gsh::programs

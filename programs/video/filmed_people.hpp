// SPDX-License-Identifier: Apache-2.0
/// @file  The people of a detector's folder: how many, their names, and which detections are theirs.
#pragma once

#include <gsh/fit/motion_fit.hpp>
#include <gsh/io/capture/detections.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

/// Who is to be fitted: the option --people.
class WantedPeople {
public:
    /// Reads a number, "auto", or names with commas between them; nothing is one person.
    ///
    /// Errors  ValueError for a number of 0, names that are no plain names of files, and names that occur twice.
    explicit WantedPeople(const std::string& option);

    [[nodiscard]] std::optional<std::size_t> count() const { return count_; } ///< none: as many as are found
    [[nodiscard]] bool chosen() const { return chosen_; }                     ///< whether there was an option
    /// The names of `count` people; that of a single person who has none is empty.
    [[nodiscard]] std::vector<std::string> names(std::size_t count) const;

private:
    std::optional<std::size_t> count_ = 1;
    bool chosen_ = false;
    std::vector<std::string> names_;
};

/// One of them.
struct FilmedPerson {
    std::string name; ///< empty for a single person without a name
    std::vector<PersonPhoto> photos;
    std::vector<bool> seen; // [T] in any photograph

    [[nodiscard]] std::string poses() const { return (name.empty() ? "poses" : name) + ".npz"; }
};

struct FilmedPeople {
    std::vector<FilmedPerson> people;
    std::size_t in_view = 0; ///< people who are seen nearly as long and as large
};

/// Tells the people apart. Their photographs have no masks yet.
///
/// Errors  ValueError if nobody was found, or fewer people than are wanted; `where` begins the message of the former.
FilmedPeople people_of(const Detections& detections, const WantedPeople& wanted, const std::string& where);

} // namespace gsh::programs

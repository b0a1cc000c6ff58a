// SPDX-License-Identifier: Apache-2.0
/// @file  A source of photographs that counts what is read from it, and can fail.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/photo/photo.hpp>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

class StoredPhotographs : public PhotoSource {
public:
    explicit StoredPhotographs(std::vector<PhotoContents> all) : all_(std::move(all)), reads_(all_.size()) {}

    [[nodiscard]] PhotoContents read(std::size_t index) const override {
        ++reads_[index];
        if (index == failing_) throw IoError("photograph " + std::to_string(index) + ": the disk is gone");
        return all_.at(index);
    }
    [[nodiscard]] int reads(std::size_t index) const { return reads_[index]; }
    /// Reading this photograph fails from now on.
    void fail(std::size_t index) { failing_ = index; }

private:
    std::vector<PhotoContents> all_;
    mutable std::vector<std::atomic<int>> reads_;
    std::atomic<std::size_t> failing_ = ~std::size_t(0);
};

/// The same photographs, whose pixels a source has.
inline std::vector<Photo> with_source(std::vector<Photo> photos, std::shared_ptr<StoredPhotographs>* source = nullptr) {
    std::vector<PhotoContents> all;
    for (const Photo& photo : photos)
        all.push_back(
            {{photo.rgba.begin(), photo.rgba.end()}, photo.pixels(), {photo.unknown.begin(), photo.unknown.end()}});
    const auto made = std::make_shared<StoredPhotographs>(std::move(all));
    for (std::size_t k = 0; k < photos.size(); ++k) {
        photos[k].rgba = {}, photos[k].unknown = {}, photos[k].box.reset();
        photos[k].source = made, photos[k].source_index = k;
    }
    if (source) *source = made;
    return photos;
}

} // namespace gsh::test

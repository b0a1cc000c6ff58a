// SPDX-License-Identifier: Apache-2.0
/// @file  Containers with checksums, taken apart and put together: without their repair, a fuzzer stays at the door.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::fuzz {

/// A container's parts. Its kind is told by its first bytes.
struct Container {
    enum class Kind {
        zip,  ///< a part is a member; deflated members are stored when they are put together
        png,  ///< a part is a chunk; the image data of all IDAT chunks is one part, inflated
        gzip, ///< one part: what the stream inflates to
        zstd, ///< one part, likewise
        spz4, ///< SPZ of version 4: the header, and each of its streams decompressed
        glb,  ///< a part is a chunk
    };
    struct Part {
        std::string name; ///< of a member or a chunk
        std::string bytes;
    };
    Kind kind;
    std::vector<Part> parts;
};

/// No value for bytes that are no such container, or a damaged one.
[[nodiscard]] std::optional<Container> take_apart(std::string_view bytes);

/// The container's bytes, with all lengths and checksums right.
[[nodiscard]] std::string put_together(const Container& container);

} // namespace gsh::fuzz

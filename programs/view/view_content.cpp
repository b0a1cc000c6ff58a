// SPDX-License-Identifier: Apache-2.0
#include "view/view_content.hpp"

#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/gzip.hpp>

#include <httplib.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace gsh::programs {

bool is_loopback_address(std::string_view address) {
    constexpr std::string_view mapped = "::ffff:"; // IPv4 at a socket of IPv6
    if (address.starts_with(mapped)) address.remove_prefix(mapped.size());
    return address.starts_with("127.") || address == "::1";
}

KeptContent::Bytes KeptContent::plain() {
    const std::lock_guard lock(mutex_); // others wait for the one that makes it
    if (plain_) return plain_;
    auto made = std::make_shared<const std::string>(make_());
    if (caching_ == Caching::ask) {
        Crc32 crc;
        crc.add(made->data(), made->size());
        tag_ = "W/\"" + std::to_string(crc.value()) + '-' + std::to_string(made->size()) + '"';
    }
    return plain_ = std::move(made);
}

KeptContent::Bytes KeptContent::compressed() {
    constexpr int level = 6; // the page becomes 48 of 155 kB; level 9 spares another 80 bytes
    const Bytes bytes = plain();
    const std::lock_guard lock(mutex_);
    if (!compressed_) compressed_ = std::make_shared<const std::string>(gzip(*bytes, level));
    return compressed_;
}

void KeptContent::answer(const httplib::Request& request, httplib::Response& response) {
    Bytes bytes = plain();
    const bool is_text = !type_.starts_with("application/octet-stream");
    if (caching_ == Caching::ask) {
        response.set_header("ETag", tag_);
        if (request.get_header_value("If-None-Match").find(tag_) != std::string::npos) response.status = 304;
    }
    // Only this browser may keep it: the address has the key.
    response.headers.erase("Cache-Control");
    response.set_header("Cache-Control",
                        caching_ == Caching::ask ? "private, no-cache" : "private, max-age=86400, immutable");
    if (response.status == 304) return;
    if (is_text) {
        response.set_header("Vary", "Accept-Encoding");
        if (!is_loopback_address(request.remote_addr) &&
            request.get_header_value("Accept-Encoding").find("gzip") != std::string::npos) {
            bytes = compressed();
            response.set_header("Content-Encoding", "gzip");
        }
    }
    static constexpr std::size_t piece = std::size_t(1) << 20; // between two of them httplib looks whether it must stop
    const std::size_t size = bytes->size();
    response.set_content_provider(
        size, type_, [bytes = std::move(bytes)](std::size_t begin, std::size_t length, httplib::DataSink& sink) {
            return sink.write(bytes->data() + begin, std::min(length, piece));
        });
}

} // namespace gsh::programs

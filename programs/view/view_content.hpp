// SPDX-License-Identifier: Apache-2.0
/// @file  Contents of a web server that never change: made once, compressed once, and cached by the browser.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

namespace httplib {
struct Request;
struct Response;
} // namespace httplib

namespace gsh::programs {

/// Whether an address is one of this machine: 127.0.0.1 and the like, ::1.
[[nodiscard]] bool is_loopback_address(std::string_view address);

/// A content that is made when it is first asked for, and then kept in memory, as it is sent.
///
/// A client on another machine that accepts gzip gets a text compressed. A package of floats is sent as it is: it would
/// become a third smaller, in more time than a local network takes for that third, and the page could not tell how much
/// of it has arrived. On the same machine nothing is compressed, since sending takes no time there.
class KeptContent {
public:
    /// How long a browser may use its copy.
    enum class Caching {
        ask,    ///< it asks each time whether the copy is still good, and gets a 304 then
        forever ///< it does not ask; what is at an address must never change
    };

    KeptContent(std::string type, Caching caching, std::function<std::string()> make)
        : type_(std::move(type)), caching_(caching), make_(std::move(make)) {}

    /// Answers a request, also of another thread. What `make` throws is thrown, and the next request calls it again.
    void answer(const httplib::Request& request, httplib::Response& response);

private:
    using Bytes = std::shared_ptr<const std::string>;
    [[nodiscard]] Bytes plain();
    [[nodiscard]] Bytes compressed();

    std::string type_;
    Caching caching_;
    std::function<std::string()> make_;
    std::mutex mutex_;
    Bytes plain_, compressed_;
    std::string tag_;
};

} // namespace gsh::programs

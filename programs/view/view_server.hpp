// SPDX-License-Identifier: Apache-2.0
/// @file  The web server of gsh-view: serves the page, draws pictures for it, and reads the motions that it sends.
#pragma once

#include <gsh/backend/threads.hpp>

#include <atomic>
#include <functional>
#include <memory>
#include <string>

namespace gsh::programs {

struct ViewScene;

struct ViewServerOptions {
    std::string host = "127.0.0.1"; ///< the address to bind to; only this machine can reach the default
    int port = 0;                   ///< 0: any free one
    // For tests, which drive the page:
    std::string script = {};                             ///< is run in the page
    std::function<void(const std::string&)> report = {}; ///< receives what the script posts to /report
};

/// Serves a scene to a browser.
///
///     GET  /                        the page
///     GET  /scene                   the description that the page loads (describe)
///     GET  /motion?person=P&motion=M  a motion (package_motion)
///     GET  /gaussians               the scene for the client engine (package_scene)
///     POST /draw                    a request (parse_view_request); the answer is a JPEG or a PNG
///     POST /motion?person=P&name=N  the bytes of a motion file; the answer is the motion
///
/// All of them need the key, `?key=…`, which is new for each server. Requests with a foreign Host or Origin are
/// refused, so that no other page in the browser reaches the server. The client names no file. A body is at most 1 MiB,
/// a motion 64 MiB. Whatever is refused is answered by a status 4xx, or 507 where memory is short, and a line of text.
/// Connections that have not shown the key are few and short (view_connections.hpp).
class ViewServer {
public:
    static constexpr std::size_t largest_body = std::size_t(1) << 20, largest_motion = std::size_t(64) << 20; // bytes

    /// Binds to the address. The scene and the backend must outlive the server.
    /// Errors  IoError if the address cannot be bound.
    ViewServer(cpu::Threads& backend, const ViewScene& scene, const ViewServerOptions& options = {});
    ~ViewServer();
    ViewServer(const ViewServer&) = delete;
    ViewServer& operator=(const ViewServer&) = delete;

    [[nodiscard]] int port() const;
    [[nodiscard]] const std::string& key() const;
    /// The address of the page, with the key.
    [[nodiscard]] std::string url() const;

    /// Serves until `stop` is set.
    void run(const std::atomic<bool>& stop);

private:
    class Implementation;
    std::unique_ptr<Implementation> implementation_;
};

} // namespace gsh::programs

// SPDX-License-Identifier: Apache-2.0
// What gsh-view's server reads: the heads of requests, the requests of its page, and whole connections.
#include "fuzz/target.hpp"

#include "support/tube_avatar.hpp"

#include "common/rig_option.hpp"
#include "show/light_option.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"
#include "view/view_server.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/model/avatar_file.hpp>

#include "view/view_connections.hpp" // after Eigen: the system's header for names of hosts has a macro _res

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

namespace gsh::fuzz {

namespace {

using namespace gsh::programs;

const Registered request_head_target("request-head", "head", [](const InputFile& file) {
    const ConnectionLimits limits;
    const std::string bytes = read_file(file);
    const RequestHead head = parse_head(bytes, "0123456789abcdef", limits);
    must(head.status == 0 || (head.status >= 400 && head.status < 500 && !head.refusal.empty()),
         "a head is refused without a reason");
    if (head.status != 0) return;
    must(head.text.ends_with("\r\n\r\n"), "a head has no end");
    must(!head.has_key || head.body_bytes <= limits.body_bytes, "a body is larger than the limit");
    const RequestHead again = parse_head(head.text, "0123456789abcdef", limits);
    must(again.status == 0 && again.text == head.text && again.body_bytes == head.body_bytes &&
             again.has_key == head.has_key,
         "a head that is read again differs");
});

const std::vector<PersonSize> two_people{{3, 2, 1}, {4, 0, 0}};

const Registered view_request_target("view-request", "request", [](const InputFile& file) {
    try {
        const ViewRequest request = parse_view_request(read_file(file), two_people);
        must(request.people.size() == 2 && request.people[0].pose.size() == 3 && request.people[1].pose.size() == 4,
             "a request has other people than the scene");
        must(request.camera.width >= 16 && request.camera.height <= largest_view,
             "a picture is too small or too large");
    } catch (const ValueError& error) { // of no file: it names the field
        must(error.what()[0] != '\0', "an error without a message");
    }
});

/// gsh-view's server with one small avatar, on a port of its own.
class RunningServer {
public:
    RunningServer() : backend_(1), scene_(small_scene()), server_(backend_, scene_, {}) {
        thread_ = std::thread([this] { server_.run(stop_); });
    }
    ~RunningServer() {
        stop_ = true;
        thread_.join();
    }
    RunningServer(const RunningServer&) = delete;
    RunningServer& operator=(const RunningServer&) = delete;

    [[nodiscard]] const std::string& key() const { return server_.key(); }
    [[nodiscard]] const ViewScene& scene() const { return scene_; }

    /// Sends bytes and ends its side, and returns what comes back until the server ends its own.
    [[nodiscard]] std::string answer(const std::string& bytes) const {
        const int connection = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(static_cast<std::uint16_t>(server_.port()));
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        must(::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0,
             "the server does not listen");
        for (std::size_t sent = 0; sent < bytes.size();) {
            const ssize_t count = ::send(connection, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
            if (count <= 0) break; // refused before its end
            sent += static_cast<std::size_t>(count);
        }
        ::shutdown(connection, SHUT_WR);
        std::string received;
        char block[1 << 14];
        for (ssize_t count; (count = ::recv(connection, block, sizeof block, 0)) > 0;)
            received.append(block, static_cast<std::size_t>(count));
        ::close(connection);
        return received;
    }

private:
    static ViewScene small_scene() {
        const std::filesystem::path path = scratch() / "avatar.gsh";
        save_avatar(path, test::tube_avatar());
        std::vector<std::string> warnings;
        ViewScene scene = load_view_scene({path}, {}, {}, {}, warnings);
        return scene;
    }

    cpu::Threads backend_;
    ViewScene scene_;
    ViewServer server_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

/// Bytes of a connection to gsh-view. "{key}" stands for the key, which nobody can guess.
const Registered view_server_target("view-server", "connection", [](const InputFile& file) {
    static const RunningServer server;
    std::string bytes = read_file(file);
    for (std::size_t at; (at = bytes.find("{key}")) != std::string::npos;) bytes.replace(at, 5, server.key());
    // A picture of 4096 pixels takes seconds here, where every access of memory is checked.
    if (const std::size_t body = bytes.find("\r\n\r\n"); body != std::string::npos) try {
            const ViewRequest request = parse_view_request(bytes.substr(body + 4), server.scene().sizes());
            if (request.camera.width * request.camera.height > 256 * 256) return;
        } catch (const Error&) { // what the server answers is looked at
        }
    const std::string answer = server.answer(bytes);
    must(answer.empty() || answer.starts_with("HTTP/1.1 "), "an answer is not one of HTTP");
    if (answer.empty()) return;
    const int status = std::atoi(answer.c_str() + 9);
    must((status >= 100 && status < 500) || status == 503 || status == 507, "the server failed");
});

} // namespace

} // namespace gsh::fuzz

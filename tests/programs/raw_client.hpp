// SPDX-License-Identifier: Apache-2.0
/// @file  A client of gsh-view's server that sends any bytes, whole requests or not, and reads at a pace of its own.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <string>
#include <system_error>

namespace gsh::test {

class RawClient {
public:
    /// Connects to a port of this machine and sends these bytes. Where receive_buffer is not 0, the kernel keeps about
    /// so many bytes for it, as for a slow reader.
    /// Errors  std::system_error without a connection.
    explicit RawClient(int port, const std::string& bytes = {}, int receive_buffer = 0)
        : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
        if (receive_buffer) ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(static_cast<std::uint16_t>(port));
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        if (::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
            const int error = errno;
            ::close(socket_);
            throw std::system_error(error, std::generic_category(), "port " + std::to_string(port));
        }
        if (!bytes.empty()) send(bytes);
    }
    ~RawClient() { ::close(socket_); }
    RawClient(const RawClient&) = delete;
    RawClient& operator=(const RawClient&) = delete;

    bool send(const std::string& bytes) {
        return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
    }

    /// The next bytes, at most 8192; none at the end of the connection or after the time.
    std::string receive_block(std::chrono::milliseconds time) {
        pollfd file{socket_, POLLIN, 0};
        if (::poll(&file, 1, static_cast<int>(time.count())) <= 0) return {};
        std::array<char, 8192> block;
        const ssize_t count = ::recv(socket_, block.data(), block.size(), 0);
        ended_ = count <= 0;
        return {block.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0))};
    }

    /// Everything that has arrived, once the text is in it, the connection has ended, or the time is over.
    const std::string& receive(const std::string& until = "\n\n no end",
                               std::chrono::milliseconds time = std::chrono::seconds(3)) {
        using Clock = std::chrono::steady_clock;
        const auto deadline = Clock::now() + time;
        while (!ended_ && received_.find(until) == std::string::npos) {
            const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
            if (left.count() <= 0) break;
            const std::string block = receive_block(left);
            if (block.empty()) break;
            received_ += block;
        }
        return received_;
    }
    [[nodiscard]] bool ended() const { return ended_; }

private:
    int socket_;
    std::string received_;
    bool ended_ = false;
};

} // namespace gsh::test

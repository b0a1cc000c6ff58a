// SPDX-License-Identifier: Apache-2.0
/// @file  The steps of a training that a program reports (programs/common/reports.hpp), for tests that stop it.
#pragma once

#include "programs/process.hpp"

#include <doctest/doctest.h>

#include "common/reports.hpp"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

namespace gsh::test {

/// A step that is done, and the steps a second up to it.
struct ReportedStep {
    std::uint64_t step = 0;
    double rate = 0;

    /// Of training, if it began at step 0; as exact as the rate is printed, to a tenth.
    [[nodiscard]] double seconds() const { return rate > 0 ? static_cast<double>(step) / rate : 0; }
};

/// Takes the reports of the programs that are started while this exists.
class ReportedSteps {
public:
    ReportedSteps() {
        REQUIRE(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, sockets_.data()) == 0);
        REQUIRE(::fcntl(sockets_[0], F_SETFD, FD_CLOEXEC) == 0);
        variable_.emplace(programs::report_variable, std::to_string(sockets_[1]));
    }
    ReportedSteps(const ReportedSteps&) = delete;
    ReportedSteps& operator=(const ReportedSteps&) = delete;
    ~ReportedSteps() {
        for (const int socket : sockets_) ::close(socket);
    }

    /// The steps that were reported since the last call.
    [[nodiscard]] std::vector<ReportedStep> take() {
        std::vector<ReportedStep> steps;
        char packet[4096];
        while (true) {
            const ssize_t size = ::recv(sockets_[0], packet, sizeof packet - 1, MSG_DONTWAIT);
            if (size <= 0) return steps;
            packet[size] = '\0';
            const std::string text(packet);
            const std::size_t details = text.rfind('\t') + 1;
            if (text.compare(details, 5, "step ") != 0) continue;
            ReportedStep step{std::strtoull(text.c_str() + details + 5, nullptr, 10)};
            if (const std::size_t psnr = text.find(" dB  ", details); psnr != std::string::npos)
                step.rate = std::strtod(text.c_str() + psnr + 5, nullptr);
            steps.push_back(step);
        }
    }

private:
    std::array<int, 2> sockets_{};
    std::optional<Variable> variable_;
};

} // namespace gsh::test

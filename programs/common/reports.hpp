// SPDX-License-Identifier: Apache-2.0
/// @file  Reports of a program to the process that started it: progress, warnings, the error that ended it.
#pragma once

#include <sys/socket.h>

#include <atomic>
#include <cctype>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <initializer_list>
#include <string>

namespace gsh::programs {

/// The environment variable with the number of an open socket that takes reports. The functions of the Python package
/// start programs with it. Each report is one packet: fields that tabs separate, the first one of which is
///   progress  title, share in [0, 1] or nothing, details
///   warning   text
///   error     class, text
inline constexpr const char* report_variable = "GSH_REPORT_SOCKET";

/// What becomes of a report while the socket is full, because the other process does not read.
enum class WhenFull { wait, drop };

/// Sends a report if somebody asked for them. If that process has ended, this one ends, too: in order where Ctrl-C
/// ends it in order (watch_interrupts).
inline void send_report(std::initializer_list<std::string> fields, WhenFull when_full = WhenFull::wait) {
    static const int socket = [] {
        const char* const text = std::getenv(report_variable);
        char* end = nullptr;
        const long number = text != nullptr ? std::strtol(text, &end, 10) : -1;
        return text != nullptr && end != text && *end == '\0' && number > 2 && number < 65536 ? static_cast<int>(number)
                                                                                              : -1;
    }();
    if (socket < 0) return;
    std::string packet;
    for (const std::string& field : fields) {
        if (&field != fields.begin()) packet += '\t';
        for (const char c : field) packet += std::iscntrl(static_cast<unsigned char>(c)) ? ' ' : c;
    }
    const int flags = MSG_NOSIGNAL | (when_full == WhenFull::drop ? MSG_DONTWAIT : 0);
    while (::send(socket, packet.data(), packet.size(), flags) < 0) {
        if (errno == EINTR) continue;
        static std::atomic<bool> ending{false};
        if ((errno == EPIPE || errno == ECONNRESET) && !ending.exchange(true)) std::raise(SIGTERM);
        return;
    }
}

} // namespace gsh::programs

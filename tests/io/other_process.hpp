// SPDX-License-Identifier: Apache-2.0
/// @file  Another process for a test of locks: it does something, and holds on until it is killed.
#pragma once

#include <doctest/doctest.h>

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <exception>

namespace gsh::test {

/// A child process in which deed(wait) runs; the constructor returns when it calls wait(), which does not return. The
/// destructor kills it, so that no destructor of the child runs.
class OtherProcess {
public:
    template <class Deed>
    explicit OtherProcess(const Deed& deed) {
        int ready[2];
        REQUIRE(::pipe(ready) == 0);
        id_ = ::fork();
        REQUIRE(id_ >= 0);
        if (id_ == 0) {
            try {
                deed([&] {
                    (void)!::write(ready[1], "x", 1);
                    while (true) ::pause();
                });
            } catch (const std::exception&) {
            }
            ::_exit(1);
        }
        ::close(ready[1]);
        char byte = 0;
        CHECK(::read(ready[0], &byte, 1) == 1);
        ::close(ready[0]);
    }
    ~OtherProcess() {
        ::kill(id_, SIGKILL);
        ::waitpid(id_, nullptr, 0);
    }
    OtherProcess(const OtherProcess&) = delete;
    OtherProcess& operator=(const OtherProcess&) = delete;
    [[nodiscard]] pid_t id() const { return id_; }

private:
    pid_t id_ = -1;
};

} // namespace gsh::test

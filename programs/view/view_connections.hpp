// SPDX-License-Identifier: Apache-2.0
/// @file  The connections of gsh-view's server, bounded in time and number before a client has shown the key.
#pragma once

#include <httplib.h>
#include <sys/socket.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

namespace gsh::programs {

struct ConnectionLimits {
    std::size_t guests = 128;  ///< connections that have not shown the key; a further one ends the oldest
    std::size_t members = 256; ///< connections that have
    std::size_t requests = 8;  ///< that are worked on at one time, from the end of the body to the answer's beginning
    std::size_t uploads = 8;   ///< requests with a body above upload_bytes, from its beginning to the answer's
    std::size_t upload_bytes = std::size_t(1) << 20;
    std::size_t head_bytes = 16384;
    std::size_t fields = 64;                 ///< lines of a head
    std::chrono::milliseconds head{5000};    ///< for a whole head, from its first byte or the connection's beginning
    std::chrono::milliseconds idle{30'000};  ///< of a connection between requests
    std::chrono::milliseconds pause{10'000}; ///< between two pieces of a body, and of an answer
    std::chrono::milliseconds body{300'000}; ///< for a whole body
    std::size_t body_bytes = std::size_t(64) << 20;
};

/// The head of a request, as far as it decides whether httplib sees the request.
struct RequestHead {
    std::string text; ///< for httplib: without fields that are ignored (Range)
    std::string method;
    bool has_key = false;       ///< the first parameter `key` is the key, as it stands
    std::size_t body_bytes = 0; ///< Content-Length
    int status = 0;             ///< of the refusal; 0: none
    std::string refusal = {};
};

/// Compares in a time that does not depend on where two texts differ.
[[nodiscard]] bool same_key(std::string_view a, std::string_view b);

/// Reads a head up to its empty line, strictly: fields that decide where a request ends, or whose it is, may stand
/// there once; a body needs a Content-Length; it cannot be sent in chunks.
[[nodiscard]] RequestHead parse_head(std::string_view head, std::string_view key, const ConnectionLimits& limits);

/// Places for a number of requests, given in the order in which they were asked for.
class Places {
public:
    explicit Places(std::size_t count) : free_(count) {}
    /// Waits for a place. Errors  Stopped, a place is not taken.
    void take();
    void give_back();
    /// Whoever waits, or will wait, gets no place any more.
    void stop();

    struct Stopped {};

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::size_t free_;
    std::uint64_t asked_ = 0, served_ = 0; // numbers of who asked last, and of who is next
    bool stopping_ = false;
};

/// A place that is taken and given back once, or never.
class Place {
public:
    explicit Place(Places& places) : places_(places) {}
    ~Place() { give_back(); }
    Place(const Place&) = delete;
    Place& operator=(const Place&) = delete;

    void take() { places_.take(), is_taken_ = true; }
    void give_back() {
        if (std::exchange(is_taken_, false)) places_.give_back();
    }

private:
    Places& places_;
    bool is_taken_ = false;
};

/// An httplib server that reads the heads of requests itself.
///
/// httplib 0.11.4 reads a head in a thread of a small pool, without a bound on its whole time, so that a few
/// connections that send a byte now and then hold all threads. It also answers any number of ranges, and takes fields
/// that stand there twice. Here each connection has a thread of its own. A head has one deadline, and the oldest
/// connection without the key gives way to a new one. httplib receives a request when its head is complete, and no more
/// bytes of the body than it states. Without the key it receives none, and the connection ends after the answer.
///
/// A request has one of a few places while it is worked on. Places are given in the order of requests, so that no page
/// waits longer than the others. A client that sends a body slowly, or reads an answer slowly, has none meanwhile.
class GuardedServer : public httplib::Server {
public:
    /// `key` must outlive this object.
    GuardedServer(std::string_view key, ConnectionLimits limits);

    /// Lets as many connections wait to be accepted as there may be guests. For a server that is bound. httplib lets 5
    /// wait, and the system drops the first packet of further ones, which then takes a second or more.
    void lengthen_queue() { ::listen(svr_sock_, static_cast<int>(limits_.guests)); }

    /// Ends connections that wait for a request. Those that are answered end afterwards.
    void stop_waiting();

private:
    class Connection;

    bool process_and_close_socket(socket_t socket) override;
    void serve(Connection& connection);

    /// Registers a connection; ends the oldest guest if there are too many.
    void enter(Connection& connection);
    void leave(Connection& connection);
    /// Makes a guest a member; false if there are too many.
    [[nodiscard]] bool admit(Connection& connection);

    std::string_view key_;
    ConnectionLimits limits_;
    Places work_, uploads_;
    std::mutex mutex_;
    std::list<Connection*> guests_, members_; // the oldest first
    bool stopping_ = false;
};

/// A queue of httplib in which each connection has a thread of its own.
class ConnectionThreads : public httplib::TaskQueue {
public:
    /// `stop` is called before the threads are waited for.
    explicit ConnectionThreads(std::function<void()> stop) : stop_(std::move(stop)) {}
    void enqueue(std::function<void()> serve) override;
    void shutdown() override;

private:
    struct Worker {
        std::thread thread = {};
        std::atomic<bool> done{false};
    };
    std::function<void()> stop_;
    std::list<Worker> workers_; // only the accepting thread uses the list
};

} // namespace gsh::programs

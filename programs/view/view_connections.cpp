// SPDX-License-Identifier: Apache-2.0
#include "view/view_connections.hpp"

#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <initializer_list>
#include <set>
#include <system_error>
#include <utility>

namespace gsh::programs {

namespace {

using Clock = std::chrono::steady_clock;

std::string lower(std::string_view text) {
    std::string result(text);
    for (char& c : result) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return result;
}
std::string_view without_blanks(std::string_view text) {
    while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
    while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
    return text;
}

/// The value of the first parameter `key` of a target such as "/draw?key=0123".
std::string_view key_of(std::string_view target) {
    std::string_view query = target.substr(std::min(target.find('?'), target.size()));
    while (!query.empty()) {
        query.remove_prefix(1); // ? or &
        const std::string_view parameter = query.substr(0, query.find('&'));
        if (parameter.starts_with("key=")) return parameter.substr(4);
        query.remove_prefix(parameter.size());
    }
    return {};
}

/// Waits until a socket can be read or written; false at the deadline, or if the other side has gone.
bool wait_for(socket_t socket, short events, Clock::time_point deadline) {
    while (true) {
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
        if (left <= 0) return false;
        pollfd file{socket, events, 0};
        const int count = ::poll(&file, 1, static_cast<int>(std::min<long long>(left + 1, 1'000'000)));
        if (count > 0) return true;
        if (count < 0 && errno != EINTR) return false;
    }
}

} // namespace

bool same_key(std::string_view a, std::string_view b) {
    unsigned difference = a.size() == b.size() ? 0 : 1;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
        difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
    return difference == 0;
}

RequestHead parse_head(std::string_view head, std::string_view key, const ConnectionLimits& limits) {
    RequestHead result;
    const auto refused = [&](int status, std::string why) {
        result.status = status, result.refusal = std::move(why);
        return result;
    };
    std::size_t line_end = head.find("\r\n");
    const std::string_view request = head.substr(0, line_end);
    const std::size_t first = request.find(' '), second = request.find(' ', first + 1);
    if (!head.ends_with("\r\n\r\n") || first == std::string_view::npos || second == std::string_view::npos ||
        !request.substr(second + 1).starts_with("HTTP/1."))
        return refused(400, "the request is not understood");
    result.method = request.substr(0, first);
    result.text.append(request).append("\r\n");
    result.has_key = same_key(key_of(request.substr(first + 1, second - first - 1)), key);

    std::set<std::string> seen;
    std::size_t count = 0;
    bool has_length = false;
    for (std::size_t begin = line_end + 2; begin < head.size(); begin = line_end + 2) {
        line_end = head.find("\r\n", begin);
        const std::string_view line = head.substr(begin, line_end - begin);
        if (line.empty()) break;
        if (++count > limits.fields) return refused(431, "the request has too many header fields");
        const std::size_t colon = line.find(':');
        const std::string name = lower(line.substr(0, colon));
        if (colon == std::string_view::npos || colon == 0 || name.find_first_of(" \t") != std::string::npos ||
            std::any_of(line.begin(), line.end(), [](char c) { return c == '\0' || c == '\n' || c == '\r'; }))
            return refused(400, "a header field of the request is not understood");
        const std::string_view value = without_blanks(line.substr(colon + 1));
        for (const char* once : {"host", "origin", "content-length", "content-type", "content-encoding", "expect"})
            if (name == once && !seen.insert(name).second)
                return refused(400, "the header field " + name + " stands there twice");
        if (name == "transfer-encoding")
            return refused(411, "the body has no Content-Length; it cannot be sent in chunks");
        if (name == "content-length") {
            has_length = true;
            const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), result.body_bytes);
            if (error == std::errc::result_out_of_range)
                result.body_bytes = limits.body_bytes + 1;
            else if (error != std::errc() || end != value.data() + value.size())
                return refused(400, "Content-Length is not a number");
        }
        if (name == "range") continue; // nothing here is worth a part
        result.text.append(line).append("\r\n");
    }
    result.text += "\r\n";
    const bool has_body = result.method == "POST" || result.method == "PUT" || result.method == "PATCH";
    if (has_body && !has_length) return refused(411, "the body has no Content-Length");
    if (result.has_key && result.body_bytes > limits.body_bytes)
        return refused(413, "the body is larger than " + std::to_string(limits.body_bytes >> 20) +
                                " MiB, the most that is read");
    return result;
}

void Places::take() {
    std::unique_lock lock(mutex_);
    const std::uint64_t mine = asked_++;
    changed_.wait(lock, [&] { return stopping_ || (served_ == mine && free_ > 0); });
    if (stopping_) throw Stopped(); // so do all that asked later
    ++served_, --free_;
    changed_.notify_all(); // the next one may find a place, too
}
void Places::give_back() {
    const std::lock_guard lock(mutex_);
    ++free_;
    changed_.notify_all();
}
void Places::stop() {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
}

/// A connection, as httplib's stream of one request at a time.
class GuardedServer::Connection : public httplib::Stream {
public:
    Connection(socket_t socket, GuardedServer& server)
        : socket_(socket), limits_(server.limits_), work_(server.work_), upload_(server.uploads_) {}

    // The beginning of a request.

    enum class Arrival { head, nothing, too_late, too_long };

    /// Waits for a whole head. `before` is the deadline of its first byte; then it has limits.head, if that is earlier.
    Arrival read_head(std::string& head, Clock::time_point before) {
        std::size_t searched = 0;
        auto deadline = before;
        if (!pending_.empty()) deadline = std::min(deadline, Clock::now() + limits_.head);
        while (true) {
            // The end of a head; what follows belongs to the body.
            if (const auto end = pending_.find("\r\n\r\n", searched); end != std::string::npos) {
                if (end + 4 > limits_.head_bytes) return Arrival::too_long;
                head = pending_.substr(0, end + 4);
                pending_.erase(0, end + 4);
                return Arrival::head;
            }
            if (pending_.size() > limits_.head_bytes) return Arrival::too_long;
            searched = pending_.size() < 3 ? 0 : pending_.size() - 3;
            char bytes[4096];
            const bool begun = !pending_.empty();
            if (!wait_for(socket_, POLLIN, deadline)) return begun ? Arrival::too_late : Arrival::nothing;
            const ssize_t count = ::recv(socket_, bytes, sizeof bytes, 0);
            if (count <= 0) return Arrival::nothing;
            if (!begun) deadline = std::min(deadline, Clock::now() + limits_.head);
            pending_.append(bytes, static_cast<std::size_t>(count));
        }
    }
    /// Lets httplib read this head, and then as many bytes as its body has. Waits for a place if the request needs one
    /// now. Errors  Places::Stopped.
    void begin(const RequestHead& head) {
        head_ = head.text, at_ = 0, left_ = head.has_key ? head.body_bytes : 0;
        needs_place_ = head.has_key;
        if (left_ > limits_.upload_bytes) upload_.take();
        body_deadline_ = Clock::now() + limits_.body;
        if (left_ == 0) begin_work();
    }
    /// The request has been answered, or has failed.
    void finish() { work_.give_back(), upload_.give_back(); }
    /// Whether a body was not read to its end.
    [[nodiscard]] bool has_rest() const { return left_ > 0; }

    // httplib's side.

    [[nodiscard]] bool is_readable() const override { return at_ < head_.size() || left_ > 0; }
    [[nodiscard]] bool is_writable() const override { return true; }
    ssize_t read(char* data, std::size_t size) override {
        if (at_ < head_.size()) return take(head_, at_, data, size);
        size = std::min(size, left_);
        if (size == 0) return 0;
        const ssize_t count = read_body(data, size);
        if (count <= 0) return count;
        left_ -= static_cast<std::size_t>(count);
        if (left_ > 0) return count;
        try {
            begin_work();
        } catch (const Places::Stopped&) {
            return -1;
        }
        return count;
    }
    ssize_t write(const char* data, std::size_t size) override {
        // The answer is there, and how fast it is read is the client's matter. Before the body's end, it is "100 Continue".
        if (left_ == 0) finish();
        const auto deadline = Clock::now() + limits_.pause;
        while (wait_for(socket_, POLLOUT, deadline)) {
            const ssize_t count = ::send(socket_, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
            if (count >= 0 || (errno != EAGAIN && errno != EINTR)) return count;
        }
        return -1;
    }
    void get_remote_ip_and_port(std::string& ip, int& port) const override {
        sockaddr_storage address{};
        socklen_t size = sizeof address;
        char name[NI_MAXHOST] = {};
        if (::getpeername(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0)
            (void)::getnameinfo(reinterpret_cast<sockaddr*>(&address), size, name, sizeof name, nullptr, 0,
                                NI_NUMERICHOST);
        ip = name, port = 0;
    }
    void get_local_ip_and_port(std::string& ip, int& port) const override { ip.clear(), port = 0; }
    [[nodiscard]] socket_t socket() const override { return socket_; }

    // The end.

    /// Answers without httplib.
    void refuse(int status, const std::string& why) {
        const std::string body = why + "\n";
        const std::string answer = "HTTP/1.1 " + std::to_string(status) +
                                   " Refused\r\nConnection: close\r\nCache-Control: no-store\r\n"
                                   "X-Content-Type-Options: nosniff\r\nContent-Type: text/plain; charset=utf-8\r\n"
                                   "Content-Length: " +
                                   std::to_string(body.size()) + "\r\n\r\n" + body;
        (void)write(answer.data(), answer.size());
    }
    /// Reads on for a moment, so that the answer is not lost with bytes that were never read. `most` bounds the bytes.
    void close_gently(std::size_t most) {
        ::shutdown(socket_, SHUT_WR);
        const auto deadline = Clock::now() + std::chrono::seconds(2);
        char bytes[1 << 14];
        for (std::size_t total = 0; total < most && wait_for(socket_, POLLIN, deadline);) {
            const ssize_t count = ::recv(socket_, bytes, sizeof bytes, 0);
            if (count <= 0) break;
            total += static_cast<std::size_t>(count);
        }
    }
    // From another thread: what waits for this connection ends; or only what waits for bytes of it.
    void end() const { ::shutdown(socket_, SHUT_RDWR); }
    void end_reading() const { ::shutdown(socket_, SHUT_RD); }

    bool is_member = false, is_waiting = true; // under the server's mutex

private:
    static ssize_t take(const std::string& from, std::size_t& begin, char* data, std::size_t size) {
        const std::size_t count = std::min(size, from.size() - begin);
        std::copy_n(from.data() + begin, count, data);
        begin += count;
        return static_cast<ssize_t>(count);
    }

    /// A piece of the body, as recv().
    ssize_t read_body(char* data, std::size_t size) {
        if (pending_.empty()) {
            if (!wait_for(socket_, POLLIN, std::min(body_deadline_, Clock::now() + limits_.pause))) return -1;
            return ::recv(socket_, data, size, 0);
        }
        std::size_t begin = 0;
        const ssize_t count = take(pending_, begin, data, size);
        pending_.erase(0, begin);
        return count;
    }
    void begin_work() {
        if (std::exchange(needs_place_, false)) work_.take();
    }

    socket_t socket_;
    const ConnectionLimits& limits_;
    Place work_, upload_;
    bool needs_place_ = false;
    std::string pending_; // received and not read
    std::string head_;
    std::size_t at_ = 0, left_ = 0;
    Clock::time_point body_deadline_{};
};

GuardedServer::GuardedServer(std::string_view key, ConnectionLimits limits)
    : key_(key), limits_(limits), work_(limits.requests), uploads_(limits.uploads) {
    new_task_queue = [this] { return new ConnectionThreads([this] { stop_waiting(); }); };
}

void GuardedServer::stop_waiting() {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (const auto* list : {&guests_, &members_})
        for (const Connection* connection : *list)
            connection->is_waiting ? connection->end() : connection->end_reading();
    work_.stop(), uploads_.stop();
}

void GuardedServer::enter(Connection& connection) {
    const std::lock_guard lock(mutex_);
    if (guests_.size() >= limits_.guests) {
        guests_.front()->end();
        guests_.splice(guests_.end(), guests_, guests_.begin()); // it leaves by itself
    }
    guests_.push_back(&connection);
    if (stopping_) connection.end();
}

void GuardedServer::leave(Connection& connection) {
    const std::lock_guard lock(mutex_);
    (connection.is_member ? members_ : guests_).remove(&connection);
}

bool GuardedServer::admit(Connection& connection) {
    const std::lock_guard lock(mutex_);
    if (connection.is_member) return true;
    if (members_.size() >= limits_.members) return false;
    guests_.remove(&connection);
    members_.push_back(&connection);
    return connection.is_member = true;
}

bool GuardedServer::process_and_close_socket(socket_t socket) {
    try {
        Connection connection(socket, *this);
        enter(connection);
        try {
            serve(connection);
        } catch (...) { // without memory, for instance; the connection ends
        }
        leave(connection);
    } catch (...) { // without memory for a connection
    }
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
    return true;
}

void GuardedServer::serve(Connection& connection) {
    using Arrival = Connection::Arrival;
    for (bool first = true;; first = false) {
        std::string text;
        const auto arrival = connection.read_head(text, Clock::now() + (first ? limits_.head : limits_.idle));
        if (arrival == Arrival::nothing) return;
        if (arrival != Arrival::head) {
            connection.refuse(arrival == Arrival::too_late ? 408 : 431, arrival == Arrival::too_late
                                                                            ? "the request did not arrive in time"
                                                                            : "the request's head is too long");
            return connection.close_gently(limits_.head_bytes);
        }
        RequestHead head = parse_head(text, key_, limits_);
        constexpr std::size_t rest = std::size_t(1) << 20;
        if (head.status == 0 && head.has_key && !admit(connection))
            head.status = 503, head.refusal = "too many connections; close some pages of gsh-view";
        if (head.status != 0) {
            connection.refuse(head.status, head.refusal);
            return connection.close_gently(head.has_key ? 2 * limits_.body_bytes : rest);
        }
        const auto set_waiting = [&](bool waiting) { // returns whether the server goes on
            const std::lock_guard lock(mutex_);
            connection.is_waiting = waiting;
            return !stopping_;
        };
        if (!set_waiting(false)) return;
        bool closed = false, alive = false;
        try {
            connection.begin(head);
            alive = process_request(connection, !head.has_key, closed, nullptr);
        } catch (const Places::Stopped&) {
            return;
        }
        connection.finish();
        if (!set_waiting(true)) return;
        if (!alive || closed || !head.has_key || connection.has_rest())
            return connection.close_gently(head.has_key ? limits_.body_bytes : rest);
    }
}

void ConnectionThreads::enqueue(std::function<void()> serve) {
    std::erase_if(workers_, [](Worker& worker) {
        if (!worker.done) return false;
        worker.thread.join();
        return true;
    });
    const std::size_t before = workers_.size();
    try {
        Worker& worker = workers_.emplace_back();
        worker.thread = std::thread([&worker, serve] {
            serve();
            worker.done = true;
        });
    } catch (...) { // no more threads, or no memory for one: the accepting thread serves, which is bounded in time
        if (workers_.size() > before) workers_.pop_back();
        serve();
    }
}

void ConnectionThreads::shutdown() {
    stop_();
    for (Worker& worker : workers_) worker.thread.join();
    workers_.clear();
}

} // namespace gsh::programs

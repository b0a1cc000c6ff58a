// SPDX-License-Identifier: Apache-2.0
/// Connections of gsh-view's server: what a client that has no key can hold up, and heads of requests.
#include "raw_client.hpp"
#include "support/contains.hpp"
#include "view/view_connections.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <string>
#include <thread>

using namespace gsh::programs;
using namespace std::chrono_literals;
using gsh::test::RawClient;

namespace {

const std::string server_key = "0123456789abcdef";

/// A server whose answers are the target and the body of the request. /slow takes 20 ms, /large has 32 MB.
class Running {
public:
    explicit Running(ConnectionLimits limits = {}) : server_(server_key, limits) {
        server_.set_pre_routing_handler([](const httplib::Request& request, httplib::Response& response) {
            if (same_key(request.get_param_value("key"), server_key))
                return httplib::Server::HandlerResponse::Unhandled;
            response.status = 403;
            response.set_content("key: is missing\n", "text/plain");
            return httplib::Server::HandlerResponse::Handled;
        });
        server_.Get("/slow", [](const httplib::Request&, httplib::Response& response) {
            std::this_thread::sleep_for(20ms);
            response.set_content("slow\n", "text/plain");
        });
        server_.Get("/large", [](const httplib::Request&, httplib::Response& response) {
            response.set_content(std::string(32'000'000, 'x'), "text/plain");
        });
        server_.Get("/.*", [](const httplib::Request& request, httplib::Response& response) {
            response.set_content("got " + request.path + "\n", "text/plain");
        });
        server_.Post("/.*", [](const httplib::Request& request, httplib::Response& response,
                               const httplib::ContentReader& read) {
            std::string body;
            const bool whole = read([&](const char* data, std::size_t size) {
                body.append(data, size);
                return true;
            });
            response.set_content("got " + request.path + " with " + body + (whole ? "" : " cut") + "\n", "text/plain");
        });
        port_ = server_.bind_to_any_port("127.0.0.1");
        REQUIRE(port_ > 0);
        server_.lengthen_queue();
        thread_ = std::thread([this] { server_.listen_after_bind(); });
        while (!server_.is_running()) std::this_thread::sleep_for(1ms);
    }
    ~Running() { stop(); }
    void stop() {
        server_.stop();
        if (thread_.joinable()) thread_.join();
    }
    [[nodiscard]] int port() const { return port_; }

private:
    GuardedServer server_;
    std::thread thread_;
    int port_ = 0;
};

std::string get(const std::string& path, bool with_key = true, const std::string& fields = {}) {
    return "GET " + path + (with_key ? "?key=" + server_key : "") + " HTTP/1.1\r\nHost: localhost\r\n" + fields +
           "\r\n";
}
std::string post(const std::string& path, const std::string& body, bool with_key = true) {
    return "POST " + path + (with_key ? "?key=" + server_key : "") +
           " HTTP/1.1\r\nHost: localhost\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
}
double seconds_of(const auto& deed) {
    const auto begin = std::chrono::steady_clock::now();
    deed();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

} // namespace

TEST_CASE("gsh-view: heads of requests are read strictly") {
    const ConnectionLimits limits;
    const auto status = [&](const std::string& text) { return parse_head(text, server_key, limits).status; };
    const RequestHead head = parse_head("POST /draw?a=1&key=" + server_key +
                                            "&b HTTP/1.1\r\nHost: x\r\nRange: bytes=0-1\r\n"
                                            "content-length:  12 \r\n\r\n",
                                        server_key, limits);
    CHECK(head.status == 0);
    CHECK(head.has_key);
    CHECK(head.body_bytes == 12);
    CHECK(head.text == "POST /draw?a=1&key=" + server_key + "&b HTTP/1.1\r\nHost: x\r\ncontent-length:  12 \r\n\r\n");
    CHECK(!parse_head(get("/", false), server_key, limits).has_key);
    CHECK(!parse_head("GET /?key=" + server_key + "0 HTTP/1.1\r\n\r\n", server_key, limits).has_key);
    CHECK(!parse_head("GET /?akey=" + server_key + " HTTP/1.1\r\n\r\n", server_key, limits).has_key);
    CHECK(!parse_head("GET /key=" + server_key + " HTTP/1.1\r\n\r\n", server_key, limits).has_key);
    CHECK(status(get("/")) == 0);
    CHECK(status("GET / HTTP/2.0\r\n\r\n") == 400);
    CHECK(status("nonsense\r\n\r\n") == 400);
    CHECK(status("GET / HTTP/1.1") == 400);
    CHECK(status(get("/", true, "no colon\r\n")) == 400);
    CHECK(status(get("/", true, "Content-Length : 1\r\n")) == 400);
    CHECK(status(get("/", true, "host: other\r\n")) == 400);
    CHECK(status(get("/", true, "Origin: a\r\nORIGIN: b\r\n")) == 400);
    CHECK(status("POST / HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n") == 400);
    CHECK(status("POST / HTTP/1.1\r\nContent-Length: +1\r\n\r\n") == 400);
    CHECK(status("POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n") == 400);
    CHECK(status("POST / HTTP/1.1\r\n\r\n") == 411);
    CHECK(status("POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n") == 411);
    CHECK(status("POST /?key=" + server_key + " HTTP/1.1\r\nContent-Length: 99999999999999999999999\r\n\r\n") == 413);
    CHECK(status("POST /?key=" + server_key + " HTTP/1.1\r\nContent-Length: 67108865\r\n\r\n") == 413);
    CHECK(status("POST /?key=" + server_key + " HTTP/1.1\r\nContent-Length: 67108864\r\n\r\n") == 0);
    std::string many;
    for (int i = 0; i < 65; ++i) many += "A: b\r\n";
    CHECK(status(get("/", true, many)) == 431);
}

TEST_CASE("gsh-view: heads that never end hold up nobody") {
    Running server;
    std::deque<RawClient> held;
    for (int i = 0; i < 300; ++i) held.emplace_back(server.port(), "GET / HTTP/1.1\r\nHost: ");
    std::string answer;
    CHECK(seconds_of([&] { answer = RawClient(server.port(), get("/a")).receive("got /a\n"); }) < 2);
    CHECK(answer.starts_with("HTTP/1.1 200"));
    CHECK(answer.ends_with("got /a\n"));
    held[0].receive();
    CHECK(held[0].ended()); // the oldest gave way
}

TEST_CASE("gsh-view: a head has one deadline, however its bytes trickle") {
    Running server({.head = 300ms});
    RawClient client(server.port());
    const auto begin = std::chrono::steady_clock::now();
    while (std::chrono::steady_clock::now() - begin < 2s && client.send("x") && client.receive("\r\n", 50ms).empty()) {
    }
    CHECK(std::chrono::steady_clock::now() - begin < 1s);
    CHECK(client.receive().starts_with("HTTP/1.1 408"));
    RawClient silent(server.port());
    CHECK(seconds_of([&] { silent.receive(); }) < 1);
    CHECK(silent.ended());
    RawClient endless(server.port(), std::string(20'000, 'x'));
    CHECK(endless.receive().starts_with("HTTP/1.1 431"));
}

TEST_CASE("gsh-view: without the key no body is read, and the connection ends") {
    Running server;
    for (const std::string& bytes :
         {get("/a", false), post("/a", "body", false), post("/a", "", false),
          std::string("POST /a HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\n")}) {
        RawClient client(server.port(), bytes + get("/b"));
        std::string answer;
        CHECK(seconds_of([&] { answer = client.receive("key: is missing\n"); }) < 2);
        CHECK(answer.starts_with("HTTP/1.1 403"));
        CHECK(client.receive("got /b", 100ms) != test::contains("got /b"));
    }
    for (const std::string& path : {"/a?key=" + server_key, std::string("/a")}) {
        RawClient client(server.port(), "POST " + path + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
        CHECK(client.receive("Content-Length\n").starts_with("HTTP/1.1 411"));
        RawClient chunked(server.port(),
                          "POST " + path + " HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n");
        CHECK(chunked.receive("chunks\n").starts_with("HTTP/1.1 411"));
    }
    RawClient large(server.port(),
                    "POST /a?key=" + server_key + " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 67108865\r\n\r\n");
    CHECK(large.receive("read\n") == test::contains("64 MiB"));
}

TEST_CASE("gsh-view: requests on one connection are answered in their order, each with its own body") {
    Running server;
    RawClient client(server.port(), post("/a", "one") + get("/b") + post("/c", "three") + post("/d", "f"));
    const std::string answer = client.receive("got /d with f\n");
    const auto a = answer.find("got /a with one\n"), b = answer.find("got /b\n"),
               c = answer.find("got /c with three\n");
    REQUIRE(c != std::string::npos);
    CHECK(a < b);
    CHECK(b < c);
    CHECK(answer.ends_with("got /d with f\n"));
    CHECK(!client.ended());
    client.send(get("/e").substr(0, 20));
    std::this_thread::sleep_for(20ms);
    client.send(get("/e").substr(20));
    CHECK(client.receive("got /e\n").ends_with("got /e\n"));
    // A body that is not read ends the connection: its bytes are no request.
    const std::string hidden = get("/hidden");
    RawClient other(server.port(),
                    get("/f", true, "Content-Length: " + std::to_string(hidden.size()) + "\r\n") + hidden);
    CHECK(other.receive("got /hidden", 500ms) != test::contains("hidden"));
    CHECK(other.receive("got /f\n") == test::contains("got /f\n"));
}

TEST_CASE("gsh-view: many ranges are ignored") {
    Running server;
    std::string ranges = "Range: bytes=0-1";
    for (int i = 0; i < 1000; ++i) ranges += ",0-1";
    RawClient client(server.port(), get("/a", true, ranges + "\r\n"));
    const std::string answer = client.receive("got /a\n");
    CHECK(answer.starts_with("HTTP/1.1 200"));
    CHECK(answer.ends_with("got /a\n"));
}

TEST_CASE("gsh-view: the server ends at once, whatever clients wait for") {
    Running server;
    std::deque<RawClient> held;
    held.emplace_back(server.port(), "GET / HTTP/1.1\r\n");
    held.emplace_back(server.port());
    held.emplace_back(server.port(), get("/a")).receive("got /a\n");    // and then nothing
    held.emplace_back(server.port(), post("/a", "body").substr(0, 70)); // half a body
    std::this_thread::sleep_for(50ms);
    CHECK(seconds_of([&] { server.stop(); }) < 2);
}

TEST_CASE("gsh-view: who reads an answer slowly, or sends a body slowly, delays nobody else") {
    Running server({.requests = 1});
    RawClient reader(server.port(), get("/large"));
    CHECK(reader.receive("200", 3s).starts_with("HTTP/1.1 200")); // and no more of it
    CHECK(RawClient(server.port(), get("/a")).receive("got /a\n", 2s).ends_with("got /a\n"));
    const std::string request = post("/b", "a body");
    RawClient sender(server.port(), request.substr(0, request.size() - 2));
    std::this_thread::sleep_for(50ms);
    CHECK(RawClient(server.port(), get("/c")).receive("got /c\n", 2s).ends_with("got /c\n"));
    sender.send("dy");
    CHECK(sender.receive("a body\n").ends_with("got /b with a body\n"));
}

TEST_CASE("gsh-view: requests are answered in the order in which they came, however many one page sends") {
    Running server({.requests = 1});
    std::string many;
    for (int i = 0; i < 40; ++i) many += get("/slow");
    RawClient greedy(server.port(), many);
    (void)greedy.receive("slow\n");
    double slowest = 0;
    for (int i = 0; i < 3; ++i)
        slowest = std::max(slowest, seconds_of([&] { // behind one request of the other page
                               CHECK(RawClient(server.port(), get("/a")).receive("got /a\n").ends_with("got /a\n"));
                           }));
    CHECK(slowest < 0.3); // all of the other page take 0.8
}

TEST_CASE("gsh-view: few large bodies are held at one time, and small ones do not wait for them") {
    Running server({.uploads = 1, .upload_bytes = 20});
    const std::string body(100, 'b'), answer = body + "\n";
    const auto half = [&](const std::string& fields) {
        return "POST /a?key=" + server_key + " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n" + fields +
               "\r\n" + body.substr(0, 50);
    };
    for (const char* fields : {"", "Expect: 100-continue\r\n"}) {
        CAPTURE(fields);
        RawClient first(server.port(), half(fields));
        std::this_thread::sleep_for(50ms);
        RawClient second(server.port(), post("/b", body));
        CHECK(second.receive(answer, 200ms).empty());
        CHECK(RawClient(server.port(), post("/c", "small")).receive("small\n").ends_with("with small\n"));
        first.send(body.substr(50));
        CHECK(first.receive(answer).ends_with(answer));
        CHECK(second.receive(answer).ends_with(answer));
    }
}

TEST_CASE("gsh-view: many pages that are opened at once are answered without a second try of the system") {
    Running server;
    const double seconds = seconds_of([&] {
        std::deque<RawClient> pages;
        for (int i = 0; i < 60; ++i) pages.emplace_back(server.port(), get("/a"));
        for (RawClient& page : pages) CHECK(page.receive("got /a\n").ends_with("got /a\n"));
    });
    CHECK(seconds < 0.9);
}

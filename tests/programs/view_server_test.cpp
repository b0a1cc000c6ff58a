// SPDX-License-Identifier: Apache-2.0
/// The server of gsh-view: what it answers, what it refuses, and the program around it.
#include "programs/process.hpp"
#include "programs/view_answers.hpp"
#include "programs/view_scenes.hpp"

#include "support/contains.hpp"
#include "view/view_content.hpp"
#include "view/view_page.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"
#include "view/view_server.hpp"

#include <gsh/io/file/gzip.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/loss/metrics.hpp>

#include <httplib.h>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <new>
#include <string>
#include <thread>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;
using test::ViewJson, test::request_for, test::decoded, test::difference, test::header_of;

namespace {

/// A server of the actor on a thread of its own.
class RunningServer {
public:
    explicit RunningServer(ViewServerOptions options = {})
        : scene(test::view_scene({test::view_files().actor}, {test::view_files().stride, test::view_files().reach})),
          server(backend_, scene, options), thread_([this] { server.run(stop_); }) {}
    ~RunningServer() {
        stop_ = true;
        thread_.join();
    }
    RunningServer(const RunningServer&) = delete;
    RunningServer& operator=(const RunningServer&) = delete;

    [[nodiscard]] httplib::Client client() const {
        httplib::Client client("127.0.0.1", server.port());
        client.set_read_timeout(60);
        return client;
    }
    [[nodiscard]] std::string path(const std::string& of) const {
        return of + (of.find('?') == std::string::npos ? '?' : '&') + "key=" + server.key();
    }

private:
    cpu::Threads backend_{2};
    std::atomic<bool> stop_{false};

public:
    ViewScene scene;
    ViewServer server;

private:
    std::thread thread_;
};
RunningServer& running_server() {
    static RunningServer instance;
    return instance;
}

/// Checks that an answer is a refusal: the status, and one line with the words.
void check_refusal(const httplib::Result& answer, int status, const std::vector<std::string>& words) {
    REQUIRE(answer);
    INFO(answer->body.substr(0, 500));
    CHECK(answer->status == status);
    CHECK(answer->body.ends_with("\n"));
    CHECK(std::count(answer->body.begin(), answer->body.end(), '\n') == 1);
    for (const std::string& word : words) {
        INFO("looking for '" << word << "'");
        CHECK(answer->body == test::contains(word));
    }
}

} // namespace

TEST_CASE("gsh-view: the server draws what gsh-animate renders") {
    RunningServer& s = running_server();
    auto client = s.client();
    ViewJson json = request_for(s.scene.sizes());
    const ViewRequest request = parse_view_request(json.dump(), s.scene.sizes());
    const Image<float> picture = test::rendered(s.scene, request);
    const PixelImage truth = quantise(picture.view());
    const auto png = client.Post(s.path("/draw"), json.dump(), "application/json");
    REQUIRE(png);
    CHECK(png->status == 200);
    CHECK(png->get_header_value("Content-Type") == "image/png");
    CHECK(difference(decoded(png->body), truth) == 0);
    json["format"] = "jpeg";
    const auto jpeg = client.Post(s.path("/draw"), json.dump(), "application/json");
    REQUIRE(jpeg);
    CHECK(psnr_of_mse(difference(decoded(jpeg->body), truth)) > 30);
    for (const auto& [field, value] : {std::pair<const char*, ViewJson>{"shadows", false},
                                       {"light_turn", 1.5},
                                       {"show", "ellipsoids"}}) { // each changes the picture, and not for good
        ViewJson other = json;
        other["format"] = "png", other[field] = value;
        const auto changed = client.Post(s.path("/draw"), other.dump(), "application/json");
        REQUIRE(changed);
        INFO(field);
        CHECK(psnr_of_mse(difference(decoded(changed->body), truth)) < 45);
    }
    json["format"] = "png";
    CHECK(client.Post(s.path("/draw"), json.dump(), "application/json")->body == png->body);
}

TEST_CASE("gsh-view: the server sends the page, the scene and its motions") {
    RunningServer& s = running_server();
    auto client = s.client();
    const auto page = client.Get(s.path("/"));
    REQUIRE(page);
    CHECK(page->status == 200);
    CHECK(page->body == make_page());
    CHECK(page->get_header_value("Content-Security-Policy").starts_with("default-src 'none'"));
    const auto scene = client.Get(s.path("/scene"));
    REQUIRE(scene);
    const ViewJson described = ViewJson::parse(scene->body);
    CHECK(described["people"][0]["parents"].size() == 55);
    CHECK(described["people"][0]["motions"][1]["name"] == "reach.npz");
    const auto motion = client.Get(s.path("/motion?person=0&motion=1"));
    REQUIRE(motion);
    CHECK(header_of(motion->body).first["arrays"]["pose"]["shape"] == ViewJson{3, 165});
    const auto gaussians = client.Get(s.path("/gaussians"));
    REQUIRE(gaussians);
    CHECK(header_of(gaussians->body).first["people"][0]["degree"] == 2);
    check_refusal(client.Get(s.path("/motion?person=0&motion=2")), 404, {"motion"});
    check_refusal(client.Get(s.path("/motion?person=1&motion=0")), 404, {"motion"});
    check_refusal(client.Get(s.path("/motion?person=x&motion=0")), 400, {"person", "'x'"});
    check_refusal(client.Get(s.path("/../../etc/passwd")), 404, {"nothing"});
    check_refusal(client.Post(s.path("/report"), "", "text/plain"), 404, {"nothing"});
}

TEST_CASE("gsh-view: a browser on this machine gets nothing compressed, and keeps what does not change") {
    RunningServer& s = running_server();
    auto client = s.client();
    client.set_decompress(false);
    const httplib::Headers browser{{"Accept-Encoding", "gzip, deflate, br"}};
    for (const char* path : {"/", "/scene", "/gaussians", "/motion?person=0&motion=0"}) {
        INFO(path);
        const auto answer = client.Get(s.path(path), browser);
        REQUIRE(answer);
        CHECK(!answer->has_header("Content-Encoding"));
        CHECK(answer->get_header_value("Content-Length") == std::to_string(answer->body.size()));
        CHECK(answer->get_header_value_count("Cache-Control") == 1);
        const std::string caching = answer->get_header_value("Cache-Control");
        CHECK(caching == (path == std::string("/") ? "private, no-cache" : "private, max-age=86400, immutable"));
        const auto head = client.Head(s.path(path), browser);
        REQUIRE(head);
        CHECK(head->status == 200);
        CHECK(head->body.empty());
    }
    const auto page = client.Get(s.path("/"), browser);
    httplib::Headers again = browser;
    again.emplace("If-None-Match", page->get_header_value("ETag"));
    const auto same = client.Get(s.path("/"), again);
    REQUIRE(same);
    CHECK(same->status == 304);
    CHECK(same->body.empty());
    again.erase("If-None-Match"), again.emplace("If-None-Match", "W/\"1-1\"");
    CHECK(client.Get(s.path("/"), again)->body == page->body);
    for (const char* path : {"/scene?key=0", "/motion?person=0&motion=9"}) { // refusals are not kept
        const auto refused = client.Get(path[1] == 's' ? path : s.path(path), browser);
        CHECK(refused->get_header_value("Cache-Control") == "no-store");
    }
}

TEST_CASE("gsh-view: what does not change is made once, and compressed for other machines") {
    std::atomic<int> made{0};
    const std::string text(100'000, 'x');
    const auto make = [&] {
        if (++made == 1) throw std::bad_alloc();
        return text;
    };
    KeptContent page("text/html; charset=utf-8", KeptContent::Caching::ask, make);
    KeptContent numbers("application/octet-stream", KeptContent::Caching::forever, [&] { return text; });
    const auto answer = [](KeptContent& content, const char* address, const char* accepted) {
        httplib::Request request;
        httplib::Response response;
        request.remote_addr = address;
        request.set_header("Accept-Encoding", accepted);
        content.answer(request, response);
        std::string body;
        httplib::DataSink sink;
        sink.write = [&](const char* data, std::size_t size) {
            body.append(data, size);
            return true;
        };
        while (body.size() < response.content_length_)
            REQUIRE(response.content_provider_(body.size(), response.content_length_ - body.size(), sink));
        return std::pair{response.get_header_value("Content-Encoding"), body};
    };
    CHECK_THROWS_AS((void)answer(page, "127.0.0.1", "gzip"), std::bad_alloc); // the next request tries again
    std::vector<std::thread> clients;
    for (int i = 0; i < 8; ++i)
        clients.emplace_back([&] {
            httplib::Request request;
            httplib::Response response;
            page.answer(request, response);
        });
    for (std::thread& client : clients) client.join();
    CHECK(made == 2);
    CHECK(answer(page, "127.0.0.1", "gzip, br") == std::pair{std::string(), text});
    CHECK(answer(page, "192.168.1.5", "br") == std::pair{std::string(), text});
    const auto [encoding, body] = answer(page, "192.168.1.5", "gzip, br");
    CHECK(encoding == "gzip");
    CHECK(body.size() < 1000);
    std::string inflated(text.size(), '\0');
    GzipReader(body, "page").read(inflated.data(), inflated.size());
    CHECK(inflated == text);
    CHECK(answer(numbers, "192.168.1.5", "gzip") == std::pair{std::string(), text});
    CHECK(made == 2);
    for (const char* own : {"127.0.0.1", "127.1.2.3", "::1", "::ffff:127.0.0.1"}) CHECK(is_loopback_address(own));
    for (const char* other : {"", "10.0.0.1", "192.168.1.127", "::ffff:10.0.0.1", "fe80::1"})
        CHECK(!is_loopback_address(other));
}

TEST_CASE("gsh-view: the server reads a motion that is sent, and names no path of its own") {
    RunningServer& s = running_server();
    auto client = s.client();
    const std::string bytes = read_file(test::view_files().reach);
    const auto sent = client.Post(s.path("/motion?person=0&name=..%2F..%2Fmy%20reach.npz"), bytes, "");
    REQUIRE(sent);
    CHECK(sent->status == 200);
    const ViewJson header = header_of(sent->body).first;
    CHECK(header["name"] == "my reach.npz");
    CHECK(header["arrays"]["pose"]["shape"] == ViewJson{3, 165});
    check_refusal(client.Post(s.path("/motion?person=0&name=a.npz"), bytes.substr(0, 300), ""), 400, {"a.npz"});
    check_refusal(client.Post(s.path("/motion?person=0&name=a.npz"), "", ""), 400, {"a.npz"});
    check_refusal(client.Post(s.path("/motion?person=0&name=a.jpg"), "\xFF\xD8\xFF", ""), 400,
                  {"a.jpg", "reads motions as .npz, .bvh, .glb, .gltf, .vrm and .vrma"});
    check_refusal(client.Post(s.path("/motion?person=7&name=a.npz"), bytes, ""), 400, {"person 7"});
    const auto garbage = client.Post(s.path("/motion?person=0&name=%0Aa%22.bvh"), "HIERARCHY\nROOT", "");
    check_refusal(garbage, 400, {".bvh"});
    CHECK(garbage->body != test::contains(std::filesystem::temp_directory_path().string()));
    // A long name keeps its ending, which chooses the reader, and the bytes of UTF-8 remain.
    std::string long_name;
    for (int i = 0; i < 60; ++i) long_name += "%C3%BC";
    const auto long_bvh = client.Post(s.path("/motion?person=0&name=a" + long_name + ".bvh"), "nonsense", "");
    check_refusal(long_bvh, 400, {"\xC3\xBC.bvh:"});
    CHECK(long_bvh->body.find("a\xC3\xBC") == 0);
    CHECK(long_bvh->body != test::contains("zip"));
    const auto named = client.Post(s.path("/motion?person=0&name=%C3%BCber.npz"), bytes, "");
    REQUIRE(named);
    CHECK(header_of(named->body).first["name"] == "\xC3\xBC"
                                                  "ber.npz");
    const auto other = client.Post(s.path("/motion?person=0&name=tube.npz"), read_file(test::view_files().left), "");
    check_refusal(other, 400, {"tube.npz"}); // of a body with other joints
}

TEST_CASE("gsh-view: the server refuses whoever has no key, and pages of other sites") {
    RunningServer& s = running_server();
    auto client = s.client();
    for (const char* path : {"/", "/scene", "/gaussians", "/motion?person=0&motion=0", "/elsewhere"}) {
        check_refusal(client.Get(path), 403, {"key"});
        check_refusal(client.Get(std::string(path) + (std::strchr(path, '?') ? "&" : "?") + "key=0123"), 403, {"key"});
    }
    check_refusal(client.Post("/draw", request_for(s.scene.sizes()).dump(), "application/json"), 403, {"key"});
    std::string near_key = s.server.key();
    near_key.back() = near_key.back() == '0' ? '1' : '0';
    check_refusal(client.Get("/?key=" + near_key), 403, {"key"});
    const auto with = [&](const char* header, const std::string& value) {
        return client.Get(s.path("/scene"), httplib::Headers{{header, value}});
    };
    std::string port = std::to_string(s.server.port());
    port.insert(port.begin(), ':');
    check_refusal(with("Host", "example.com" + port), 403, {"Host"});
    check_refusal(with("Host", "127.0.0.1.example.com"), 403, {"Host"});
    check_refusal(with("Host", "192.168.1.5" + port), 403, {"Host"});
    check_refusal(with("Origin", "http://example.com"), 403, {"Origin"});
    check_refusal(with("Origin", "null"), 403, {"Origin"});
    CHECK(with("Host", "localhost:9999")->status == 200); // as through ssh -L 9999:…
    CHECK(with("Origin", "http://127.0.0.1" + port)->status == 200);
    CHECK(s.server.key().size() == 32);
    CHECK(s.server.url() == "http://127.0.0.1" + port + "/?key=" + s.server.key());
}

TEST_CASE("gsh-view: the server refuses bodies that are too large or not JSON, and goes on") {
    RunningServer& s = running_server();
    auto client = s.client();
    const auto draw = [&](const std::string& body) { return client.Post(s.path("/draw"), body, "application/json"); };
    std::string body = request_for(s.scene.sizes()).dump();
    body.resize(ViewServer::largest_body, ' ');
    CHECK(draw(body)->status == 200);
    check_refusal(draw(body + ' '), 413, {"1 MiB"});
    const std::string long_motion(ViewServer::largest_motion + 1, 'x');
    check_refusal(client.Post(s.path("/motion?person=0&name=a.npz"), long_motion, ""), 413, {"64 MiB"});
    check_refusal(client.Post(s.path("/draw"), std::string(ViewServer::largest_motion + 5000, 'x'), ""), 413, {"MiB"});
    check_refusal(draw("{"), 400, {"request", "JSON"});
    check_refusal(draw(std::string(1000, '\n') + "\x01\n"), 400, {"request"});
    ViewJson json = request_for(s.scene.sizes());
    json["camera"]["t"][0] = "near";
    check_refusal(draw(json.dump()), 400, {"camera.t[0]", "'near'"});
    std::string infinite = request_for(s.scene.sizes()).dump();
    infinite.replace(infinite.find("\"light_turn\":0"), 14, "\"light_turn\":1e999");
    check_refusal(draw(infinite), 400, {"request"});
    check_refusal(client.Put(s.path("/draw"), body, "application/json"), 404, {"nothing"});
    const httplib::MultipartFormDataItems form{{"file", read_file(test::view_files().reach), "reach.npz", ""}};
    client.set_keep_alive(true); // the form is read to its end, so the connection serves the next request
    for (const char* path : {"/draw", "/motion?person=0&name=reach.npz"})
        check_refusal(client.Post(s.path(path), form), 400, {"form", "send JSON, or the bytes of a motion"});
    CHECK(draw(request_for(s.scene.sizes()).dump())->status == 200);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) // these need the addresses themselves
// A process of its own, since memory that other tests have freed would hold the upload.
TEST_CASE("gsh-view: a motion for which memory is short is refused in words, and the server goes on") {
    const test::Process program({"gsh-view", test::view_files().polar});
    std::string line;
    REQUIRE(program.wait_until([&] {
        line = program.out();
        return line.ends_with("\n");
    }));
    httplib::Client client("127.0.0.1", std::stoi(line.substr(17)));
    const std::string key = line.substr(line.find("?key="), line.size() - line.find("?key=") - 1);
    CHECK(client.Get("/scene" + key)->status == 200);
    std::size_t pages = 0;
    std::ifstream("/proc/" + std::to_string(program.id()) + "/statm") >> pages;
    REQUIRE(pages > 0);
    rlimit limit{};
    REQUIRE(::prlimit(program.id(), RLIMIT_AS, nullptr, &limit) == 0);
    limit.rlim_cur = static_cast<rlim_t>(pages) * static_cast<rlim_t>(::sysconf(_SC_PAGESIZE)) + (rlim_t(40) << 20);
    REQUIRE(::prlimit(program.id(), RLIMIT_AS, &limit, nullptr) == 0);
    static const char zeros[4096] = {};
    const auto send = [](std::size_t, std::size_t left, httplib::DataSink& sink) {
        return sink.write(zeros, std::min(left, sizeof zeros));
    };
    check_refusal(client.Post("/motion" + key + "&person=0&name=a.npz", std::size_t(60) << 20, send, ""), 507,
                  {"more memory than the server has"});
    CHECK(client.Get("/scene" + key)->status == 200);
}
#endif

TEST_CASE("gsh-view: an address that cannot be bound is an error") {
    RunningServer& s = running_server();
    cpu::Threads backend(1);
    const ViewScene scene = test::view_scene({test::view_files().cloud});
    const auto bind = [&](const ViewServerOptions& options) { const ViewServer other(backend, scene, options); };
    test::check_throws<IoError>([&] { bind({.port = s.server.port()}); }, {"127.0.0.1", "port"});
    test::check_throws<IoError>([&] { bind({.host = "203.0.113.7"}); }, {"203.0.113.7"});
}

TEST_CASE("gsh-view: the program prints the address, serves, and ends with 130 at Ctrl-C") {
    const auto& files = test::view_files();
    test::Process program({"gsh-view", files.polar, files.dual, "--poses", files.left, "--poses", files.right});
    std::string line;
    REQUIRE(program.wait_until([&] {
        line = program.out();
        return line.ends_with("\n");
    }));
    CHECK(line.starts_with("http://127.0.0.1:"));
    const std::string port = line.substr(17, line.find('/', 17) - 17), path = line.substr(line.find("/?key="));
    httplib::Client client("127.0.0.1", std::stoi(port));
    const auto page = client.Get(path.substr(0, path.size() - 1));
    REQUIRE(page);
    CHECK(page->status == 200);
    const auto begin = std::chrono::steady_clock::now();
    program.send(SIGINT);
    const test::Outcome outcome = program.wait();
    CHECK(outcome.code == 130);
    CHECK(outcome.err.empty());
    CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(10));

    using test::check_refused, test::run;
    check_refused(run({"gsh-view", (files.folder / "none.gsh").string()}), "gsh-view", {"none.gsh"});
    check_refused(run({"gsh-view", files.polar, files.dual, "--poses", files.left}), "gsh-view", {"--poses", "1", "2"});
    check_refused(run({"gsh-view", files.polar, "--poses", files.stride}), "gsh-view", {"joints"});
    check_refused(run({"gsh-view", files.polar, "--port", "70000"}), "gsh-view", {"--port"});
    check_refused(run({"gsh-view", files.polar, "--host", "203.0.113.7"}), "gsh-view", {"203.0.113.7"});
}

TEST_CASE("gsh-view: --host warns, and then addresses count as its own") {
    const auto& files = test::view_files();
    test::Process program({"gsh-view", files.cloud, "--host", "0.0.0.0"});
    REQUIRE(program.wait_until([&] { return program.out().ends_with("\n"); }));
    CHECK(program.err() == test::contains("warning: --host 0.0.0.0"));
    const std::string line = program.out();
    httplib::Client client("127.0.0.1", std::stoi(line.substr(17)));
    const std::string path = line.substr(line.find("/?key="), 38);
    CHECK(client.Get(path, httplib::Headers{{"Host", "192.168.1.5:80"}})->status == 200);
    check_refusal(client.Get(path, httplib::Headers{{"Host", "example.com"}}), 403, {"Host", "numeric address"});
    program.send(SIGTERM);
    CHECK(program.wait().code == 130);
}

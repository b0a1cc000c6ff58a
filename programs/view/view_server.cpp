// SPDX-License-Identifier: Apache-2.0
#include "view/view_server.hpp"

#include "common/memory_reserve.hpp"
#include "common/messages.hpp"
#include "view/jpeg.hpp"
#include "view/view_connections.hpp"
#include "view/view_content.hpp"
#include "view/view_package.hpp"
#include "view/view_page.hpp"
#include "view/view_painter.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/image/image_file.hpp>

#include <httplib.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <new>
#include <random>
#include <stdexcept>
#include <string_view>
#include <thread>
#include <vector>

namespace gsh::programs {

namespace {

using httplib::Request;
using httplib::Response;

/// A refusal with its status.
struct Refused {
    int status;
    std::string message;
};

std::string new_key() {
    std::random_device random; // the system's, not a sequence
    std::string key;
    for (int i = 0; i < 32; ++i) key += "0123456789abcdef"[random() % 16];
    return key;
}

/// The name in "name:port", "name" or "[address]:port".
std::string_view host_name(std::string_view host) {
    if (host.starts_with('[')) return host.substr(0, std::min(host.find(']') + 1, host.size()));
    return host.substr(0, std::min(host.rfind(':'), host.size()));
}

bool is_loopback(std::string_view host) {
    return host == "127.0.0.1" || host == "localhost" || host == "[::1]" || host == "::1";
}

/// An IPv4 or IPv6 address. Unlike a name, it cannot be pointed at this machine by another site.
bool is_address(std::string_view host) {
    if (host.starts_with('[')) return host.ends_with(']');
    return !host.empty() && host.find_first_not_of("0123456789.") == std::string_view::npos;
}

std::size_t index_of(const Request& request, const char* name) {
    const std::string text = request.get_param_value(name);
    std::size_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc() || end != text.data() + text.size())
        throw Refused{400, std::string(name) + ": is '" + text.substr(0, 40) + "', expected a number from 0"};
    return value;
}

/// A rate in frames per second, or 0 if the request has none.
double rate_of(const Request& request, const char* name) {
    const std::string text = request.get_param_value(name);
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (!text.empty() && (error != std::errc() || end != text.data() + text.size() || !(value > 0 && value <= 1e5)))
        throw Refused{400, std::string(name) + ": is '" + text.substr(0, 40) + "', expected frames per second"};
    return value;
}

void refuse(Response& response, int status, const std::string& message) {
    response.status = status;
    response.set_content(one_line(message.substr(0, 2000)) + "\n", "text/plain; charset=utf-8");
}

/// Does the work of a request and turns whatever is thrown into a refusal.
template <class Work>
void answer(Response& response, const Work& work) {
    try {
        work();
    } catch (const Refused& refused) {
        refuse(response, refused.status, refused.message);
    } catch (const std::bad_alloc&) {
        set_memory_aside(); // anew
        refuse(response, 507, "this takes more memory than the server has");
    } catch (const std::length_error&) { // of a container
        refuse(response, 507, "this takes more memory than the server has");
    } catch (const std::exception& error) {
        refuse(response, 400, error.what());
    }
}

/// Reads a body of at most `most` bytes. What is beyond is read, too, so that the client sees the answer, but not kept.
std::string read_body(const Request& request, const httplib::ContentReader& read, std::size_t most) {
    if (request.is_multipart_form_data()) { // which httplib hands out part by part only
        read([](const httplib::MultipartFormData&) { return true; }, [](const char*, std::size_t) { return true; });
        throw Refused{400, "the body is a form; send JSON, or the bytes of a motion"};
    }
    std::string body;
    std::size_t size = 0;
    const bool whole = read([&](const char* data, std::size_t length) {
        size += length;
        if (size <= most)
            body.append(data, length);
        else
            body.clear();
        return size <= ViewServer::largest_motion;
    });
    if (size > most || request.get_header_value<std::uint64_t>("Content-Length") > most)
        throw Refused{413, "the body is larger than " + std::to_string(most >> 20) + " MiB, the most that is read"};
    if (!whole) throw Refused{400, "the body ended early"};
    return body;
}

} // namespace

/// Stops a server when a flag is set. Its thread starts with it: where there are no more threads, the error arrives
/// before the address is told.
class Stopper {
public:
    explicit Stopper(httplib::Server& server) : server_(&server) {}
    ~Stopper() {
        ended_ = true;
        thread_.join();
    }
    Stopper(const Stopper&) = delete;
    Stopper& operator=(const Stopper&) = delete;

    /// Looks at a flag as long as this object lives, also after an error of the server.
    class Watching {
    public:
        Watching(Stopper& stopper, const std::atomic<bool>& flag) : stopper_(&stopper) { stopper.watch(&flag); }
        ~Watching() { stopper_->watch(nullptr); }
        Watching(const Watching&) = delete;
        Watching& operator=(const Watching&) = delete;

    private:
        Stopper* stopper_;
    };

private:
    void watch(const std::atomic<bool>* flag) {
        const std::lock_guard lock(changing_);
        flag_ = flag;
    }
    void look() {
        while (!ended_) {
            {
                const std::lock_guard lock(changing_);
                if (flag_ && *flag_) server_->stop(); // again and again: it has no effect before the server runs
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
    }

    httplib::Server* server_;
    std::mutex changing_;
    const std::atomic<bool>* flag_ = nullptr;
    std::atomic<bool> ended_{false};
    std::thread thread_{[this] { look(); }}; // last, so that it finds all the others made
};

class ViewServer::Implementation {
public:
    Implementation(cpu::Threads& backend, const ViewScene& scene, const ViewServerOptions& options)
        : backend_(&backend), scene_(&scene), options_(options), sizes_(scene.sizes()), painter_(backend, scene) {
        server_.set_keep_alive_max_count(1'000'000);
        server_.set_keep_alive_timeout(30); // seconds; ConnectionLimits::idle
        server_.set_payload_max_length(largest_motion + 1);
        server_.set_tcp_nodelay(true);
        server_.set_socket_options([](socket_t socket) {
            const int yes = 1; // httplib's default (SO_REUSEPORT) lets two servers share a port
            setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        });
        server_.set_default_headers(
            {{"Cache-Control", "no-store"},
             {"X-Content-Type-Options", "nosniff"},
             {"Referrer-Policy", "no-referrer"},
             {"Content-Security-Policy",
              "default-src 'none'; script-src 'unsafe-inline' blob:; worker-src blob:; style-src 'unsafe-inline'; "
              "img-src blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"}});
        server_.set_pre_routing_handler([this](const Request& request, Response& response) { // before the body is read
            const std::string why = refusal(request);
            if (why.empty()) return httplib::Server::HandlerResponse::Unhandled;
            refuse(response, 403, why);
            return httplib::Server::HandlerResponse::Handled;
        });
        server_.set_error_handler([](const Request&, Response& response) {
            if (!response.body.empty()) return;
            refuse(response, response.status,
                   response.status == 413   ? "the body is larger than 64 MiB, the most that is read"
                   : response.status == 404 ? "there is nothing at this address"
                                            : "the request is not understood");
        });
        add_routes();
        port_ = options.port == 0 ? server_.bind_to_any_port(options.host)
                                  : (server_.bind_to_port(options.host, options.port) ? options.port : -1);
        if (port_ < 0)
            throw IoError(options.host + ":" + std::to_string(options.port) +
                          " cannot be bound; the address is not of this machine, or the port is in use (--port)");
        server_.lengthen_queue();
    }

    void run(const std::atomic<bool>& stop) {
        const Stopper::Watching watching(stopper_, stop);
        server_.listen_after_bind();
    }

    [[nodiscard]] int port() const { return port_; }
    [[nodiscard]] const std::string& key() const { return key_; }
    [[nodiscard]] std::string url() const {
        const std::string host = options_.host == "0.0.0.0" || options_.host == "::" ? "127.0.0.1" : options_.host;
        return "http://" + (host.find(':') == std::string::npos ? host : '[' + host + ']') + ':' +
               std::to_string(port_) + "/?key=" + key_;
    }

private:
    /// Why a request is refused before its body is read, or nothing.
    [[nodiscard]] std::string refusal(const Request& request) const {
        const std::string host = request.get_header_value("Host"), origin = request.get_header_value("Origin");
        const std::string_view name = host_name(host);
        const bool local = is_loopback(options_.host);
        const bool own = is_loopback(name) || (!local && (is_address(name) || name == options_.host));
        if (!own)
            return std::string("Host: is not an address of this server") + (local ? "" : "; use a numeric address");
        if (!origin.empty() && origin != "http://" + host) return "Origin: another page asks for this";
        if (!same_key(request.get_param_value("key"), key_))
            return "key: is missing or wrong; open the address that gsh-view printed";
        return {};
    }

    void add_routes() {
        server_.Get("/", [this](const Request& request, Response& response) { page_.answer(request, response); });
        server_.Get("/scene", [this](const Request& request, Response& response) {
            answer(response, [&] { described_.answer(request, response); });
        });
        server_.Get("/gaussians", [this](const Request& request, Response& response) {
            answer(response, [&] { gaussians_.answer(request, response); });
        });
        server_.Get("/motion", [this](const Request& request, Response& response) {
            answer(response, [&] {
                const std::size_t p = index_of(request, "person"), m = index_of(request, "motion");
                if (p >= scene_->motions.size() || m >= scene_->motions[p].size())
                    throw Refused{404, "motion: does not exist"};
                KeptContent("application/octet-stream", Caching::forever,
                            [&] { // small, and the browser keeps it
                                return package_motion(scene_->motions[p][m]);
                            })
                    .answer(request, response);
            });
        });
        server_.Post("/draw", [this](const Request& request, Response& response, const httplib::ContentReader& read) {
            answer(response, [&] { draw(read_body(request, read, largest_body), response); });
        });
        server_.Post("/motion", [this](const Request& request, Response& response, const httplib::ContentReader& read) {
            answer(response, [&] {
                const std::string bytes = read_body(request, read, largest_motion);
                std::vector<std::string> warnings;
                const ViewMotion motion =
                    read_sent_motion(*scene_, index_of(request, "person"), request.get_param_value("name"), bytes,
                                     warnings, rate_of(request, "fps"));
                response.set_content(package_motion(motion, warnings), "application/octet-stream");
            });
        });
        if (!options_.report) return;
        server_.Post("/report", [this](const Request& request, Response& response, const httplib::ContentReader& read) {
            answer(response, [&] {
                options_.report(read_body(request, read, largest_motion));
                response.set_content("thanks\n", "text/plain");
            });
        });
    }

    void draw(const std::string& body, Response& response) {
        const ViewRequest request = parse_view_request(body, sizes_);
        PixelImage pixels;
        {
            const std::lock_guard lock(painting_);
            pixels = quantise_on(*backend_, painter_.draw(request));
        }
        constexpr int quality = 90;
        if (request.lossless)
            response.set_content(encode_png(pixels), "image/png");
        else
            response.set_content(encode_jpeg(pixels, quality), "image/jpeg");
    }

    cpu::Threads* backend_;
    const ViewScene* scene_;
    ViewServerOptions options_;
    std::vector<PersonSize> sizes_;
    ViewPainter painter_;
    std::mutex painting_;
    // The key is new for each server, so what is at an address with it never changes.
    using Caching = KeptContent::Caching;
    KeptContent page_{"text/html; charset=utf-8", Caching::ask, [this] { return make_page({}, options_.script); }};
    KeptContent described_{"application/json", Caching::forever, [this] { return describe(*scene_); }};
    KeptContent gaussians_{"application/octet-stream", Caching::forever, [this] { return package_scene(*scene_); }};
    const std::string key_ = new_key();
    GuardedServer server_{key_, {.body_bytes = largest_motion}};
    Stopper stopper_{server_};
    int port_ = 0;
};

ViewServer::ViewServer(cpu::Threads& backend, const ViewScene& scene, const ViewServerOptions& options)
    : implementation_(std::make_unique<Implementation>(backend, scene, options)) {}
ViewServer::~ViewServer() = default;

int ViewServer::port() const {
    return implementation_->port();
}
const std::string& ViewServer::key() const {
    return implementation_->key();
}
std::string ViewServer::url() const {
    return implementation_->url();
}
void ViewServer::run(const std::atomic<bool>& stop) {
    implementation_->run(stop);
}

} // namespace gsh::programs

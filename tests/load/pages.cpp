// SPDX-License-Identifier: Apache-2.0
/// gsh-view's server under many pages: half of them read slowly, and some vanish in the middle of an answer.
#include "load/load.hpp"

#include "programs/raw_client.hpp"
#include "programs/view_answers.hpp"
#include "programs/view_scenes.hpp"

#include "view/view_scene.hpp"
#include "view/view_server.hpp"

#include <gsh/backend/threads.hpp>

#include <httplib.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <mutex>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

namespace gsh::load {

namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr int slow_buffer = 4096; // bytes that the kernel keeps for a slow reader

std::size_t thread_count() {
    std::size_t count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator("/proc/self/task")) ++count;
    return count;
}

/// What pages report.
struct Frames {
    std::mutex mutex;
    std::vector<double> milliseconds;      ///< from a request to its picture, of pages that read at once
    std::vector<std::size_t> of_each_page; ///< pictures of each page, the slow ones last
    std::size_t errors = 0, vanished = 0;
    std::string first_error = {};

    void add_error(const std::string& what) {
        if (errors++ == 0) first_error = what;
    }
};

} // namespace

void serve_pages(std::size_t pages, double seconds, Verdict& verdict) {
    const std::size_t slow = pages / 2;
    const std::chrono::duration<double> time(seconds);
    cpu::Threads backend;
    const programs::ViewScene scene =
        test::view_scene({test::view_files().actor}, {test::view_files().stride, test::view_files().reach});
    programs::ViewServer server(backend, scene);
    std::atomic<bool> stop_server{false}, stop_pages{false}, measuring{false};
    std::thread serving([&] { server.run(stop_server); });
    const std::string path = "/draw?key=" + server.key();
    const auto request = [&](const char* format, int size) {
        test::ViewJson json = test::request_for(scene.sizes(), size);
        json["format"] = format;
        return json.dump();
    };
    const std::string quick_body = request("jpeg", 270), slow_body = request("png", 540);
    const auto whole_request = [&](const std::string& body) {
        return "POST " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: " + std::to_string(body.size()) +
               "\r\n\r\n" + body;
    };
    if (const auto first = httplib::Client("127.0.0.1", server.port()).Post(path, quick_body, "application/json");
        !first || first->status != 200)
        throw std::runtime_error("the server does not answer");
    std::this_thread::sleep_for(100ms);                // until the connection has ended
    const std::size_t threads_before = thread_count(); // with those of the backend, which the first picture starts

    Frames frames;
    frames.of_each_page.assign(pages, 0);
    const auto quick_page = [&](std::size_t page) {
        httplib::Client client("127.0.0.1", server.port());
        client.set_keep_alive(true);
        client.set_read_timeout(60);
        while (!stop_pages) {
            const auto begin = Clock::now();
            const auto answer = client.Post(path, quick_body, "application/json");
            const std::chrono::duration<double, std::milli> took = Clock::now() - begin;
            const std::lock_guard lock(frames.mutex);
            if (!answer || answer->status != 200)
                frames.add_error(answer ? std::to_string(answer->status) + " " + answer->body
                                        : "no answer: " + httplib::to_string(answer.error()) + " after " +
                                              std::to_string(took.count()) + " ms");
            else if (measuring)
                ++frames.of_each_page[page], frames.milliseconds.push_back(took.count());
        }
    };
    const auto slow_page = [&](std::size_t page) { // about 80 kB a second
        test::RawClient client(server.port(), {}, slow_buffer);
        std::string answer;
        bool asked = false;
        while (!stop_pages) {
            if (!asked) {
                if (!client.send(whole_request(slow_body))) break;
                asked = true, answer.clear();
            }
            const std::string block = client.receive_block(2000ms);
            answer += block;
            const std::size_t head = answer.find("\r\n\r\n"), field = answer.find("Content-Length: ");
            if (head != std::string::npos && field < head &&
                answer.size() >= head + 4 + std::stoul(answer.substr(field + 16))) {
                asked = false;
                const std::lock_guard lock(frames.mutex);
                if (answer.starts_with("HTTP/1.1 200"))
                    ++frames.of_each_page[page];
                else
                    frames.add_error(answer);
            }
            std::this_thread::sleep_for(100ms);
        }
    };
    std::vector<std::thread> threads;
    for (std::size_t page = 0; page < pages - slow; ++page) threads.emplace_back(quick_page, page);
    const auto with_connection = [&](const auto& page) {
        try {
            page();
        } catch (const std::system_error& error) {
            const std::lock_guard lock(frames.mutex);
            frames.add_error(error.what());
        }
    };
    for (std::size_t page = pages - slow; page < pages; ++page)
        threads.emplace_back([&, page] { with_connection([&] { slow_page(page); }); });
    const auto vanishing_page = [&] {
        for (; !stop_pages; std::this_thread::sleep_for(200ms)) { // asks, and closes while the answer is made or sent
            test::RawClient client(server.port(), {}, slow_buffer);
            if (client.send(whole_request(slow_body))) ++frames.vanished;
            if (frames.vanished % 2 == 0) (void)client.receive_block(1000ms);
        }
    };
    threads.emplace_back([&] { with_connection(vanishing_page); });
    const auto begin = Clock::now();
    std::size_t warm = 0, largest = 0;
    while (Clock::now() - begin < time) {
        std::this_thread::sleep_for(200ms);
        if (!measuring && Clock::now() - begin > time / 5) measuring = true, warm = resident();
        largest = std::max(largest, resident());
    }
    stop_pages = true;
    for (std::thread& thread : threads) thread.join();
    const auto deadline = Clock::now() + 40s; // a connection without a request ends after 30
    while (thread_count() > threads_before && Clock::now() < deadline) std::this_thread::sleep_for(100ms);
    const std::size_t threads_after = thread_count();
    stop_server = true;
    serving.join();

    std::sort(frames.milliseconds.begin(), frames.milliseconds.end());
    const std::size_t count = frames.milliseconds.size();
    if (count < 20) throw std::runtime_error("only " + std::to_string(count) + " pictures; give more seconds");
    const double median = frames.milliseconds[count / 2], tenth = frames.milliseconds[count - 10],
                 most = frames.milliseconds.back();
    const auto [fewest, greatest] =
        std::minmax_element(frames.of_each_page.begin(), frames.of_each_page.end() - static_cast<std::ptrdiff_t>(slow));
    const std::size_t fewest_slow =
        *std::min_element(frames.of_each_page.end() - static_cast<std::ptrdiff_t>(slow), frames.of_each_page.end());
    verdict.line(tenth <= 3 * median, std::to_string(count) + " pictures for " + std::to_string(pages - slow) +
                                          " pages that read at once: median " + std::to_string(median) +
                                          " ms, tenth-slowest " + std::to_string(tenth) + ", slowest " +
                                          std::to_string(most) + "; allowed for the tenth-slowest: 3 medians");
    verdict.line(*fewest * 2 >= *greatest && fewest_slow > 0,
                 "each of them has " + std::to_string(*fewest) + " to " + std::to_string(*greatest) +
                     " pictures, each slow reader at least " + std::to_string(fewest_slow));
    verdict.line(frames.errors == 0, std::to_string(frames.errors) + " errors" +
                                         (frames.errors ? ", the first: " + frames.first_error : ""));
    const double growth = static_cast<double>(largest) - static_cast<double>(warm);
    verdict.line(growth <= 64e6, "memory: " + megabytes(static_cast<double>(warm)) + " after a fifth of the time, " +
                                     megabytes(growth) + " more at most; allowed 64 MB");
    verdict.line(threads_after <= threads_before, std::to_string(frames.vanished) + " pages vanished; " +
                                                      std::to_string(threads_before) + " threads before, " +
                                                      std::to_string(threads_after) + " after all pages are closed");
}

} // namespace gsh::load

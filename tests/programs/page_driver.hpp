// SPDX-License-Identifier: Apache-2.0
/// @file  Drives pages of gsh-view in a browser: scripts with a user's gestures, what they report, and their pictures.
#pragma once

#include "programs/browser.hpp"

#include <gsh/image/image.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <httplib.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace gsh::test {

/// What every script begins with: reports, and the gestures of a user.
inline constexpr const char* page_gestures = R"js(
const send = (name, content) =>
  fetch(globalThis.reportTo || "report" + location.search, { method: "POST", body: new Blob([name + "\n", content]),
    mode: globalThis.reportTo ? "no-cors" : "cors" });
const check = (what, good) => send("check", (good ? "good " : "bad ") + what);
const view = gsh.view, find = (text) => document.querySelector(text);
const drag = async (slider, value) => {
  slider.value = value;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  await view.nextPicture();
};
const press = (label) => [...document.querySelectorAll("button")].find((b) => b.textContent === label).click();
const press_label = (label) => document.querySelector(`button[aria-label="${label}"]`).click();
const choose = (select, value) => {
  select.value = value;
  select.dispatchEvent(new Event("change", { bubbles: true }));
};
const shoot = async (name) => {
  await view.nextPicture();
  await send("request " + name, JSON.stringify({ ...view.request(), format: "png", occlusion: undefined }));
  await send("picture " + name, await view.picture());
};
const until = async (what) => {
  for (let n = 0; n < 1200; ++n) {
    if (what()) return true;
    await new Promise((done) => setTimeout(done, 25));
  }
  return false;
};
window.addEventListener("error", (event) => send("check", "bad script: " + event.message));
window.addEventListener("unhandledrejection", (event) => send("check", "bad script: " + event.reason));
)js";

/// What the scripts reported.
class PageReports {
public:
    void take(const std::string& body) {
        const std::lock_guard lock(mutex_);
        const std::size_t line = body.find('\n');
        const std::string name = body.substr(0, line), content = body.substr(line + 1);
        if (name == "check")
            checks_.push_back(content);
        else
            others_[name] = content;
        if (name == "done" || content.starts_with("bad script")) done_ = true;
        arrived_.notify_all();
    }
    /// Waits for the end of the last script, or for a failure.
    bool wait(std::chrono::seconds most) {
        std::unique_lock lock(mutex_);
        return arrived_.wait_for(lock, most, [&] { return done_; });
    }
    [[nodiscard]] const std::vector<std::string>& checks() const { return checks_; }
    [[nodiscard]] const std::map<std::string, std::string>& others() const { return others_; }

private:
    std::mutex mutex_;
    std::condition_variable arrived_;
    bool done_ = false;
    std::vector<std::string> checks_;
    std::map<std::string, std::string> others_;
};

/// A server of one page that knows nothing of gsh. It counts what else is asked for.
struct PlainServer {
    PlainServer(const std::string& page, PageReports& reports) {
        server.Get("/", [&page](const httplib::Request&, httplib::Response& response) {
            response.set_content(page, "text/html; charset=utf-8");
        });
        server.Get("/narrow", [](const httplib::Request&, httplib::Response& response) { // in a frame like a phone
            response.set_content("<!doctype html><link rel=\"icon\" href=\"data:,\">"
                                 "<iframe src=\"/\" width=320 height=640 style=\"border:0\"></iframe>",
                                 "text/html; charset=utf-8");
        });
        server.Post("/report",
                    [&reports](const httplib::Request& request, httplib::Response&) { reports.take(request.body); });
        server.set_error_handler([this](const httplib::Request&, httplib::Response&) { ++foreign; });
        server.set_keep_alive_timeout(1);
        port = server.bind_to_any_port("127.0.0.1");
        thread = std::thread([this] { server.listen_after_bind(); });
    }
    ~PlainServer() {
        server.stop();
        thread.join();
    }
    httplib::Server server;
    int port = 0;
    std::atomic<int> foreign{0};
    std::thread thread;
};

inline std::string filled_in(std::string script, const std::string& word, const std::string& value) {
    for (std::size_t at = 0; (at = script.find(word, at)) != std::string::npos; at += value.size())
        script.replace(at, word.size(), value);
    return script;
}

/// PSNR in dB of a picture that the page sent, against one of ours; 200 for equal ones.
inline double psnr_of(const std::string& png, const Image<float>& truth) {
    const Temporary folder;
    write_file(folder / "picture.png", png, Sync::none);
    const PixelImage a = read_image(folder / "picture.png"), b = quantise(truth.view());
    REQUIRE(a.width == b.width);
    REQUIRE(a.height == b.height);
    double sum = 0;
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x)
            for (int c = 0; c < 3; ++c) sum += std::pow((a.pixel(y, x)[c] - b.pixel(y, x)[c]) / 255.0, 2);
    return sum == 0 ? 200 : -10 * std::log10(sum / (3.0 * a.width * a.height));
}

} // namespace gsh::test

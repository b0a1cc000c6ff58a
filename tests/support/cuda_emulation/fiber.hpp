// SPDX-License-Identifier: Apache-2.0
/// @file  Functions that can be suspended: each runs on a stack of its own, which AddressSanitizer is told about.
#pragma once

#include <boost/context/fiber.hpp>
#include <boost/context/stack_context.hpp>

#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#if defined(__SANITIZE_ADDRESS__)
#define GSH_ADDRESS_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define GSH_ADDRESS_SANITIZER 1
#endif
#endif

#if defined(GSH_ADDRESS_SANITIZER)
#include <sanitizer/common_interface_defs.h>
#endif

namespace gsh::test {

/// Stacks that fibers use one after the other, since reserving memory costs more than a switch.
class FiberStacks {
public:
    static constexpr std::size_t size = std::size_t(256) << 10; // a kernel under a sanitizer needs large frames

    static FiberStacks& instance() {
        static FiberStacks stacks;
        return stacks;
    }
    [[nodiscard]] char* take() {
        if (free_.empty()) return (all_.push_back(std::make_unique<char[]>(size)), all_.back().get());
        char* const stack = free_.back();
        free_.pop_back();
        return stack;
    }
    void give_back(char* stack) { free_.push_back(stack); }

private:
    std::vector<std::unique_ptr<char[]>> all_;
    std::vector<char*> free_;
};

/// Runs a function until it returns or calls suspend. The function must not throw.
class Fiber {
public:
    explicit Fiber(std::function<void(Fiber&)> work)
        : stack_(FiberStacks::instance().take()), work_(std::move(work)),
          inside_(std::allocator_arg,
                  boost::context::preallocated(stack_ + FiberStacks::size, FiberStacks::size,
                                               {FiberStacks::size, stack_ + FiberStacks::size}),
                  KeepStack{}, [this](boost::context::fiber&& outside) {
                      outside_ = std::move(outside);
                      finish_switch(nullptr, &caller_bottom_, &caller_size_);
                      work_(*this);
                      done_ = true;
                      start_switch(nullptr, caller_bottom_, caller_size_); // the stack is not used again
                      return std::move(outside_);
                  }) {}
    Fiber(const Fiber&) = delete;
    ~Fiber() { FiberStacks::instance().give_back(stack_); }

    [[nodiscard]] bool done() const { return done_; }

    /// Continues the function; returns when it suspends or ends.
    void resume() {
        void* fake_stack = nullptr;
        start_switch(&fake_stack, stack_, FiberStacks::size);
        inside_ = std::move(inside_).resume();
        finish_switch(fake_stack, nullptr, nullptr);
    }

    /// Called by the function: returns to the caller of resume until it is called again.
    void suspend() {
        void* fake_stack = nullptr;
        start_switch(&fake_stack, caller_bottom_, caller_size_);
        outside_ = std::move(outside_).resume();
        finish_switch(fake_stack, &caller_bottom_, &caller_size_);
    }

private:
    /// The stack belongs to FiberStacks.
    struct KeepStack {
        [[nodiscard]] boost::context::stack_context allocate() const { return {}; }
        void deallocate(boost::context::stack_context&) const {}
    };

    static void start_switch([[maybe_unused]] void** fake_stack, [[maybe_unused]] const void* bottom,
                             [[maybe_unused]] std::size_t size) {
#if defined(GSH_ADDRESS_SANITIZER)
        __sanitizer_start_switch_fiber(fake_stack, bottom, size);
#endif
    }
    static void finish_switch([[maybe_unused]] void* fake_stack, [[maybe_unused]] const void** bottom,
                              [[maybe_unused]] std::size_t* size) {
#if defined(GSH_ADDRESS_SANITIZER)
        __sanitizer_finish_switch_fiber(fake_stack, bottom, size);
#endif
    }

    char* stack_;
    std::function<void(Fiber&)> work_;
    const void* caller_bottom_ = nullptr;
    std::size_t caller_size_ = 0;
    bool done_ = false;
    boost::context::fiber outside_, inside_; // last: starts when everything else is initialised
};

} // namespace gsh::test

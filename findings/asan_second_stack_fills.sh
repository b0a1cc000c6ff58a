#!/usr/bin/env bash
# AddressSanitizer of GCC 12.2 (libasan8 of Debian 12), with detect_stack_use_after_return=1: some ten thousand
# exceptions make every later call of the thread slower, hundreds of times.
#
# Expected: an exception costs what unwinding costs, and calls after it are as fast as before.
# Seen: with this check, local variables live on a second stack, from which a returning function gives its place back. A
#   function that an exception leaves does not, and not all such places are found again. When all places of a size are
#   taken, each call looks through all of them before it falls back to the plain stack. It stays so for the thread's
#   life, also where nothing throws any more. Another thread has a second stack of its own and is fast.
# Output: the time of a call of 40 nested functions that do not throw, as a multiple of the time before any exception:
#   about 1 after 1,000 exceptions, 200 to 300 after 20,000, 1 in another thread, and 1 without the check.
# Matters: a fuzzer, or a test that reads thousands of damaged files, throws so often. A test of readers took 500 s in
#   place of 33 s. GCC turns the check on by ASAN_OPTIONS only; Clang turns it on by itself on Linux since version 15.
# It needs g++ 12 and apt's package lists of Debian 12 (bookworm); the library is unpacked here, not installed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
apt-get download libasan8=12.2.0-14+deb12u1 >log.txt 2>&1
dpkg -x libasan8_*.deb asan
cat >calls.cpp <<'CPP'
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <thread>

char* volatile seen;

// The address of its array leaves a function, so that the array is on the second stack.
__attribute__((noinline)) void nested(int depth, bool fails) {
    char local[64];
    local[0] = 1, seen = local;
    if (depth > 0) nested(depth - 1, fails);
    else if (fails) throw std::runtime_error("");
    asm volatile("" ::: "memory");
}

double seconds(int calls) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < calls; ++i) nested(39, false);
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / calls;
}

void fail(int times) {
    for (int i = 0; i < times; ++i) {
        try { nested(39, true); } catch (const std::exception&) {}
    }
}

int main() {
    (void)seconds(20000);
    const double before = seconds(20000);
    fail(1000);
    const double early = seconds(2000) / before;
    fail(19000);
    const double late = seconds(2000) / before;
    double other = 0;
    std::thread([&] { (void)seconds(2000), other = seconds(20000) / before; }).join();
    std::printf("%.1f after 1,000 exceptions, %.1f after 20,000, %.1f in another thread\n", early, late, other);
    return early < 8 && other < 8 ? (late > 20 ? 0 : late < 8 ? 1 : 2) : 2; // 0: slow, 1: fast, 2: something else
}
CPP
g++ -O1 -fsanitize=address calls.cpp -o calls -pthread
run() { LD_LIBRARY_PATH=asan/usr/lib/$(uname -m)-linux-gnu ASAN_OPTIONS=detect_stack_use_after_return=$1 ./calls; }
echo "with the check:" && run 1 || { echo "changed: calls stay fast"; exit 1; }
status=0
echo "without the check:" && run 0 || status=$?
[ $status -eq 1 ] || { echo "changed: calls without the check"; exit 1; }

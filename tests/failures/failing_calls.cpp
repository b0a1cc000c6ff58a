// SPDX-License-Identifier: Apache-2.0
/// @file  A library that a test preloads into a program (LD_PRELOAD): the n-th call to the system of a kind fails, and
///        calls are recorded. Only calls about files below a folder count. Variables of the environment:
///
///        GSH_FAIL_UNDER  the folder
///        GSH_FAIL_IN     the program; others that it starts are left alone
///        GSH_FAIL_CALL   open, read, write, fsync, rename, mkdir, close, unlink; thread, memory or clock, which need
///                        no folder. With clock, each look at the clock finds it an hour earlier than the one before
///        GSH_FAIL_AT     n, from 1; with a + behind it, all calls from the n-th on
///        GSH_FAIL_WITH   the number of an error (errno); 0 for a write or read of one byte only. Below 0, the call is
///                        made, but before it another process (so it seems) has changed the file: -1 takes the second
///                        half of its bytes away, -2 changes all of them, -3 gives the folder GSH_FAIL_UNDER/out
///                        another name
///        GSH_CALLS_LOG   a file to which each call adds a line: the kind, the path, for rename the second path. Of
///                        memory, only what fails, and at the end the number of allocations

#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>

namespace {

/// The function that the program would have called.
template <class Function>
Function* next(Function*, const char* name) {
    return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}
#define GSH_NEXT(name) static const auto real = next(&::name, #name)

std::string variable(const char* name) {
    const char* const value = std::getenv(name);
    return value ? value : "";
}

struct Settings {
    bool here = variable("GSH_FAIL_IN").empty() || variable("GSH_FAIL_IN") == program_invocation_short_name;
    std::string under = here ? variable("GSH_FAIL_UNDER") : "", call = here ? variable("GSH_FAIL_CALL") : "";
    long at = 0;
    bool and_later = false;
    int error = EIO;
    int log = -1;

    Settings() {
        const std::string number = variable("GSH_FAIL_AT"), with = variable("GSH_FAIL_WITH");
        at = std::atol(number.c_str());
        and_later = !number.empty() && number.back() == '+';
        if (!with.empty()) error = std::atoi(with.c_str());
        const std::string path = variable("GSH_CALLS_LOG");
        if (!path.empty() && here)
            log = static_cast<int>(
                syscall(SYS_openat, AT_FDCWD, path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600));
    }
};
// These are made by the first call, which may come before this library is initialised, and never destroyed.
const Settings& settings() {
    static const Settings& instance = *new Settings;
    return instance;
}
/// The paths of open descriptors below the folder.
std::array<std::string, 1024>& paths() {
    static auto& instance = *new std::array<std::string, 1024>;
    return instance;
}

std::atomic<long> calls{0};
std::mutex paths_mutex;

bool is_below(const std::string& path) {
    const std::string& folder = settings().under;
    return !folder.empty() && path.starts_with(folder);
}
void remember(int descriptor, const std::string& path) {
    const std::lock_guard lock(paths_mutex);
    if (descriptor >= 0 && static_cast<std::size_t>(descriptor) < paths().size())
        paths()[static_cast<std::size_t>(descriptor)] = is_below(path) ? path : "";
}
std::string path_of(int descriptor) {
    const std::lock_guard lock(paths_mutex);
    const bool known = descriptor >= 0 && static_cast<std::size_t>(descriptor) < paths().size();
    return known ? paths()[static_cast<std::size_t>(descriptor)] : std::string();
}

/// What another process does to a file, or to the folder out, in the middle of a run. The system is called directly.
void meddle(const std::string& path) {
    const Settings& s = settings();
    if (s.error == -3) {
        const std::string out = s.under + "/out", gone = s.under + "/gone";
        syscall(SYS_renameat2, AT_FDCWD, out.c_str(), AT_FDCWD, gone.c_str(), 0);
        return;
    }
    const int file = static_cast<int>(syscall(SYS_openat, AT_FDCWD, path.c_str(), O_RDWR | O_CLOEXEC, 0));
    struct stat found{};
    if (file < 0 || ::fstat(file, &found) != 0) return;
    if (s.error == -1) syscall(SYS_ftruncate, file, found.st_size / 2);
    for (off_t at = 0; s.error == -2 && at < found.st_size;) {
        char bytes[4096];
        const auto count = syscall(SYS_pread64, file, bytes, sizeof bytes, at);
        if (count <= 0) break;
        for (char* byte = bytes; byte < bytes + count; ++byte) *byte = static_cast<char>(*byte ^ 0x15);
        at += syscall(SYS_pwrite64, file, bytes, count, at);
    }
    syscall(SYS_close, file);
}

/// Records a call about a path below the folder. Returns whether it must fail.
bool must_fail(const char* kind, const std::string& path, const std::string& second = {}) {
    const Settings& s = settings();
    const bool of_files = std::strcmp(kind, "thread") != 0 && std::strcmp(kind, "clock") != 0;
    if (of_files && !is_below(path) && !is_below(second)) return false;
    bool fails = false;
    if (s.call == kind && s.at > 0) { // never "memory"
        const long n = ++calls;
        fails = n == s.at || (s.and_later && n > s.at);
    }
    if (s.log >= 0) {
        const std::string line =
            std::string(kind) + "\t" + path + (second.empty() ? "" : "\t" + second) + (fails ? "\t!" : "") + "\n";
        syscall(SYS_write, s.log, line.data(), line.size());
    }
    if (fails && s.error < 0) {
        meddle(path);
        return false;
    }
    return fails;
}
/// Adds a line to the record. It allocates nothing.
void record(const char* text) {
    if (settings().log >= 0) syscall(SYS_write, settings().log, text, std::strlen(text));
}

// These are read by each allocation, also before settings() exists.
std::atomic<bool> counts_memory{false};
long memory_at = 0;

/// Whether an allocation must fail.
bool memory_fails() {
    if (!counts_memory.load(std::memory_order_relaxed) || ++calls != memory_at) return false;
    record("memory\t\t!\n");
    errno = ENOMEM;
    return true;
}

/// Counting begins when the program does, and ends before it frees what is static.
[[gnu::constructor]] void begin_counting() {
    if (settings().call != "memory") return;
    memory_at = settings().at;
    (void)paths();
    std::atexit([] {
        counts_memory = false;
        record(("allocations\t" + std::to_string(calls.load()) + "\n").c_str());
    });
    counts_memory = true;
}

template <class Result>
Result failed(Result result) {
    errno = settings().error;
    return result;
}

mode_t mode_of(int flags, va_list arguments) {
    return (flags & (O_CREAT | O_TMPFILE)) ? static_cast<mode_t>(va_arg(arguments, int)) : 0;
}

} // namespace

extern "C" {

// glibc's own functions, under the names by which a replacement reaches them.
void* __libc_malloc(size_t bytes);
void* __libc_calloc(size_t count, size_t bytes);
void* __libc_realloc(void* memory, size_t bytes);
void* __libc_memalign(size_t alignment, size_t bytes);

void* malloc(size_t bytes) {
    return memory_fails() ? nullptr : __libc_malloc(bytes);
}
void* calloc(size_t count, size_t bytes) {
    return memory_fails() ? nullptr : __libc_calloc(count, bytes);
}
void* realloc(void* memory, size_t bytes) {
    return bytes > 0 && memory_fails() ? nullptr : __libc_realloc(memory, bytes);
}
void* memalign(size_t alignment, size_t bytes) {
    return memory_fails() ? nullptr : __libc_memalign(alignment, bytes);
}
void* aligned_alloc(size_t alignment, size_t bytes) {
    return memalign(alignment, bytes);
}
int posix_memalign(void** memory, size_t alignment, size_t bytes) {
    void* const found = memalign(alignment, bytes);
    if (found) *memory = found;
    return found ? 0 : ENOMEM;
}

int open(const char* path, int flags, ...) {
    GSH_NEXT(open);
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    if (must_fail("open", path)) return failed(-1);
    const int descriptor = real(path, flags, mode);
    remember(descriptor, path);
    return descriptor;
}
int open64(const char* path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return open(path, flags, mode);
}
FILE* fopen(const char* path, const char* mode) {
    GSH_NEXT(fopen);
    if (must_fail("open", path)) return failed(static_cast<FILE*>(nullptr));
    FILE* const file = real(path, mode);
    if (file) remember(fileno(file), path);
    return file;
}
FILE* fopen64(const char* path, const char* mode) {
    return fopen(path, mode);
}
DIR* opendir(const char* path) {
    GSH_NEXT(opendir);
    if (must_fail("open", path)) return failed(static_cast<DIR*>(nullptr));
    return real(path);
}

ssize_t read(int descriptor, void* data, size_t size) {
    GSH_NEXT(read);
    if (!must_fail("read", path_of(descriptor))) return real(descriptor, data, size);
    return settings().error ? failed(ssize_t(-1)) : real(descriptor, data, std::min<size_t>(size, 1));
}
size_t fread(void* data, size_t size, size_t count, FILE* file) {
    GSH_NEXT(fread);
    if (!must_fail("read", path_of(fileno(file))) || !settings().error) return real(data, size, count, file);
#if defined(__GLIBC__)
    file->_flags |= 0x20; // what ferror asks for: the stream has failed
#endif
    return failed(size_t(0));
}

ssize_t write(int descriptor, const void* data, size_t size) {
    GSH_NEXT(write);
    if (!must_fail("write", path_of(descriptor))) return real(descriptor, data, size);
    return settings().error ? failed(ssize_t(-1)) : real(descriptor, data, std::min<size_t>(size, 1));
}
ssize_t pwrite64(int descriptor, const void* data, size_t size, off64_t at) {
    GSH_NEXT(pwrite64);
    const bool fails = must_fail("write", path_of(descriptor)) && settings().error != 0;
    return fails ? failed(ssize_t(-1)) : real(descriptor, data, size, at);
}
ssize_t pwrite(int descriptor, const void* data, size_t size, off_t at) {
    return pwrite64(descriptor, data, size, at);
}
int ftruncate64(int descriptor, off64_t size) {
    GSH_NEXT(ftruncate64);
    const bool fails = must_fail("write", path_of(descriptor)) && settings().error != 0;
    return fails ? failed(-1) : real(descriptor, size);
}
int ftruncate(int descriptor, off_t size) {
    return ftruncate64(descriptor, size);
}

int fsync(int descriptor) {
    GSH_NEXT(fsync);
    return must_fail("fsync", path_of(descriptor)) ? failed(-1) : real(descriptor);
}
int dup(int descriptor) {
    GSH_NEXT(dup);
    const int copy = real(descriptor);
    remember(copy, path_of(descriptor));
    return copy;
}
int close(int descriptor) {
    GSH_NEXT(close);
    const std::string path = path_of(descriptor);
    remember(descriptor, "");
    const int result = real(descriptor); // Linux closes it also where it reports an error
    return must_fail("close", path) ? failed(-1) : result;
}
int fclose(FILE* file) {
    GSH_NEXT(fclose);
    const int descriptor = fileno(file);
    const std::string path = path_of(descriptor);
    remember(descriptor, "");
    const int result = real(file);
    return must_fail("close", path) ? failed(EOF) : result;
}

int rename(const char* from, const char* to) {
    GSH_NEXT(rename);
    return must_fail("rename", from, to) ? failed(-1) : real(from, to);
}
int renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) {
    GSH_NEXT(renameat2);
    if (must_fail("rename", from, to)) return failed(-1);
    return real(from_folder, from, to_folder, to, flags);
}
int mkdir(const char* path, mode_t mode) {
    GSH_NEXT(mkdir);
    return must_fail("mkdir", path) ? failed(-1) : real(path, mode);
}
int unlink(const char* path) {
    GSH_NEXT(unlink);
    return must_fail("unlink", path) ? failed(-1) : real(path);
}
int link(const char* from, const char* to) {
    GSH_NEXT(link);
    return must_fail("link", from, to) ? failed(-1) : real(from, to);
}

// Clocks that a person or a server of time can set back.
int clock_gettime(clockid_t clock, struct timespec* time) {
    GSH_NEXT(clock_gettime);
    const int result = real(clock, time);
    static std::atomic<long> looks{0};
    if (clock == CLOCK_REALTIME && settings().call == "clock" && (must_fail("clock", ""), true))
        time->tv_sec -= 3600 * ++looks;
    return result;
}
time_t time(time_t* place) {
    struct timespec now{};
    clock_gettime(CLOCK_REALTIME, &now);
    if (place) *place = now.tv_sec;
    return now.tv_sec;
}
int gettimeofday(struct timeval* __restrict__ place, void* __restrict__) {
    struct timespec now{};
    clock_gettime(CLOCK_REALTIME, &now);
    place->tv_sec = now.tv_sec, place->tv_usec = now.tv_nsec / 1000;
    return 0;
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*), void* argument) {
    GSH_NEXT(pthread_create);
    if (must_fail("thread", "")) return settings().error;
    return real(thread, attributes, start, argument);
}
}

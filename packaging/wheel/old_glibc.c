/* SPDX-License-Identifier: Apache-2.0
 * What gsh, the static libstdc++ of GCC 12, its headers, and libraries configured with the headers of Debian 12 expect
 * of glibc, and glibc 2.27 does not have. Every library and executable of the wheel gets a copy of its own. */
#define _GNU_SOURCE
#include <errno.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/random.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define HIDDEN __attribute__((visibility("hidden")))

/* Not known: counters are then always atomic. */
HIDDEN char __libc_single_threaded = 0;

/* For gsh, which exchanges files and folders. Linux has the call since 3.15. */
HIDDEN int renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) {
    return (int)syscall(SYS_renameat2, from_folder, from, to_folder, to, flags);
}

/* For libzip, and below for std::random_device. */
HIDDEN void arc4random_buf(void* buffer, size_t size) {
    unsigned char* next = buffer;
    while (size > 0) {
        const ssize_t count = getrandom(next, size < 256 ? size : 256, 0); /* as many as come at once */
        if (count < 0 && errno != EINTR) abort();
        if (count > 0) next += count, size -= (size_t)count;
    }
}

HIDDEN uint32_t arc4random(void) {
    uint32_t value;
    arc4random_buf(&value, sizeof value);
    return value;
}

static struct timespec later(struct timespec now, struct timespec from, struct timespec to) {
    now.tv_sec += to.tv_sec - from.tv_sec;
    now.tv_nsec += to.tv_nsec - from.tv_nsec;
    if (now.tv_nsec < 0) now.tv_nsec += 1000000000, --now.tv_sec;
    if (now.tv_nsec >= 1000000000) now.tv_nsec -= 1000000000, ++now.tv_sec;
    return now;
}

/* For std::condition_variable, which asks for the monotonic clock; its conditions have the clock of the calendar. If
 * that is set while somebody waits, the wait is shorter or longer; callers check what they wait for. */
HIDDEN int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                                  const struct timespec* until) {
    struct timespec here, calendar;
    if (clock == CLOCK_REALTIME) return pthread_cond_timedwait(condition, mutex, until);
    clock_gettime(clock, &here);
    clock_gettime(CLOCK_REALTIME, &calendar);
    calendar = later(calendar, here, *until);
    return pthread_cond_timedwait(condition, mutex, &calendar);
}

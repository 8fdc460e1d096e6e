// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// A disk that fails. Preloaded, it counts the calls that change a disk; once armed, the n-th of
// them ends the process, before it or in the middle of it, or fails, or all from the n-th on fail.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

enum { COUNT, KILL, TEAR, FULL, FAIL };  // as in disk.py
static long calls, victim;
static int mode = -1;

void disk_arm(long n, int how) { calls = 0, victim = n, mode = how; }
long disk_calls(void) { return calls; }

// Count a call; return whether it is to fail. Does not return if the process ends before it.
static int fails(int takes_room) {
  if (mode < 0) return 0;
  long now = __atomic_add_fetch(&calls, 1, __ATOMIC_SEQ_CST);
  if (now == victim && (mode == KILL || (mode == TEAR && !takes_room))) _exit(137);
  int full = mode == FULL && takes_room && now >= victim;
  if (full || (mode == FAIL && now == victim)) {
    errno = full ? ENOSPC : EIO;
    return 1;
  }
  return 0;
}

static int is_torn(void) { return mode == TEAR && calls == victim; }

#define REAL(name) \
  static __typeof__(name) *real; \
  if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

#define WRITES(name, parameters, whole, half) \
  ssize_t name parameters { \
    REAL(name); \
    if (fails(1)) return -1; \
    if (!is_torn()) return whole; \
    if (half) _exit(137); \
    _exit(137); \
  }
WRITES(write, (int fd, const void *data, size_t n), real(fd, data, n), real(fd, data, n / 2))
WRITES(pwrite, (int fd, const void *data, size_t n, off_t at), real(fd, data, n, at),
       real(fd, data, n / 2, at))
WRITES(pwrite64, (int fd, const void *data, size_t n, off64_t at), real(fd, data, n, at),
       real(fd, data, n / 2, at))

#define CHANGES(name, parameters, call) \
  int name parameters { \
    REAL(name); \
    return fails(0) ? -1 : call; \
  }
CHANGES(ftruncate, (int fd, off_t size), real(fd, size))
CHANGES(ftruncate64, (int fd, off64_t size), real(fd, size))
CHANGES(fsync, (int fd), real(fd))
CHANGES(fdatasync, (int fd), real(fd))
CHANGES(unlink, (const char *path), real(path))
CHANGES(unlinkat, (int folder, const char *path, int flags), real(folder, path, flags))
CHANGES(rename, (const char *from, const char *to), real(from, to))
CHANGES(mkdir, (const char *path, mode_t bits), real(path, bits))
CHANGES(rmdir, (const char *path), real(path))

static mode_t bits_of(int flags, va_list rest) {
  return flags & O_CREAT ? va_arg(rest, mode_t) : 0;
}

#define OPENS(name, parameters, call) \
  int name parameters { \
    REAL(name); \
    va_list rest; \
    va_start(rest, flags); \
    mode_t bits = bits_of(flags, rest); \
    va_end(rest); \
    return flags & O_CREAT && fails(0) ? -1 : call; \
  }
OPENS(open, (const char *path, int flags, ...), real(path, flags, bits))
OPENS(open64, (const char *path, int flags, ...), real(path, flags, bits))
OPENS(openat, (int at, const char *path, int flags, ...), real(at, path, flags, bits))
OPENS(openat64, (int at, const char *path, int flags, ...), real(at, path, flags, bits))

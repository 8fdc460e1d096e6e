// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// A disk that fails. Preloaded, it counts the calls that change a disk; once armed, the n-th of
// them ends the process, before it or in the middle of it, or fails, or all from the n-th on fail.
// Or all of them are recorded, so that a cut of the power can be replayed. If DISK_SLOW_MS is set,
// every sync takes up to so many milliseconds longer, as on a worn card.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { COUNT, KILL, TEAR, FULL, FAIL };  // as in disk.py
static long calls, victim;
static int mode = -1;

void disk_arm(long n, int how) { calls = 0, victim = n, mode = how; }
long disk_calls(void) { return calls; }

static int record = -1;  // a file
static const int64_t *watched;  // a number that is recorded with every call

void disk_record(int fd, const int64_t *number) { record = fd, watched = number; }

// Append a call to the record: what it is, of which file, where, a name or two, data.
static void note(char what, int64_t file, int64_t at, const char *names, const void *data, size_t n) {
  if (record < 0) return;
  int64_t head[6] = {what, file, at, *watched, (int64_t)strlen(names), (int64_t)n};
  struct iovec parts[] = {
      {head, sizeof head}, {(void *)names, strlen(names)}, {(void *)data, n}};
  syscall(SYS_writev, record, parts, 3);  // in one call, for other threads note theirs
}

static int64_t file_of(int fd) {
  struct stat found;
  return fstat(fd, &found) ? -1 : (int64_t)found.st_ino;
}

// Return where a name lies, whatever it was relative to.
static const char *place_of(int folder, const char *path) {
  static _Thread_local char found[2][2 * PATH_MAX];
  static _Thread_local int turn;
  char *place = found[turn ^= 1];
  if (folder == AT_FDCWD || *path == '/') return strcpy(place, path);
  char link[64];
  snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
  ssize_t length = readlink(link, place, PATH_MAX);
  sprintf(place + (length < 0 ? 0 : length), "/%s", path);
  return place;
}

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

static void crawl(void) {
  const char *most_ms = getenv("DISK_SLOW_MS");
  if (most_ms) usleep((useconds_t)(atol(most_ms) * 1000 * (random() / (double)RAND_MAX)));
}

static int is_torn(void) { return mode == TEAR && calls == victim; }

#define REAL(name) \
  static __typeof__(name) *real; \
  if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

#define WRITES(name, parameters, at, whole, half) \
  ssize_t name parameters { \
    REAL(name); \
    if (fails(1)) return -1; \
    if (record >= 0 && fd != record) note('w', file_of(fd), at, "", data, n); \
    if (!is_torn()) return whole; \
    if (half) _exit(137); \
    _exit(137); \
  }
WRITES(write, (int fd, const void *data, size_t n),
       fcntl(fd, F_GETFL) & O_APPEND ? lseek(fd, 0, SEEK_END) : lseek(fd, 0, SEEK_CUR),
       real(fd, data, n), real(fd, data, n / 2))
WRITES(pwrite, (int fd, const void *data, size_t n, off_t at), at, real(fd, data, n, at),
       real(fd, data, n / 2, at))
WRITES(pwrite64, (int fd, const void *data, size_t n, off64_t at), at, real(fd, data, n, at),
       real(fd, data, n / 2, at))

#define CHANGES(name, parameters, noted, call) \
  int name parameters { \
    REAL(name); \
    if (fails(0)) return -1; \
    if (record >= 0) noted; \
    return call; \
  }
CHANGES(ftruncate, (int fd, off_t size), note('t', file_of(fd), size, "", 0, 0), real(fd, size))
CHANGES(ftruncate64, (int fd, off64_t size), note('t', file_of(fd), size, "", 0, 0),
        real(fd, size))
CHANGES(fsync, (int fd), note('s', file_of(fd), 0, "", 0, 0), (crawl(), real(fd)))
CHANGES(fdatasync, (int fd), note('s', file_of(fd), 0, "", 0, 0), (crawl(), real(fd)))
CHANGES(unlink, (const char *path), note('u', 0, 0, path, 0, 0), real(path))
CHANGES(unlinkat, (int folder, const char *path, int flags),
        note('u', 0, 0, place_of(folder, path), 0, 0), real(folder, path, flags))
CHANGES(rename, (const char *from, const char *to), note('r', 0, 0, from, to, strlen(to)),
        real(from, to))
CHANGES(mkdir, (const char *path, mode_t bits), note('m', 0, 0, path, 0, 0), real(path, bits))
CHANGES(rmdir, (const char *path), note('u', 0, 0, path, 0, 0), real(path))

static mode_t bits_of(int flags, va_list rest) {
  return flags & O_CREAT ? va_arg(rest, mode_t) : 0;
}

#define OPENS(name, parameters, folder, call) \
  int name parameters { \
    REAL(name); \
    va_list rest; \
    va_start(rest, flags); \
    mode_t bits = bits_of(flags, rest); \
    va_end(rest); \
    if (flags & O_CREAT && fails(0)) return -1; \
    int is_new = record >= 0 && flags & O_CREAT && faccessat(folder, path, F_OK, 0); \
    int fd = call; \
    if (is_new && fd >= 0) note('o', file_of(fd), 0, place_of(folder, path), 0, 0); \
    return fd; \
  }
OPENS(open, (const char *path, int flags, ...), AT_FDCWD, real(path, flags, bits))
OPENS(open64, (const char *path, int flags, ...), AT_FDCWD, real(path, flags, bits))
OPENS(openat, (int at, const char *path, int flags, ...), at, real(at, path, flags, bits))
OPENS(openat64, (int at, const char *path, int flags, ...), at, real(at, path, flags, bits))

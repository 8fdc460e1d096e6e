// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// A disk that fails. Preloaded and armed, it records the calls that change a disk, so that a kill or
// a cut of the power can be replayed; the n-th of them fails, or all from the n-th on that need
// room. If DISK_SLOW_MS is set, every sync takes up to so many milliseconds longer, as on a worn
// card.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static int record = -1;  // a file; -1: nothing is recorded, nothing fails
static long calls, victim, is_full;

void disk_arm(int file, long n, long full) { record = file, victim = n, is_full = full, calls = 0; }

// Append a call to the record: what it is, of which file, where, a name or two, data.
static void note(char what, int64_t file, int64_t at, const char *names, const void *data, size_t n) {
  if (record < 0) return;
  int64_t head[5] = {what, file, at, (int64_t)strlen(names), (int64_t)n};
  struct iovec parts[] = {
      {head, sizeof head}, {(void *)names, strlen(names)}, {(void *)data, n}};
  syscall(SYS_writev, record, parts, 3);  // in one call, for other threads note theirs
}

void disk_acknowledge(long number) { note('a', 0, number, "", 0, 0); }
void disk_heal(void) { victim = 0; }

static int64_t file_of(int fd) {
  struct stat found;
  return fstat(fd, &found) ? -1 : (int64_t)found.st_ino;
}

// Return where a name lies, whatever it was relative to.
static const char *place_of(int folder, const char *path) {
  static _Thread_local char place[2 * PATH_MAX];
  if (folder == AT_FDCWD || *path == '/') return path;
  char link[64];
  snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
  ssize_t length = readlink(link, place, PATH_MAX);
  sprintf(place + (length < 0 ? 0 : length), "/%s", path);
  return place;
}

// Count a call; return whether it is to fail.
static int fails(int takes_room) {
  if (record < 0) return 0;
  long now = __atomic_add_fetch(&calls, 1, __ATOMIC_SEQ_CST);
  if (!victim || (is_full ? now < victim || !takes_room : now != victim)) return 0;
  note('f', 0, 0, "", 0, 0);
  errno = is_full ? ENOSPC : EIO;
  return 1;
}

static void crawl(void) {
  const char *most_ms = getenv("DISK_SLOW_MS");
  if (most_ms) usleep((useconds_t)(atol(most_ms) * 1000 * (random() / (double)RAND_MAX)));
}

static off_t end_of(int fd) {
  return lseek(fd, 0, fcntl(fd, F_GETFL) & O_APPEND ? SEEK_END : SEEK_CUR);
}

#define REAL(name) \
  static __typeof__(name) *real; \
  if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

#define CHANGES(type, name, parameters, takes_room, noted, call) \
  type name parameters { \
    REAL(name); \
    if (fails(takes_room)) return -1; \
    if (record >= 0) noted; \
    return call; \
  }
CHANGES(ssize_t, write, (int fd, const void *data, size_t n), 1,
        note('w', file_of(fd), end_of(fd), "", data, n), real(fd, data, n))
CHANGES(ssize_t, pwrite, (int fd, const void *data, size_t n, off_t at), 1,
        note('w', file_of(fd), at, "", data, n), real(fd, data, n, at))
CHANGES(int, ftruncate, (int fd, off_t size), 0, note('t', file_of(fd), size, "", 0, 0),
        real(fd, size))
CHANGES(int, fsync, (int fd), 0, note('s', file_of(fd), 0, "", 0, 0), (crawl(), real(fd)))
CHANGES(int, fdatasync, (int fd), 0, note('s', file_of(fd), 0, "", 0, 0), (crawl(), real(fd)))
CHANGES(int, unlink, (const char *path), 0, note('u', 0, 0, path, 0, 0), real(path))
CHANGES(int, unlinkat, (int folder, const char *path, int flags), 0,
        note('u', 0, 0, place_of(folder, path), 0, 0), real(folder, path, flags))
CHANGES(int, rename, (const char *from, const char *to), 0, note('r', 0, 0, from, to, strlen(to)),
        real(from, to))
CHANGES(int, mkdir, (const char *path, mode_t bits), 0, note('m', 0, 0, path, 0, 0),
        real(path, bits))
CHANGES(int, rmdir, (const char *path), 0, note('u', 0, 0, path, 0, 0), real(path))

#define OPENS(name, parameters, folder, call) \
  int name parameters { \
    REAL(name); \
    va_list rest; \
    va_start(rest, flags); \
    mode_t bits = flags & O_CREAT ? va_arg(rest, mode_t) : 0; \
    va_end(rest); \
    int is_new = record >= 0 && flags & O_CREAT && faccessat(folder, path, F_OK, 0); \
    if (is_new && fails(0)) return -1; \
    int fd = call; \
    if (is_new && fd >= 0) note('o', file_of(fd), 0, place_of(folder, path), 0, 0); \
    return fd; \
  }
OPENS(open, (const char *path, int flags, ...), AT_FDCWD, real(path, flags, bits))
OPENS(openat, (int at, const char *path, int flags, ...), at, real(at, path, flags, bits))

// The same where a long has 64 bits.
ssize_t pwrite64(int, const void *, size_t, off64_t) __attribute__((alias("pwrite")));
int ftruncate64(int, off64_t) __attribute__((alias("ftruncate")));
int open64(const char *, int, ...) __attribute__((alias("open")));
int openat64(int, const char *, int, ...) __attribute__((alias("openat")));

/* Loaded before the C library (LD_PRELOAD), this makes one file operation of a program the last or a failing one.
 *
 *   FAULT_PATH   operations on files whose path contains this are counted: open, write, ftruncate, fsync, close, rename,
 *                unlink
 *   FAULT_AT     the number of the operation, from 1; 0 = none
 *   FAULT_ERRNO  0: the process is killed by SIGKILL just before the operation, a write after half of its bytes; else
 *                the operation fails with this error, and so do all later ones (a disk that is full stays full)
 *   FAULT_COUNT  file that receives, for each operation, a byte
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { kMostFiles = 4096 };
static char watched[kMostFiles];
static long operations;

static long number(const char* name) {
  const char* text = getenv(name);
  return text ? strtol(text, NULL, 10) : 0;
}

static int is_watched_path(const char* path) {
  const char* part = getenv("FAULT_PATH");
  return part && path && strstr(path, part) != NULL;
}
static int is_watched(int fd) { return fd >= 0 && fd < kMostFiles && watched[fd]; }

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static void count(void) {
  const char* path = getenv("FAULT_COUNT");
  if (!path) return;
  const int fd = REAL(open)(path, O_WRONLY | O_CREAT | O_APPEND, 0644);
  if (fd < 0) return;
  if (REAL(write)(fd, "x", 1) != 1) abort();
  REAL(close)(fd);
}

/* Whether this operation is to fail; does not return where the process is to die. */
static int fails(int is_write) {
  ++operations;
  count();
  const long at = number("FAULT_AT"), error = number("FAULT_ERRNO");
  if (at == 0 || operations < at) return 0;
  if (error == 0 && operations == at && !is_write) kill(getpid(), SIGKILL);
  errno = (int)error;
  return error != 0;
}
static int dies_in_write(void) { return number("FAULT_AT") == operations && number("FAULT_ERRNO") == 0; }

static int note_open(const char* path, int fd) {
  if (fd >= 0 && fd < kMostFiles) watched[fd] = (char)is_watched_path(path);
  return fd;
}

int open(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  if (is_watched_path(path) && fails(0)) return -1;
  return note_open(path, REAL(open)(path, flags, mode));
}
int open64(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  if (is_watched_path(path) && fails(0)) return -1;
  return note_open(path, REAL(open64)(path, flags, mode));
}
ssize_t write(int fd, const void* bytes, size_t size) {
  if (is_watched(fd)) {
    if (fails(1)) return -1;
    if (dies_in_write()) {
      if (REAL(write)(fd, bytes, size / 2) < 0) abort();
      kill(getpid(), SIGKILL);
    }
  }
  return REAL(write)(fd, bytes, size);
}
int ftruncate(int fd, off_t size) { return is_watched(fd) && fails(0) ? -1 : REAL(ftruncate)(fd, size); }
int fsync(int fd) { return is_watched(fd) && fails(0) ? -1 : REAL(fsync)(fd); }
int close(int fd) {
  const int failed = is_watched(fd) && fails(0);
  const int error = errno;
  if (fd >= 0 && fd < kMostFiles) watched[fd] = 0;
  const int result = REAL(close)(fd);
  if (!failed) return result;
  errno = error;
  return -1;
}
int rename(const char* from, const char* to) {
  return is_watched_path(to) && fails(0) ? -1 : REAL(rename)(from, to);
}
int unlink(const char* path) { return is_watched_path(path) && fails(0) ? -1 : REAL(unlink)(path); }

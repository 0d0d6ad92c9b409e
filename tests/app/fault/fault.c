/* Loaded before the C library (LD_PRELOAD), this makes one file operation of a program the last, a failing or an endless
 * one, or lets a signal come while it starts another program.
 *
 *   FAULT_PATH   operations on files whose path contains this are counted: open, write, ftruncate, fsync, close, rename,
 *                unlink
 *   FAULT_AT     the number of the operation, from 1; 0 = none
 *   FAULT_ERRNO  0: the process is killed by SIGKILL just before the operation, a write after half of its bytes; else
 *                the operation fails with this error, and so do all later ones (a disk that is full stays full);
 *                -1: it does not come back, while other threads of the process go on
 *   FAULT_COUNT  file that receives, for each operation, a byte
 *   FAULT_EXEC   milliseconds by which execv and execve are late
 *   FAULT_SIGNAL that they send to the parent process first
 *
 * Several threads of a program write files at once; each operation has a number of its own all the same.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { kMostFiles = 4096 };
static char watched[kMostFiles];
static atomic_long operations;

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

/* What happens to one operation. */
enum Fate { kHappens, kFails, kDiesHalfway };

/* Counts an operation and says what happens to it; does not return where the process is to die before it. */
static enum Fate fate(int is_write) {
  const long operation = atomic_fetch_add(&operations, 1) + 1;
  count();
  const long at = number("FAULT_AT"), error = number("FAULT_ERRNO");
  if (at == 0 || operation < at) return kHappens;
  if (error == 0 && operation > at) return kHappens;
  if (error == 0 && is_write) return kDiesHalfway;
  if (error == 0) kill(getpid(), SIGKILL);
  while (error < 0) pause();
  errno = (int)error;
  return kFails;
}
static int fails(void) { return fate(0) == kFails; }

static int note_open(const char* path, int fd) {
  if (fd >= 0 && fd < kMostFiles) watched[fd] = (char)is_watched_path(path);
  return fd;
}

int open(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  if (is_watched_path(path) && fails()) return -1;
  return note_open(path, REAL(open)(path, flags, mode));
}
int open64(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  if (is_watched_path(path) && fails()) return -1;
  return note_open(path, REAL(open64)(path, flags, mode));
}
ssize_t write(int fd, const void* bytes, size_t size) {
  switch (is_watched(fd) ? fate(1) : kHappens) {
    case kFails:
      return -1;
    case kDiesHalfway:
      if (REAL(write)(fd, bytes, size / 2) < 0) abort();
      kill(getpid(), SIGKILL);
      break;
    case kHappens:
      break;
  }
  return REAL(write)(fd, bytes, size);
}
int ftruncate(int fd, off_t size) { return is_watched(fd) && fails() ? -1 : REAL(ftruncate)(fd, size); }
int fsync(int fd) { return is_watched(fd) && fails() ? -1 : REAL(fsync)(fd); }
int close(int fd) {
  const int failed = is_watched(fd) && fails();
  const int error = errno;
  if (fd >= 0 && fd < kMostFiles) watched[fd] = 0;
  const int result = REAL(close)(fd);
  if (!failed) return result;
  errno = error;
  return -1;
}
int rename(const char* from, const char* to) {
  return is_watched_path(to) && fails() ? -1 : REAL(rename)(from, to);
}
int unlink(const char* path) { return is_watched_path(path) && fails() ? -1 : REAL(unlink)(path); }

static void delay_exec(void) {
  if (number("FAULT_SIGNAL") > 0) kill(getppid(), (int)number("FAULT_SIGNAL"));
  struct timespec left = {number("FAULT_EXEC") / 1000, number("FAULT_EXEC") % 1000 * 1000000};
  while (nanosleep(&left, &left) != 0 && errno == EINTR) continue;
}
int execv(const char* path, char* const words[]) {
  delay_exec();
  return REAL(execv)(path, words);
}
int execve(const char* path, char* const words[], char* const variables[]) {
  delay_exec();
  return REAL(execve)(path, words, variables);
}

// fork_to_exec: a child process that becomes a program at once, and that hears every signal.
#pragma once

namespace giga {

/// fork() for a child that calls exec next; 0 in the child, its pid here, -1 with errno set where there is none. The
/// child gets SIGTERM when the thread that called this ends, with its process however that comes. A signal that comes
/// before exec ends it, as it would end the program that has just begun: this process's handlers (StopRequest) would
/// note it in memory that exec replaces, and the program would never hear of it. The child of a process with threads
/// may make calls that are safe in a signal handler only.
int fork_to_exec();

}  // namespace giga

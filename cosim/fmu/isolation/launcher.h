#ifndef LAUNCHER_H
#define LAUNCHER_H

#include <sys/types.h>

/* Forks: returns in the worker, with the process that watches it. The watching process waits until the worker
 * ends, `master` is gone or SIGTERM arrives, ends all remaining processes, and does not return. `inherited`
 * are descriptors that only the worker uses. */
pid_t launch_worker(pid_t master, const int *inherited, int n_inherited);

#endif

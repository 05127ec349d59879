#ifndef LAUNCHER_H
#define LAUNCHER_H

#include <sys/types.h>

/* Forks: returns in the worker, with the process that watches it. That one waits until the worker ends, `master` has
 * gone or it is told to end by SIGTERM, ends all that is left, and does not return. `inherited` are descriptors that
 * only the worker uses. */
pid_t launch_worker(pid_t master, const int *inherited, int n_inherited);

#endif

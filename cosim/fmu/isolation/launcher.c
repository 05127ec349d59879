/* The process between the master and the worker in which the FMU runs. It ends all that the FMU has started, on Linux
 * also what has detached itself (a session of its own, a parent that has ended): as a subreaper it becomes the parent
 * of those. Then it ends in the same way as the worker, so that the master sees how the FMU was lost. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE
#endif
#include "launcher.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>
#if defined(__linux__)
#include <sys/prctl.h>
#endif

enum { LOOK_US = 500000, TRIES = 5000, TRY_US = 1000 }; /* for the master's end; for the end of the FMU's processes */

static void nothing(int number) { (void)number; }

static pid_t parent_of(const char *pid) {
    char path[300], text[512];
    snprintf(path, sizeof path, "/proc/%s/stat", pid);
    FILE *file = fopen(path, "r");
    if (!file) return 0;
    const size_t n = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    text[n] = 0;
    const char *name_end = strrchr(text, ')'); /* PID (NAME) STATE PARENT */
    int parent = 0;
    return name_end && sscanf(name_end + 1, " %*c %d", &parent) == 1 ? (pid_t)parent : 0;
}

static void kill_children(void) {
    DIR *all = opendir("/proc");
    if (!all) return;
    for (const struct dirent *entry; (entry = readdir(all)) != NULL;)
        if (entry->d_name[0] >= '1' && entry->d_name[0] <= '9' && parent_of(entry->d_name) == getpid())
            kill((pid_t)atoi(entry->d_name), SIGKILL);
    closedir(all);
}

/* Ends the worker's group, then every child of this process until none is left: the children of a process that ends
 * become children of this one. */
static void end_all(pid_t worker) {
    kill(-worker, SIGKILL);
    kill(worker, SIGKILL);
    for (int i = 0; i < TRIES; i++) {
        const pid_t ended = waitpid(-1, NULL, WNOHANG);
        if (ended < 0) return;
        if (ended > 0) continue;
        kill_children();
        usleep(TRY_US);
    }
}

static void end_as(int status) {
    if (WIFEXITED(status)) _exit(WEXITSTATUS(status));
    const int number = WTERMSIG(status);
    const struct rlimit none = {0, 0};
    sigset_t it;
    setrlimit(RLIMIT_CORE, &none);
    signal(number, SIG_DFL);
    sigemptyset(&it);
    sigaddset(&it, number);
    raise(number);
    sigprocmask(SIG_UNBLOCK, &it, NULL);
    _exit(128 + number);
}

pid_t launch_worker(pid_t master, const int *inherited, int n_inherited) {
    sigset_t wanted, before;
    sigemptyset(&wanted);
    sigaddset(&wanted, SIGCHLD);
    sigaddset(&wanted, SIGTERM);
    sigaddset(&wanted, SIGALRM);
    sigprocmask(SIG_BLOCK, &wanted, &before);
#if defined(__linux__)
    prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0);
#endif
    const pid_t own = getpid(), worker = fork();
    if (worker < 0) _exit(2);
    if (worker == 0) {
        setpgid(0, 0);
        sigprocmask(SIG_SETMASK, &before, NULL);
        return own;
    }
    setpgid(worker, worker); /* whoever of the two comes first */
    for (int i = 0; i < n_inherited; i++) close(inherited[i]); /* the master sees when the worker's are closed */
    const struct itimerval often = {{0, LOOK_US}, {0, LOOK_US}};
    signal(SIGINT, SIG_IGN); /* Ctrl-C is the master's */
    signal(SIGCHLD, nothing);
    signal(SIGALRM, nothing);
    setitimer(ITIMER_REAL, &often, NULL);
    for (int number = 0;;) {
        int status;
        for (pid_t ended; (ended = waitpid(-1, &status, WNOHANG)) > 0;)
            if (ended == worker) {
                end_all(worker);
                end_as(status);
            }
        if (number == SIGTERM || getppid() != master) {
            end_all(worker);
            _exit(0);
        }
        sigwait(&wanted, &number);
    }
}

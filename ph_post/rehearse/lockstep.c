/* Lets a LinuxCNC without realtime run as fast as the computer can, and always the same way.

   Loaded by LD_PRELOAD into rtapi_app, which runs the servo thread, and milltask, which interprets the program.
   Both get their time from a page they share: the servo thread runs one period, then milltask runs if its sleep
   is over, until it sleeps again, and only then is it the next period. No cycle is missed on a loaded machine,
   and a dwell takes as many periods as on a machine that keeps up.

   PH_POST_CLOCK names the shared page. While its word `pace` is 0 time passes as it does on the wall. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
#define PATIENCE_NS 200000000L /* for which the servo thread waits for a milltask that neither runs nor sleeps */
#define FAST_BY 5000           /* milltask's clock is fast by one part in so many: where a dwell lasts whole periods,
                                  rounding would decide whether it ends a period sooner or later */
#define STANDSTILL 5           /* of these, after which milltask runs though there is no servo thread */

struct page {
    _Atomic int pace;       /* 0: as on the wall, 1: as fast as it goes; set by the display */
    _Atomic int turn;       /* changes whenever milltask falls asleep or is woken */
    _Atomic int pid;        /* of milltask, 0 while there is none */
    _Atomic int sleeping;   /* whether milltask sleeps */
    _Atomic long long now;  /* ns */
    _Atomic long long wake; /* when milltask wants to be woken [ns] */
};

enum role { UNKNOWN, OTHER, SERVO, TASK };

static struct page *page;
static enum role role = UNKNOWN;
static int (*real_gettime)(clockid_t, struct timespec *);
static int (*real_nanosleep)(clockid_t, int, const struct timespec *, struct timespec *);
static int (*real_select)(int, fd_set *, fd_set *, fd_set *, struct timeval *);
static int (*real_gettimeofday)(struct timeval *, void *);

static void await(int seen) {
    struct timespec patience = {0, PATIENCE_NS};
    syscall(SYS_futex, &page->turn, FUTEX_WAIT, seen, &patience, NULL, 0);
}

static void next_turn(void) {
    atomic_fetch_add(&page->turn, 1);
    syscall(SYS_futex, &page->turn, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

static enum role role_of(const char *program) {
    const char *base = strrchr(program, '/');
    base = base ? base + 1 : program;
    return strcmp(base, "rtapi_app") == 0 ? SERVO : strcmp(base, "milltask") == 0 ? TASK : OTHER;
}

static void init(void) {
    if (role != UNKNOWN) return;
    real_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    real_nanosleep = dlsym(RTLD_NEXT, "clock_nanosleep");
    real_select = dlsym(RTLD_NEXT, "select");
    real_gettimeofday = dlsym(RTLD_NEXT, "gettimeofday");
    const char *name = getenv("PH_POST_CLOCK");
    enum role found = name ? role_of(program_invocation_name) : OTHER;
    if (found != OTHER) {
        int file = open(name, O_RDWR | O_CLOEXEC);
        void *memory = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        if (file >= 0) close(file);
        if (memory == MAP_FAILED) found = OTHER;
        else page = memory;
    }
    role = found;
}

__attribute__((constructor)) static void begin(void) { init(); }

__attribute__((destructor)) static void end(void) {
    if (role == TASK && atomic_load(&page->pid) == getpid()) {
        atomic_store(&page->pid, 0);
        next_turn();
    }
}

static struct timespec split(long long ns) { return (struct timespec){ns / SECOND, ns % SECOND}; }

int clock_gettime(clockid_t id, struct timespec *t) {
    init();
    if (role != SERVO || id != CLOCK_MONOTONIC) return real_gettime(id, t);
    *t = split(atomic_load(&page->now));
    return 0;
}

int gettimeofday(struct timeval *t, void *zone) {
    init();
    if (role != TASK) return real_gettimeofday(t, zone);
    long long exact = atomic_load(&page->now);
    struct timespec now = split(exact + exact / FAST_BY);
    *t = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
    return 0;
}

/* Let milltask run until it sleeps beyond the present. */
static void let_task_run(void) {
    int pid;
    while ((pid = atomic_load(&page->pid)) != 0) {
        int seen = atomic_load(&page->turn);
        if (atomic_load(&page->sleeping)) {
            if (atomic_load(&page->wake) > atomic_load(&page->now)) return;
            atomic_store(&page->sleeping, 0);
            next_turn();
            continue;
        }
        await(seen);
        if (seen == atomic_load(&page->turn)) {
            if (kill(pid, 0) != 0 && errno == ESRCH) atomic_store(&page->pid, 0);
            if (!atomic_load(&page->pace)) return; /* it may wait for something on the wall */
        }
    }
}

int clock_nanosleep(clockid_t id, int flags, const struct timespec *until, struct timespec *left) {
    init();
    if (role != SERVO || id != CLOCK_MONOTONIC || !(flags & TIMER_ABSTIME))
        return real_nanosleep(id, flags, until, left);
    long long target = until->tv_sec * SECOND + until->tv_nsec, now = atomic_load(&page->now);
    if (!atomic_load(&page->pace) && target > now) {
        struct timespec wall = split(target - now);
        real_nanosleep(CLOCK_MONOTONIC, 0, &wall, NULL);
    }
    let_task_run();
    if (target > now) atomic_store(&page->now, target);
    return 0;
}

int select(int count, fd_set *in, fd_set *out, fd_set *except, struct timeval *limit) {
    init();
    if (role != TASK || count != 0 || limit == NULL) return real_select(count, in, out, except, limit);
    long long wake = atomic_load(&page->now) + limit->tv_sec * SECOND + limit->tv_usec * 1000LL;
    atomic_store(&page->wake, wake);
    atomic_store(&page->sleeping, 1);
    atomic_store(&page->pid, getpid());
    next_turn();
    for (int idle = 0; atomic_load(&page->sleeping) && idle < STANDSTILL;) {
        int seen = atomic_load(&page->turn);
        long long before = atomic_load(&page->now);
        if (atomic_load(&page->sleeping)) await(seen);
        idle = atomic_load(&page->now) == before ? idle + 1 : 0;
    }
    atomic_store(&page->sleeping, 0);
    return 0;
}

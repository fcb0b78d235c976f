/* Sessions opened and closed by the hundred, and ended at awkward moments. */
#include "check.h"

#include <pthread.h>

static void on_progress_destroy(void *user, svbrdf_session *session,
                                const svbrdf_progress *progress)
{
    (void)progress;
    OK(svbrdf_session_destroy(session));
    *(volatile int *)user = 1;
}

static void on_maps_count(void *user, svbrdf_session *session)
{
    (void)session;
    ++*(volatile int *)user;
}

/* State shared by a log callback and the thread that ends its session. */
typedef struct {
    pthread_mutex_t lock;
    svbrdf_session *session;
    int entered, ended;
} slow_log;

static void on_log_slowly(void *user, svbrdf_log_level level, const char *message)
{
    slow_log *log = user;
    (void)level;
    if (strstr(message, "accepted") == NULL) {
        return;
    }
    CHECK(pthread_mutex_lock(&log->lock) == 0);
    log->entered = 1;
    CHECK(pthread_mutex_unlock(&log->lock) == 0);
    usleep(50000);
    CHECK(pthread_mutex_lock(&log->lock) == 0);
    CHECK(!log->ended);
    CHECK(pthread_mutex_unlock(&log->lock) == 0);
}

static int has_entered(slow_log *log)
{
    int entered;
    CHECK(pthread_mutex_lock(&log->lock) == 0);
    entered = log->entered;
    CHECK(pthread_mutex_unlock(&log->lock) == 0);
    return entered;
}

static void *push_one(void *user)
{
    (void)push_gray(((slow_log *)user)->session, 100);
    return NULL;
}

/* svbrdf_session_destroy() waits for log callbacks inside the calls of other threads. */
static void destroyed_while_logging(void)
{
    static slow_log log = {PTHREAD_MUTEX_INITIALIZER, NULL, 0, 0};
    svbrdf_session_options options;
    pthread_t pusher;
    rectified_options(&options);
    options.on_log = on_log_slowly;
    options.user_data = &log;
    OK(svbrdf_session_create(&options, &log.session));
    OK(svbrdf_session_pause(log.session));
    CHECK(pthread_create(&pusher, NULL, push_one, &log) == 0);
    EVENTUALLY(has_entered(&log));
    OK(svbrdf_session_destroy(log.session));
    CHECK(pthread_mutex_lock(&log.lock) == 0);
    log.ended = 1;
    CHECK(pthread_mutex_unlock(&log.lock) == 0);
    CHECK(pthread_join(pusher, NULL) == 0);
}

static long resident_kib(void)
{
    long pages = 0, resident = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file == NULL || fscanf(file, "%ld %ld", &pages, &resident) != 2) {
        resident = 0;
    }
    if (file != NULL) {
        fclose(file);
    }
    return resident * (sysconf(_SC_PAGESIZE) / 1024);
}

void test_lifecycle(const char *folder)
{
    int sessions = quick() ? 10 : 1000;
    svbrdf_session_options options;
    svbrdf_session *session = NULL, *keeper = NULL;
    svbrdf_progress progress;
    svbrdf_budget few;
    svbrdf_maps *maps = NULL;
    volatile int called = 0;
    long before = 0;
    int i;
    (void)folder;

    rectified_options(&options);
    options.on_maps = on_maps_count;
    options.user_data = (void *)&called;
    OK(svbrdf_session_create(&options, &keeper)); /* keeps the models loaded */
    for (i = 0; i < sessions; i++) {
        OK(svbrdf_session_create(&options, &session));
        if (i % 30 == 0 && i < sessions / 3 && !quick()) {
            /* Destroyed during a fit; not while memory is watched, which a fit needs much of. */
            OK(push_gray(session, 100));
        }
        OK(svbrdf_session_destroy(session));
        if (i == sessions / 3) {
            before = resident_kib();
        }
    }
    printf("%d sessions, memory grew by %ld KiB over the last two thirds\n", sessions,
           resident_kib() - before);
#ifndef __SANITIZE_ADDRESS__ /* It keeps freed memory for a while, and looks for leaks itself. */
    /* A leaked set of maps or stack would be 2 MiB each; the allocator's slack makes up the rest. */
    CHECK(resident_kib() - before < 16 * 1024);
#endif

    if (quick()) {
        OK(svbrdf_session_destroy(keeper));
        return;
    }
    /* Pause holds, resume goes on, cancel ends; each is fine twice. */
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_session_pause(keeper));
    OK(svbrdf_session_pause(keeper));
    OK(push_gray(keeper, 100));
    EXPECT(svbrdf_session_wait(keeper, 50), SVBRDF_TIMEOUT);
    OK(svbrdf_session_progress(keeper, &progress));
    CHECK(progress.state == SVBRDF_STATE_PAUSED && progress.settled == 0);
    OK(svbrdf_budget_init(&few, sizeof few));
    few.max_steps = 2;
    OK(svbrdf_session_set_budget(keeper, &few));
    OK(svbrdf_session_resume(keeper));
    OK(svbrdf_session_resume(keeper));
    OK(svbrdf_session_wait(keeper, -1));
    /* Held, so that it has not settled when it is ended. */
    OK(svbrdf_session_pause(keeper));
    OK(push_gray(keeper, 90));
    OK(svbrdf_session_cancel(keeper));
    OK(svbrdf_session_cancel(keeper));
    EXPECT(svbrdf_session_wait(keeper, -1), SVBRDF_CANCELLED);
    EXPECT(push_gray(keeper, 100), SVBRDF_CANCELLED);
    OK(svbrdf_session_progress(keeper, &progress));
    CHECK(progress.state == SVBRDF_STATE_CANCELLED && progress.photos == 2);
    OK(svbrdf_session_snapshot_maps(keeper, &maps)); /* maps stay available */
    OK(svbrdf_maps_destroy(maps));
    EVENTUALLY(called > 0);
    OK(svbrdf_session_destroy(keeper));

    /* Destroyed by its own callback. */
    called = 0;
    rectified_options(&options);
    options.on_progress = on_progress_destroy;
    options.user_data = (void *)&called;
    OK(svbrdf_session_create(&options, &session));
    (void)push_gray(session, 100);
    EVENTUALLY(called);
    EXPECT(svbrdf_session_pause(session), SVBRDF_INVALID_HANDLE);
    destroyed_while_logging();
}

static svbrdf_session *shared;

static void *push_many(void *unused)
{
    int i;
    (void)unused;
    for (i = 0; i < 3; i++) {
        svbrdf_status status = push_gray(shared, 60 + 10 * i);
        CHECK(status == SVBRDF_OK || status == SVBRDF_CANCELLED ||
              status == SVBRDF_INVALID_HANDLE);
    }
    return NULL;
}

static void *look_about(void *unused)
{
    int i;
    svbrdf_progress progress;
    OK(svbrdf_progress_init(&progress, sizeof progress));
    (void)unused;
    for (i = 0; i < 200; i++) {
        svbrdf_maps *maps = NULL;
        svbrdf_status status = svbrdf_session_progress(shared, &progress);
        CHECK(status == SVBRDF_OK || status == SVBRDF_INVALID_HANDLE);
        if (svbrdf_session_snapshot_maps(shared, &maps) == SVBRDF_OK) {
            OK(svbrdf_maps_destroy(maps));
        }
        usleep(1000);
    }
    return NULL;
}

static void *wait_for_end(void *unused)
{
    svbrdf_status status = svbrdf_session_wait(shared, -1);
    (void)unused;
    CHECK(status == SVBRDF_OK || status == SVBRDF_CANCELLED || status == SVBRDF_INVALID_HANDLE);
    return NULL;
}

/* Pushes from four threads, others look and wait; once to the end, once destroyed meanwhile. */
void test_threads(const char *folder)
{
    svbrdf_session_options options;
    svbrdf_progress progress;
    pthread_t threads[6];
    int round, i;
    (void)folder;
    for (round = 0; round < 2; round++) {
        rectified_options(&options);
        OK(svbrdf_session_create(&options, &shared));
        OK(svbrdf_session_pause(shared));
        for (i = 0; i < 6; i++) {
            void *(*run)(void *) = i < 4 ? push_many : i == 4 ? look_about : wait_for_end;
            CHECK(pthread_create(&threads[i], NULL, run, NULL) == 0);
        }
        if (round == 1) {
            usleep(100000);
            OK(svbrdf_session_destroy(shared));
        }
        for (i = 0; i < 4; i++) {
            CHECK(pthread_join(threads[i], NULL) == 0);
        }
        if (round == 0) {
            OK(svbrdf_progress_init(&progress, sizeof progress));
            OK(svbrdf_session_progress(shared, &progress));
            CHECK(progress.photos == 12);
            OK(svbrdf_session_cancel(shared));
        }
        CHECK(pthread_join(threads[4], NULL) == 0);
        CHECK(pthread_join(threads[5], NULL) == 0);
        if (round == 0) {
            OK(svbrdf_session_destroy(shared));
        }
    }
}

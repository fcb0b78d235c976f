/* Everything at once during a fit, from many threads; ended by itself, by cancel and by destroy. */
#include "check.h"

#include <pthread.h>

enum { PUSHERS = 4, THREADS = PUSHERS + 5, PHOTOS = 2, ROUNDS = 3 };

static svbrdf_session *session_;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int called, started, accepted, asked, answered, over;

static void count(int *what)
{
    CHECK(pthread_mutex_lock(&lock) == 0);
    ++*what;
    CHECK(pthread_mutex_unlock(&lock) == 0);
}

static int value(const int *what)
{
    int now;
    CHECK(pthread_mutex_lock(&lock) == 0);
    now = *what;
    CHECK(pthread_mutex_unlock(&lock) == 0);
    return now;
}

/* Checks a status that a call may return while others end the session. */
static void expect_any(svbrdf_status status)
{
    CHECK(status == SVBRDF_OK || status == SVBRDF_CANCELLED || status == SVBRDF_INVALID_HANDLE ||
          status == SVBRDF_TIMEOUT || status == SVBRDF_NO_MAPS);
}

static void on_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress)
{
    svbrdf_progress now = *progress;
    (void)user;
    expect_any(svbrdf_session_progress(session, &now));
    count(&called);
}

static void look_at_maps(svbrdf_session *session)
{
    svbrdf_maps *maps = NULL, *small = NULL;
    svbrdf_map_view view;
    svbrdf_status status = svbrdf_session_snapshot_maps(session, &maps);
    expect_any(status);
    if (status == SVBRDF_OK) {
        OK(svbrdf_map_view_init(&view, sizeof view));
        OK(svbrdf_maps_view(maps, SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_FORMAT_RGBA8, &view));
        CHECK(((const unsigned char *)view.data)[view.bytes - 1] == 255);
        OK(svbrdf_maps_reduced(maps, 3, &small));
        OK(svbrdf_maps_destroy(small));
        OK(svbrdf_maps_destroy(maps));
    }
}

static void on_maps(void *user, svbrdf_session *session)
{
    (void)user;
    look_at_maps(session);
    count(&called);
}

static void on_log(void *user, svbrdf_log_level level, const char *message)
{
    (void)user, (void)level;
    CHECK(message[0] != '\0');
    count(&called);
}

static void on_start(void *user, svbrdf_thread thread)
{
    CHECK(user == &started && thread > 0);
    /* Threads that share work may start late: they are not counted with the callbacks. */
    count(&started);
}

/* Who listens to the library changes while it works. */
static void *listen(void *unused)
{
    (void)unused;
    while (!value(&over)) {
        OK(svbrdf_set_log_callback(on_log, NULL));
        OK(svbrdf_set_thread_hook(on_start, &started));
        usleep(500);
        OK(svbrdf_set_log_callback(NULL, NULL));
        OK(svbrdf_set_thread_hook(NULL, NULL));
    }
    return NULL;
}

static void on_pushed(void *user, svbrdf_session *session, svbrdf_status status,
                      const svbrdf_photo_report *report)
{
    (void)user;
    /* A photo of a board, for a session of photos from the top. */
    CHECK(status == SVBRDF_INVALID_ARGUMENT || status == SVBRDF_CANCELLED);
    CHECK(svbrdf_last_error_message()[0] != '\0' && report->accepted == 0);
    look_at_maps(session);
    count(&answered);
}

static void add_photo_async(void)
{
    svbrdf_image image;
    svbrdf_status status;
    unsigned char *rgb = malloc(3 * SIDE * SIDE);
    CHECK(rgb != NULL);
    gray_image(&image, rgb, 90);
    status = svbrdf_session_add_photo_async(session_, &image, NULL, on_pushed, NULL);
    free(rgb);
    CHECK(status == SVBRDF_OK || status == SVBRDF_BUSY || status == SVBRDF_CANCELLED ||
          status == SVBRDF_INVALID_HANDLE);
    if (status == SVBRDF_OK) {
        count(&asked);
    }
}

static void *push(void *unused)
{
    int i;
    (void)unused;
    for (i = 0; i < PHOTOS; i++) {
        svbrdf_status status = push_gray(session_, 80 + 10 * i);
        add_photo_async();
        expect_any(status);
        if (status == SVBRDF_OK) {
            count(&accepted);
        }
    }
    return NULL;
}

static void *poll(void *unused)
{
    svbrdf_progress progress;
    svbrdf_next_view next;
    svbrdf_paper paper;
    double offset[3];
    float ambient;
    (void)unused;
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_next_view_init(&next, sizeof next));
    OK(svbrdf_paper_init(&paper, sizeof paper));
    while (!value(&over)) {
        expect_any(svbrdf_session_progress(session_, &progress));
        expect_any(svbrdf_session_next_view(session_, &next));
        expect_any(svbrdf_session_paper(session_, &paper));
        expect_any(svbrdf_session_light(session_, offset, &ambient));
        expect_any(svbrdf_session_wait(session_, 1));
        usleep(500);
    }
    return NULL;
}

static void *look(void *unused)
{
    (void)unused;
    while (!value(&over)) {
        look_at_maps(session_);
        usleep(500);
    }
    return NULL;
}

static void *steer(void *unused)
{
    svbrdf_budget budget;
    (void)unused;
    OK(svbrdf_budget_init(&budget, sizeof budget));
    while (!value(&over)) {
        expect_any(svbrdf_session_pause(session_));
        budget.max_steps = 1 + budget.max_steps % 6;
        expect_any(svbrdf_session_set_budget(session_, &budget));
        expect_any(svbrdf_session_resume(session_));
        usleep(2000);
    }
    expect_any(svbrdf_session_resume(session_));
    return NULL;
}

static void *save(void *unused)
{
    (void)unused;
    while (!value(&over)) {
        svbrdf_buffer *buffer = NULL;
        const void *data = NULL;
        size_t bytes = 0;
        svbrdf_status status = svbrdf_session_save_state(session_, &buffer);
        expect_any(status);
        if (status == SVBRDF_OK) {
            OK(svbrdf_buffer_view(buffer, &data, &bytes));
            CHECK(bytes > 100);
            OK(svbrdf_buffer_destroy(buffer));
        }
        usleep(20000);
    }
    return NULL;
}

void test_races(const char *folder)
{
    static void *(*const others[])(void *) = {poll, look, steer, save, listen};
    int round, i;
    (void)folder;
    for (round = 0; round < ROUNDS; round++) {
        svbrdf_session_options options;
        pthread_t threads[THREADS];
        called = accepted = asked = answered = over = 0;
        rectified_options(&options);
        options.threads = 2;
        options.on_progress = on_progress;
        options.on_maps = on_maps;
        options.on_log = on_log;
        OK(svbrdf_session_create(&options, &session_));
        for (i = 0; i < THREADS; i++) {
            void *(*run)(void *) = i < PUSHERS ? push : others[i - PUSHERS];
            CHECK(pthread_create(&threads[i], NULL, run, NULL) == 0);
        }
        EVENTUALLY(round == 0 || value(&accepted) >= 2);
        usleep(50000);
        if (round == 1) {
            expect_any(svbrdf_session_cancel(session_));
        } else if (round == 2) {
            OK(svbrdf_session_destroy(session_));
        }
        for (i = 0; i < PUSHERS; i++) {
            CHECK(pthread_join(threads[i], NULL) == 0);
        }
        count(&over);
        for (i = PUSHERS; i < THREADS; i++) {
            CHECK(pthread_join(threads[i], NULL) == 0);
        }
        if (round == 0) {
            OK(svbrdf_session_wait(session_, -1));
            CHECK(accepted == PUSHERS * PHOTOS);
        } else {
            CHECK(accepted >= 2);
        }
        if (round < 2) {
            OK(svbrdf_session_destroy(session_));
        }
        /* Every photo that was taken was answered; no callback comes any more. */
        CHECK(answered == asked && (round > 0 || asked > 0));
        i = called;
        usleep(20000);
        CHECK(called == i && i > 0);
        printf("round %d: %d photos, %d callbacks\n", round, accepted, called);
    }
}

/* The fraction that is done: of each photo, and of photos that were announced. */
#include "check.h"

#include <pthread.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static float told;
static int steps, ended;

/* While photos are announced the fraction told never falls. */
static void on_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress)
{
    (void)user, (void)session;
    CHECK(pthread_mutex_lock(&lock) == 0);
    CHECK(progress->fraction >= told && progress->fraction <= 1.0f);
    told = progress->fraction;
    ended = told >= 1.0f && progress->settled == 1;
    steps++;
    CHECK(pthread_mutex_unlock(&lock) == 0);
}

static int has_ended(void)
{
    int value;
    CHECK(pthread_mutex_lock(&lock) == 0);
    value = ended;
    CHECK(pthread_mutex_unlock(&lock) == 0);
    return value;
}

static svbrdf_progress now(const svbrdf_session *session)
{
    svbrdf_progress progress;
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_session_progress(session, &progress));
    return progress;
}

static svbrdf_session *begun(svbrdf_progress_callback callback)
{
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_budget few;
    rectified_options(&options);
    options.on_progress = callback;
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_budget_init(&few, sizeof few));
    few.max_steps = 3;
    OK(svbrdf_session_set_budget(session, &few));
    return session;
}

static void announced(void)
{
    svbrdf_session *session = begun(on_progress);
    svbrdf_photo_info dark;
    svbrdf_image image;
    unsigned char *rgb = malloc(3 * SIDE * SIDE);
    const float position[3] = {0.0f, 10.0f, 150.0f};
    int i;
    CHECK(rgb != NULL);
    OK(svbrdf_session_announce(session, 5));
    CHECK(now(session).fraction == 0.0f);
    for (i = 0; i < 2; i++) {
        OK(push_gray(session, 90 + i));
        OK(svbrdf_session_wait(session, -1));
        CHECK(now(session).fraction == (float)(i + 1) / 5.0f && now(session).settled == 1);
    }
    /* One without flash is rejected, one will not come after all: one of three is left. */
    gray_image(&image, rgb, 90);
    OK(svbrdf_photo_info_init(&dark, sizeof dark));
    dark.flash = SVBRDF_FLASH_OFF;
    EXPECT(svbrdf_session_add_rectified_photo(session, &image, &dark, position, position, NULL),
           SVBRDF_REJECTED);
    free(rgb);
    CHECK(now(session).fraction == 0.5f);
    OK(svbrdf_session_announce(session, 1));
    CHECK(now(session).fraction == 2.0f / 3.0f);
    OK(push_gray(session, 100));
    OK(svbrdf_session_wait(session, -1));
    CHECK(now(session).fraction == 1.0f && now(session).photos == 3);
    EVENTUALLY(has_ended());
    OK(svbrdf_session_destroy(session));
    CHECK(steps > 0);
    EXPECT(svbrdf_session_announce(session, 1), SVBRDF_INVALID_HANDLE);
}

static void one_by_one(void)
{
    svbrdf_session *session = begun(NULL);
    int i;
    for (i = 0; i < 2; i++) {
        OK(svbrdf_session_pause(session));
        OK(push_gray(session, 90 + i));
        CHECK(now(session).fraction == 0.0f && now(session).seconds_left < 0.0f);
        OK(svbrdf_session_resume(session));
        OK(svbrdf_session_wait(session, -1));
        CHECK(now(session).fraction == 1.0f);
    }
    OK(svbrdf_session_destroy(session));
}

void test_progress(const char *folder)
{
    (void)folder;
    announced();
    one_by_one();
}

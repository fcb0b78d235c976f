/* Photos added without waiting; threads and log of the library as a whole. */
#include "check.h"

#include <math.h>
#include <pthread.h>

enum { MOST = 64 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
/* Answers, in their order. */
static struct {
    svbrdf_status status;
    svbrdf_photo_report report;
    char message[256];
} came[MOST];
static int arrived, pushed, held, started[8], lines, phases;

static void wait_for(const int *what, int value)
{
    CHECK(pthread_mutex_lock(&lock) == 0);
    while (*what < value) {
        CHECK(pthread_cond_wait(&changed, &lock) == 0);
    }
    CHECK(pthread_mutex_unlock(&lock) == 0);
}

static int now(const int *what)
{
    int value;
    CHECK(pthread_mutex_lock(&lock) == 0);
    value = *what;
    CHECK(pthread_mutex_unlock(&lock) == 0);
    return value;
}

static void add(int *what, int value)
{
    CHECK(pthread_mutex_lock(&lock) == 0);
    *what += value;
    CHECK(pthread_cond_broadcast(&changed) == 0);
    CHECK(pthread_mutex_unlock(&lock) == 0);
}

static void on_pushed(void *user, svbrdf_session *session, svbrdf_status status,
                      const svbrdf_photo_report *report)
{
    CHECK(user == &arrived && report->size == sizeof *report);
    CHECK(pthread_mutex_lock(&lock) == 0);
    CHECK(arrived < MOST);
    came[arrived].status = status;
    came[arrived].report = *report;
    (void)snprintf(came[arrived].message, sizeof came[0].message, "%s", svbrdf_last_error_message());
    while (held) {
        CHECK(pthread_cond_wait(&changed, &lock) == 0);
    }
    CHECK(pthread_mutex_unlock(&lock) == 0);
    if (status == SVBRDF_OK) {
        svbrdf_maps *maps = NULL; /* maps that know of it are there */
        svbrdf_status taken = svbrdf_session_snapshot_maps(session, &maps);
        CHECK(taken == SVBRDF_OK || taken == SVBRDF_INVALID_HANDLE);
        OK(svbrdf_maps_destroy(maps));
    }
    add(&arrived, 1);
}

static void destroy_on_pushed(void *user, svbrdf_session *session, svbrdf_status status,
                              const svbrdf_photo_report *report)
{
    CHECK(user == &arrived && report->timestamp_ns >= 0);
    wait_for(&pushed, 3);
    CHECK(status == (now(&arrived) == 0 ? SVBRDF_OK : SVBRDF_CANCELLED));
    EXPECT(svbrdf_session_destroy(session),
           now(&arrived) == 0 ? SVBRDF_OK : SVBRDF_INVALID_HANDLE);
    add(&arrived, 1);
}

static void on_start(void *user, svbrdf_thread thread)
{
    CHECK(user == started && thread >= SVBRDF_THREAD_WORK && thread <= SVBRDF_THREAD_PHOTOS);
    add(&started[thread], 1);
}

static void on_line(void *user, svbrdf_log_level level, const char *message)
{
    CHECK(user == &lines && level >= SVBRDF_LOG_ERROR && message[0] != '\0');
    add(&lines, level < SVBRDF_LOG_DEBUG);
    add(&phases, strstr(message, "phase ended: ") == message);
}

static void on_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress)
{
    (void)user, (void)session, (void)progress;
}

/* NULL when the limit (0: none) is too low. */
static svbrdf_session *create_within(uint64_t bytes)
{
    svbrdf_session_options options;
    svbrdf_board board;
    svbrdf_camera camera;
    svbrdf_session *session = NULL;
    svbrdf_status status;
    board_options(&options, &board, &camera);
    options.on_progress = on_progress;
    options.memory_limit_bytes = bytes;
    status = svbrdf_session_create(&options, &session);
    CHECK(status == (session != NULL ? SVBRDF_OK : SVBRDF_MEMORY_LIMIT));
    arrived = 0;
    return session;
}

static svbrdf_session *create(void)
{
    svbrdf_session *session = create_within(0);
    OK(svbrdf_session_pause(session));
    return session;
}

/* Pushes a copy of a photo that is gone when the call is through. */
static svbrdf_status push(svbrdf_session *session, const picture *p, int64_t timestamp,
                          svbrdf_flash flash, svbrdf_photo_callback callback)
{
    picture copy = *p;
    size_t bytes = (size_t)3 * p->width * p->height;
    svbrdf_image image;
    svbrdf_photo_info info;
    svbrdf_status status;
    copy.rgb = malloc(bytes);
    CHECK(copy.rgb != NULL);
    memcpy(copy.rgb, p->rgb, bytes);
    rgb8(&image, &copy);
    OK(svbrdf_photo_info_init(&info, sizeof info));
    info.timestamp_ns = timestamp;
    info.flash = flash;
    status = svbrdf_session_add_photo_async(session, &image, &info, callback, &arrived);
    memset(copy.rgb, 0, bytes);
    free(copy.rgb);
    return status;
}

/* The same answers as calls that wait give, in the order of the calls. */
static void answers(const picture *photo, const picture *black)
{
    svbrdf_session *session = create(), *other = create();
    svbrdf_photo_report waited;
    svbrdf_budget budget;
    svbrdf_image image;
    int i;
    OK(push(session, photo, 1, SVBRDF_FLASH_FIRED, on_pushed));
    OK(push(session, black, 2, SVBRDF_FLASH_FIRED, on_pushed));
    wait_for(&arrived, 2);
    OK(push(session, photo, 3, SVBRDF_FLASH_OFF, on_pushed));
    OK(push(session, photo, 4, SVBRDF_FLASH_FIRED, on_pushed));
    wait_for(&arrived, 4);
    for (i = 0; i < 4; i++) {
        CHECK(came[i].report.timestamp_ns == i + 1);
    }
    CHECK(came[0].status == SVBRDF_OK && came[0].message[0] == '\0');
    CHECK(came[1].status == SVBRDF_REJECTED && strstr(came[1].message, "too dark") != NULL);
    CHECK(came[1].report.rejection == SVBRDF_REJECTION_TOO_DARK && came[1].report.accepted == 0);
    CHECK(came[2].report.rejection == SVBRDF_REJECTION_LIGHT_NOT_VISIBLE);
    CHECK(came[3].status == SVBRDF_OK && came[3].report.hints == SVBRDF_HINT_NOTHING_NEW);
    OK(svbrdf_photo_report_init(&waited, sizeof waited));
    rgb8(&image, photo);
    OK(svbrdf_session_add_photo(other, &image, NULL, &waited));
    for (i = 0; i < 3; i++) {
        CHECK(fabs(waited.translation_mm[i] - came[0].report.translation_mm[i]) < 1e-9);
    }
    OK(svbrdf_budget_init(&budget, sizeof budget));
    budget.max_steps = 2;
    OK(svbrdf_session_set_budget(other, &budget));
    OK(svbrdf_session_resume(other));
    OK(svbrdf_session_wait(other, -1));
    OK(svbrdf_session_destroy(other));

    /* Faults of the planes are answered later; other faults are returned at once, without an answer. */
    rgb8(&image, photo);
    image.planes[0].bytes -= 1;
    OK(svbrdf_session_add_photo_async(session, &image, NULL, on_pushed, &arrived));
    wait_for(&arrived, 5);
    CHECK(came[4].status == SVBRDF_INVALID_ARGUMENT && came[4].message[0] != '\0');
    CHECK(came[4].report.accepted == 0 && came[4].report.has_pose == 0);
    EXPECT(svbrdf_session_add_photo_async(session, &image, NULL, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    image.planes[0].data = NULL;
    EXPECT(svbrdf_session_add_photo_async(session, &image, NULL, on_pushed, &arrived),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_photo_async(session, NULL, NULL, on_pushed, &arrived),
           SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_destroy(session));
    EXPECT(push(session, photo, 5, SVBRDF_FLASH_FIRED, on_pushed), SVBRDF_INVALID_HANDLE);
    CHECK(arrived == 5);
}

/* Three on their way, one more is refused; those that wait are told when the session ends. */
static void ends(const picture *photo)
{
    int round, i;
    for (round = 0; round < 2; round++) {
        svbrdf_session *session = create();
        held = 1;
        OK(push(session, photo, 0, SVBRDF_FLASH_FIRED, on_pushed));
        /* Its place is free when its callback, which is held up, has begun. */
        for (i = 1; i <= 3;) {
            svbrdf_status status = push(session, photo, i, SVBRDF_FLASH_FIRED, on_pushed);
            CHECK(status == SVBRDF_OK || status == SVBRDF_BUSY);
            i += status == SVBRDF_OK;
        }
        EXPECT(push(session, photo, 4, SVBRDF_FLASH_FIRED, on_pushed), SVBRDF_BUSY);
        if (round == 0) {
            OK(svbrdf_session_cancel(session));
        }
        CHECK(now(&arrived) == 0);
        add(&held, -1);
        if (round == 0) {
            wait_for(&arrived, 4);
            EXPECT(push(session, photo, 5, SVBRDF_FLASH_FIRED, on_pushed), SVBRDF_CANCELLED);
        }
        OK(svbrdf_session_destroy(session));
        CHECK(arrived == 4); /* all before it returned */
        CHECK(came[0].status == SVBRDF_OK);
        for (i = 1; i < 4; i++) {
            CHECK(came[i].report.timestamp_ns == i);
            /* Destroying comes after the first answer, beside the second one. */
            CHECK(came[i].status == SVBRDF_CANCELLED || (round == 1 && came[i].status == SVBRDF_OK));
            CHECK(came[i].status == SVBRDF_OK || strcmp(came[i].message, "cancelled") == 0);
        }
    }
}

/* Copies on their way are the session's memory, and free again when they are through. */
static void within_memory(const picture *black)
{
    const uint64_t pixels = (uint64_t)black->width * black->height, copy = 3 * pixels;
    const uint64_t taken_in = (3 + 16) * pixels; /* and while its corners are looked for */
    uint64_t least = 0;
    svbrdf_session *session;
    do {
        least += 1 << 20;
        session = create_within(least);
    } while (session == NULL);
    EXPECT(push(session, black, 0, SVBRDF_FLASH_FIRED, on_pushed), SVBRDF_MEMORY_LIMIT);
    CHECK(strstr(svbrdf_last_error_message(), "MiB") != NULL);
    OK(push(session, black, 0, SVBRDF_FLASH_OFF, on_pushed)); /* of which nothing is copied */
    OK(svbrdf_session_destroy(session));
    CHECK(arrived == 1);

    session = create_within(least + taken_in + copy + copy / 2);
    held = 1;
    OK(push(session, black, 0, SVBRDF_FLASH_FIRED, on_pushed));
    /* Its copy is free when its callback, which is held up, has begun. */
    for (;;) {
        svbrdf_status status = push(session, black, 1, SVBRDF_FLASH_FIRED, on_pushed);
        if (status == SVBRDF_OK) {
            break;
        }
        CHECK(status == SVBRDF_MEMORY_LIMIT);
    }
    EXPECT(push(session, black, 2, SVBRDF_FLASH_FIRED, on_pushed), SVBRDF_MEMORY_LIMIT);
    add(&held, -1);
    wait_for(&arrived, 2);
    OK(push(session, black, 3, SVBRDF_FLASH_FIRED, on_pushed));
    wait_for(&arrived, 3);
    CHECK(came[1].report.timestamp_ns == 1 && came[2].report.timestamp_ns == 3);
    CHECK(came[0].status == SVBRDF_REJECTED && came[2].status == SVBRDF_REJECTED);
    OK(svbrdf_session_destroy(session));
    CHECK(arrived == 3);
}

void test_flow(const char *folder)
{
    picture photo = read_ppm(folder, "00.ppm"), black = photo;
    svbrdf_session *session;
    int before;
    black.rgb = calloc((size_t)3 * photo.width * photo.height, 1);
    CHECK(black.rgb != NULL);
    OK(svbrdf_set_thread_hook(on_start, started));
    OK(svbrdf_set_log_callback(on_line, &lines));

    answers(&photo, &black);
    /* Two sessions, of which one was given photos without waiting. */
    wait_for(&started[SVBRDF_THREAD_FIT], 2);
    wait_for(&started[SVBRDF_THREAD_CALLBACK], 2);
    wait_for(&started[SVBRDF_THREAD_WORK], 4);
    CHECK(now(&started[SVBRDF_THREAD_PHOTOS]) == 1 && now(&started[SVBRDF_THREAD_FIT]) == 2);
    /* Starts, pauses, ends; four answers and a hint; one answer, and the fit of that photo, which two steps
     * of the first phase end. */
    CHECK(now(&lines) == 3 * 2 + 5 + 1 + 1 && now(&phases) == 1);
    ends(&photo);

    /* Ended by the first answer: the others come all the same. */
    session = create();
    OK(push(session, &photo, 1, SVBRDF_FLASH_FIRED, destroy_on_pushed));
    OK(push(session, &photo, 2, SVBRDF_FLASH_FIRED, destroy_on_pushed));
    OK(push(session, &photo, 3, SVBRDF_FLASH_FIRED, destroy_on_pushed));
    add(&pushed, 3);
    wait_for(&arrived, 3);
    EXPECT(svbrdf_session_pause(session), SVBRDF_INVALID_HANDLE);

    within_memory(&black);
    OK(svbrdf_set_thread_hook(NULL, NULL));
    OK(svbrdf_set_log_callback(NULL, NULL));
    before = now(&lines);
    OK(svbrdf_session_destroy(create()));
    CHECK(now(&lines) == before);
    free(photo.rgb);
    free(black.rgb);
}

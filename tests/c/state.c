/* Sessions saved and gone on with, budgets, memory limits, captures in folders. */
#include "check.h"

static svbrdf_session *begun(void)
{
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    rectified_options(&options);
    OK(svbrdf_session_create(&options, &session));
    return session;
}

/* Needs no networks, and so runs under valgrind too. */
static void empty_sessions(const char *folder)
{
    svbrdf_session_options options;
    svbrdf_session *session = begun(), *again = NULL;
    svbrdf_buffer *buffer = NULL;
    const void *data = NULL;
    size_t bytes = 0, cut;
    unsigned char *copy;
    char path[4096];

    rectified_options(&options);
    OK(svbrdf_session_save_state(session, &buffer));
    OK(svbrdf_buffer_view(buffer, &data, &bytes));
    CHECK(data != NULL && bytes > 60 && memcmp(data, "SVBRDFST", 8) == 0);
    for (cut = 0; cut < bytes; cut++) {
        EXPECT(svbrdf_session_load_state(&options, data, cut, &again), SVBRDF_BAD_STATE);
    }
    copy = malloc(bytes);
    CHECK(copy != NULL);
    for (cut = 0; cut < bytes; cut++) {
        svbrdf_status status;
        memcpy(copy, data, bytes);
        copy[cut] ^= (unsigned char)(1u << (cut % 8));
        status = svbrdf_session_load_state(&options, copy, bytes, &again);
        CHECK(status == SVBRDF_BAD_STATE && again == NULL);
    }
    free(copy);
    EXPECT(svbrdf_session_load_state(&options, NULL, bytes, &again), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_load_state(&options, data, (size_t)-1, &again),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_load_state(&options, data, bytes, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_load_state(NULL, data, bytes, &again), SVBRDF_INVALID_ARGUMENT);
    options.threads = 65;
    EXPECT(svbrdf_session_load_state(&options, data, bytes, &again), SVBRDF_INVALID_ARGUMENT);
    options.threads = 1;
    options.memory_limit_bytes = 1;
    EXPECT(svbrdf_session_load_state(&options, data, bytes, &again), SVBRDF_MEMORY_LIMIT);
    EXPECT(svbrdf_session_create(&options, &again), SVBRDF_MEMORY_LIMIT);
    options.memory_limit_bytes = 0;
    EXPECT(svbrdf_buffer_view(buffer, NULL, &bytes), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_buffer_view(buffer, &data, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_load_state(&options, data, bytes, &again));
    OK(svbrdf_buffer_destroy(buffer));
    EXPECT(svbrdf_buffer_destroy(buffer), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_buffer_view(buffer, &data, &bytes), SVBRDF_INVALID_HANDLE);
    OK(svbrdf_buffer_destroy(NULL));
    OK(svbrdf_session_destroy(again));

    CHECK(snprintf(path, sizeof path, "%s/empty.state", folder) < (int)sizeof path);
    OK(svbrdf_session_save_state_to(session, path));
    again = NULL;
    OK(svbrdf_session_load_state_from(&options, path, &again));
    OK(svbrdf_session_destroy(again));
    EXPECT(svbrdf_session_save_state_to(session, "/nowhere/at/all"), SVBRDF_IO);
    EXPECT(svbrdf_session_save_state_to(session, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_load_state_from(&options, "/nowhere/at/all", &again), SVBRDF_IO);
    EXPECT(svbrdf_session_load_state_from(&options, NULL, &again), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_save_state(session, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_cancel(session));
    EXPECT(svbrdf_session_save_state(session, &buffer), SVBRDF_CANCELLED);
    OK(svbrdf_session_destroy(session));
    EXPECT(svbrdf_session_save_state(session, &buffer), SVBRDF_INVALID_HANDLE);
}

static void budgets(void)
{
    svbrdf_session *session = begun();
    svbrdf_budget budget;
    svbrdf_progress progress;

    OK(svbrdf_budget_init(&budget, sizeof budget));
    CHECK(budget.seconds < 0.0f && budget.max_steps == 0 && budget.stop_when_invisible == 0);
    budget.seconds = 0.0f / (budget.seconds + 1.0f); /* not a number */
    EXPECT(svbrdf_session_set_budget(session, &budget), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_budget_init(&budget, sizeof budget));
    budget.stop_when_invisible = 2;
    EXPECT(svbrdf_session_set_budget(session, &budget), SVBRDF_INVALID_ARGUMENT);
    budget.stop_when_invisible = 1;
    budget.max_steps = 3;
    budget.seconds = 1000.0f;
    OK(svbrdf_session_set_budget(session, &budget));
    budget.size = 4;
    EXPECT(svbrdf_session_set_budget(session, &budget), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_set_budget(session, NULL));
    budget.size = sizeof budget;
    if (!quick()) {
        OK(svbrdf_session_set_budget(session, &budget));
        OK(push_gray(session, 100));
        OK(svbrdf_session_wait(session, -1)); /* a few steps */
        OK(svbrdf_progress_init(&progress, sizeof progress));
        OK(svbrdf_session_progress(session, &progress));
        CHECK(progress.settled == 1 && progress.state == SVBRDF_STATE_READY);
        budget.max_steps = 8;
        OK(svbrdf_session_set_budget(session, &budget));
        OK(svbrdf_session_wait(session, -1));
    }
    OK(svbrdf_session_destroy(session));
}

static void photos(const char *folder)
{
    svbrdf_session_options options;
    svbrdf_session *session = begun(), *again = NULL;
    svbrdf_budget few;
    svbrdf_buffer *buffer = NULL;
    svbrdf_progress progress;
    svbrdf_maps *maps[2] = {NULL, NULL};
    svbrdf_map_view views[2];
    const void *data = NULL;
    size_t bytes = 0, i;
    char path[4096];

    OK(svbrdf_budget_init(&few, sizeof few));
    few.max_steps = 4;
    OK(svbrdf_session_set_budget(session, &few));
    OK(push_gray(session, 100));
    OK(svbrdf_session_wait(session, -1));
    OK(svbrdf_session_save_state(session, &buffer));
    OK(svbrdf_session_snapshot_maps(session, &maps[0]));
    OK(svbrdf_session_destroy(session));
    OK(svbrdf_buffer_view(buffer, &data, &bytes));
    rectified_options(&options);
    OK(svbrdf_session_load_state(&options, data, bytes, &again));
    OK(svbrdf_buffer_destroy(buffer));
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_session_progress(again, &progress));
    CHECK(progress.photos == 1 && progress.settled == 1);
    OK(svbrdf_session_snapshot_maps(again, &maps[1]));
    for (i = 0; i < 2; i++) {
        OK(svbrdf_map_view_init(&views[i], sizeof views[i]));
        OK(svbrdf_maps_view(maps[i], SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_FORMAT_F32, &views[i]));
    }
    CHECK(views[0].bytes == views[1].bytes);
    CHECK(memcmp(views[0].data, views[1].data, views[0].bytes) == 0);
    OK(svbrdf_maps_destroy(maps[0]));
    OK(svbrdf_maps_destroy(maps[1]));
    OK(push_gray(again, 110));
    OK(svbrdf_session_wait(again, -1));
    OK(svbrdf_session_progress(again, &progress));
    CHECK(progress.photos == 2);
    CHECK(snprintf(path, sizeof path, "%s/one.state", folder) < (int)sizeof path);
    OK(svbrdf_session_save_state_to(again, path));
    OK(svbrdf_session_destroy(again));
}

void test_state(const char *folder)
{
    empty_sessions(folder);
    budgets();
    if (!quick()) {
        photos(folder);
    }
}

/* The folder FOLDER/capture. */
/* A file's content, to be freed. */
static unsigned char *read_file(const char *path, size_t *length)
{
    FILE *file = fopen(path, "rb");
    unsigned char *bytes = malloc(1 << 22);
    CHECK(file != NULL && bytes != NULL);
    *length = fread(bytes, 1, 1 << 22, file);
    CHECK(*length > 0 && *length < 1 << 22 && fclose(file) == 0);
    return bytes;
}

/* The photo of a capture, added as a file: the same pose, and every kind of bad argument. */
static void push_files(const char *folder, const svbrdf_capture *capture,
                       const svbrdf_photo_report *known)
{
    svbrdf_session_options options;
    svbrdf_file_options how;
    svbrdf_file_info info;
    svbrdf_photo_report report;
    svbrdf_session *session = NULL;
    char path[4096];
    size_t length = 0;
    unsigned char *bytes;

    CHECK(svbrdf_features() & SVBRDF_FEATURE_FILES);
    CHECK(snprintf(path, sizeof path, "%s/capture/frames/03.jpg", folder) < (int)sizeof path);
    bytes = read_file(path, &length);
    OK(svbrdf_session_options_init(&options, sizeof options));
    options.threads = 1;
    options.capture = capture;
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_session_pause(session));
    OK(svbrdf_file_options_init(&how, sizeof how));
    OK(svbrdf_file_info_init(&info, sizeof info));
    OK(svbrdf_photo_report_init(&report, sizeof report));

    OK(svbrdf_file_look_at(bytes, length, &info));
    CHECK(info.width == 2016 && info.height == 1512 && info.is_linear == 0);
    CHECK(info.exposure == 0.0f && info.digital_zoom == 1.0f && info.model[0] == '\0');
    CHECK(info.remarks == SVBRDF_REMARK_NO_EXPOSURE);
    EXPECT(svbrdf_file_look_at(bytes, length, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_file_look_at(NULL, 1, &info), SVBRDF_INVALID_ARGUMENT);

    EXPECT(svbrdf_session_add_photo_file(NULL, bytes, length, NULL, NULL, NULL),
           SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_session_add_photo_file(session, NULL, length, NULL, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_photo_file(session, bytes, 0, NULL, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length / 2, NULL, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_photo_file(session, "hello", 5, NULL, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "not a picture") != NULL);
    how.max_pixels = 1000;
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length, &how, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    how.max_pixels = 0;
    how.max_bytes = 1000;
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length, &how, NULL, NULL),
           SVBRDF_MEMORY_LIMIT);
    how.max_bytes = 0;
    how.rotation = 45;
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length, &how, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    how.rotation = 0;
    how.transfer = 99;
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length, &how, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    how.transfer = 0;
    how.exposure = -1.0f;
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length, &how, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    how.exposure = 0.0f;
    how.flash = SVBRDF_FLASH_OFF;
    EXPECT(svbrdf_session_add_photo_file(session, bytes, length, &how, NULL, &report),
           SVBRDF_REJECTED);
    how.flash = SVBRDF_FLASH_FIRED;
    how.timestamp_ns = 3;
    OK(svbrdf_session_add_photo_file(session, bytes, length, &how, &info, &report));
    CHECK(report.accepted == 1 && report.timestamp_ns == 3 && info.width == 2016);
    CHECK(memcmp(report.translation_mm, known->translation_mm, sizeof report.translation_mm) == 0);
    free(bytes);
    OK(svbrdf_session_destroy(session));
}

void test_capture(const char *folder)
{
    svbrdf_session_options options;
    svbrdf_capture *capture = NULL;
    svbrdf_session *session = NULL, *rectified = begun();
    svbrdf_photo_report report;
    svbrdf_maps *maps = NULL;
    char path[4096];
    uint32_t count = 0;

    EXPECT(svbrdf_capture_open("/nowhere", &capture), SVBRDF_IO);
    EXPECT(svbrdf_capture_open(NULL, &capture), SVBRDF_INVALID_ARGUMENT);
    CHECK(snprintf(path, sizeof path, "%s/capture", folder) < (int)sizeof path);
    EXPECT(svbrdf_capture_open(path, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_capture_open(path, &capture));
    EXPECT(svbrdf_capture_photos(capture, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_capture_photos(capture, &count));
    CHECK(count == 8);
    OK(svbrdf_session_options_init(&options, sizeof options));
    options.threads = 1;
    options.capture = (const svbrdf_capture *)rectified;
    EXPECT(svbrdf_session_create(&options, &session), SVBRDF_INVALID_HANDLE);
    options.capture = capture;
    OK(svbrdf_session_create(&options, &session));
    EXPECT(svbrdf_session_add_capture_photo(session, capture, 8, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_capture_photo(session, NULL, 0, NULL), SVBRDF_INVALID_HANDLE);
    /* A session of another kind. */
    EXPECT(svbrdf_session_add_capture_photo(rectified, capture, 0, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_destroy(rectified));
    OK(svbrdf_session_pause(session));
    OK(svbrdf_photo_report_init(&report, sizeof report));
    OK(svbrdf_session_add_capture_photo(session, capture, 3, &report));
    CHECK(report.accepted == 1 && report.index == 0 && report.timestamp_ns == 3);
    push_files(folder, capture, &report);
    OK(svbrdf_capture_destroy(capture));
    EXPECT(svbrdf_session_add_capture_photo(session, capture, 4, NULL), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_capture_destroy(capture), SVBRDF_INVALID_HANDLE);
    OK(svbrdf_capture_destroy(NULL));
    OK(svbrdf_session_snapshot_maps(session, &maps));
    OK(svbrdf_maps_destroy(maps));
    OK(svbrdf_session_destroy(session));
}

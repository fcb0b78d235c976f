/* Photos that are looked at before they are added, and taken back afterwards. */
#include "check.h"

#include <math.h>

enum { CORNERS = 400 };

static svbrdf_session *board_session(void)
{
    svbrdf_session_options options;
    svbrdf_board board;
    svbrdf_camera camera;
    svbrdf_session *session = NULL;
    board_options(&options, &board, &camera);
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_session_pause(session));
    return session;
}

static svbrdf_probe probed(const svbrdf_session *session, const svbrdf_image *image,
                           const svbrdf_photo_info *info)
{
    svbrdf_probe probe;
    OK(svbrdf_probe_init(&probe, sizeof probe));
    OK(svbrdf_session_probe(session, image, info, &probe));
    CHECK((probe.acceptable == 1) == (probe.rejection == SVBRDF_REJECTION_NONE));
    return probe;
}

/* A session as bytes, to be freed. */
static unsigned char *saved(svbrdf_session *session, size_t *bytes)
{
    svbrdf_buffer *buffer = NULL;
    const void *data = NULL;
    unsigned char *copy;
    OK(svbrdf_session_save_state(session, &buffer));
    OK(svbrdf_buffer_view(buffer, &data, bytes));
    copy = malloc(*bytes);
    CHECK(copy != NULL);
    memcpy(copy, data, *bytes);
    OK(svbrdf_buffer_destroy(buffer));
    return copy;
}

/* A preview: every second pixel of every second row, in place. */
static void preview(svbrdf_image *image, const picture *p)
{
    rgb8(image, p);
    image->width = p->width / 2;
    image->height = p->height / 2;
    image->planes[0].row_stride *= 2;
    image->planes[0].pixel_stride = 6;
}

static void probes(const picture *first, const picture *second)
{
    svbrdf_session *session = board_session();
    svbrdf_photo_report report;
    svbrdf_photo_info info;
    svbrdf_image image;
    svbrdf_probe probe, small;
    float corners[2 * CORNERS + 1];
    unsigned char *before, *after, *black;
    size_t bytes, again, i;

    rgb8(&image, first);
    before = saved(session, &bytes);
    probe = probed(session, &image, NULL);
    CHECK(probe.acceptable == 1 && probe.advice[0] == '\0' && probe.has_pose == 1);
    CHECK(probe.off_next_deg < 0.0f && probe.white_level > 0.05f && probe.sample_seen == 1.0f);
    CHECK(probe.px_per_mm > 3.0f && probe.blur_px >= 0.0f && probe.corners_px == NULL);
    preview(&image, first);
    small = probed(session, &image, NULL);
    CHECK(small.acceptable == 1 && fabs((double)small.tilt_deg - (double)probe.tilt_deg) < 0.2);
    CHECK(fabs((double)small.px_per_mm / (double)probe.px_per_mm - 0.5) < 0.01);
    after = saved(session, &again);
    CHECK(bytes == again && memcmp(before, after, bytes) == 0);
    free(before);
    free(after);

    rgb8(&image, first);
    OK(svbrdf_photo_report_init(&report, sizeof report));
    OK(svbrdf_session_add_photo(session, &image, NULL, &report));
    for (i = 0; i < 3; i++) {
        CHECK(fabs(report.translation_mm[i] - probe.translation_mm[i]) < 0.2);
    }
    /* The same view again; corners into the caller's memory, as many as there is room for. */
    OK(svbrdf_photo_info_init(&info, sizeof info));
    info.timestamp_ns = 77;
    probe.corners_px = corners;
    probe.corners_capacity = CORNERS;
    OK(svbrdf_session_probe(session, &image, &info, &probe));
    CHECK(probe.hints == SVBRDF_HINT_NOTHING_NEW && probe.same_view_as == 0);
    CHECK(strstr(probe.advice, "photo 1 ") != NULL && probe.timestamp_ns == 77);
    CHECK(probe.off_next_deg > 5.0f && probe.corners_px == corners);
    CHECK(probe.corners_found > 60 && probe.corners_found <= probe.corners_in_view);
    CHECK(probe.corners_in_view <= probe.corners_expected && probe.corners_expected < CORNERS);
    for (i = 0; i < probe.corners_found; i++) {
        CHECK(corners[2 * i] > 0.0f && corners[2 * i] < 2016.0f);
        CHECK(corners[2 * i + 1] > 0.0f && corners[2 * i + 1] < 1512.0f);
    }
    corners[6] = -7.0f;
    probe.corners_capacity = 3;
    OK(svbrdf_session_probe(session, &image, &info, &probe));
    CHECK(corners[6] == -7.0f && probe.corners_found > 60);
    rgb8(&image, second);
    CHECK(probed(session, &image, NULL).hints == 0);

    /* Nothing to be seen; without the flash nothing can be said about the light. */
    black = calloc((size_t)3 * first->width * first->height, 1);
    CHECK(black != NULL);
    image.planes[0].data = black;
    probe = probed(session, &image, NULL);
    CHECK(probe.rejection == SVBRDF_REJECTION_TOO_DARK && probe.has_pose == 0);
    CHECK(strstr(probe.advice, "too dark") != NULL && isnan(probe.sample_px[0]));
    free(black);
    rgb8(&image, first);
    info.flash = SVBRDF_FLASH_OFF;
    probe = probed(session, &image, &info);
    CHECK(probe.acceptable == 1 && probe.white_level < 0.0f);
    EXPECT(svbrdf_session_probe(session, &image, NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_probe(session, NULL, NULL, &probe), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_cancel(session));
    EXPECT(svbrdf_session_probe(session, &image, NULL, &probe), SVBRDF_CANCELLED);
    OK(svbrdf_session_destroy(session));
    EXPECT(svbrdf_session_probe(session, &image, NULL, &probe), SVBRDF_INVALID_HANDLE);
}

/* Deviations of the maps of the moment, at every texel and of each map. */
static void trusted(svbrdf_session *session)
{
    svbrdf_maps *maps = NULL;
    svbrdf_uncertainty uncertainty;
    svbrdf_map_view view;
    double squares = 0.0;
    const float *at;
    size_t i, count;

    OK(svbrdf_session_snapshot_with_uncertainty(session, &maps));
    OK(svbrdf_uncertainty_init(&uncertainty, sizeof uncertainty));
    OK(svbrdf_maps_uncertainty(maps, &uncertainty));
    OK(svbrdf_map_view_init(&view, sizeof view));
    OK(svbrdf_maps_deviations(maps, SVBRDF_MAP_ROUGHNESS, &view));
    CHECK(view.channels == 1 && view.bytes == sizeof(float) * view.width * view.height);
    at = (const float *)view.data;
    count = (size_t)view.width * view.height;
    for (i = 0; i < count; ++i) {
        squares += (double)at[i] * (double)at[i];
    }
    CHECK(fabs(sqrt(squares / (double)count) - (double)uncertainty.roughness) < 1e-4);
    CHECK(uncertainty.normal > 0.0f && uncertainty.diffuse > 0.0f && uncertainty.specular > 0.0f);
    EXPECT(svbrdf_maps_deviations(maps, SVBRDF_MAP_SHEEN_ROUGHNESS, &view), SVBRDF_NO_LOBE);
    EXPECT(svbrdf_maps_deviations(maps, 10, &view), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_deviations(maps, SVBRDF_MAP_NORMAL, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_uncertainty(maps, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_snapshot_with_uncertainty(session, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_maps_destroy(maps));
}

/* Counts hints of the second photo that it is like the first. */
static void on_hint(void *user, uint32_t index, const char *code, const char *text)
{
    CHECK(index < 2 && code[0] != '\0' && text[0] != '\0');
    if (strcmp(code, "nothing_new") == 0) {
        CHECK(index == 1 && strstr(text, "photo 1 has nearly the same view") != NULL);
        ++*(int *)user;
    }
}

static void taken_back(const picture *first, const picture *second)
{
    svbrdf_session *session = board_session();
    svbrdf_maps *maps = NULL;
    svbrdf_progress progress;
    svbrdf_photo_fit fit;
    svbrdf_uncertainty uncertainty;
    svbrdf_image image;
    double before[3], after[3];
    int told = 0;

    EXPECT(svbrdf_session_remove_photo(session, 0), SVBRDF_INVALID_ARGUMENT);
    rgb8(&image, first);
    OK(svbrdf_session_add_photo(session, &image, NULL, NULL));
    rgb8(&image, second);
    OK(svbrdf_session_add_photo(session, &image, NULL, NULL));
    OK(svbrdf_session_pose(session, 1, NULL, before, NULL));
    EXPECT(svbrdf_session_remove_photo(session, 2), SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "index") != NULL);
    OK(svbrdf_photo_fit_init(&fit, sizeof fit));
    OK(svbrdf_session_photo_fit(session, 1, &fit));
    CHECK(fit.weight > 0.3f && fit.weight <= 1.0f && fit.residual > 0.0f && fit.outlier == 0);
    EXPECT(svbrdf_session_photo_fit(session, 2, &fit), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_hints(session, NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_photo_fit(session, 0, NULL), SVBRDF_INVALID_ARGUMENT);

    OK(svbrdf_session_remove_photo(session, 0));
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_session_progress(session, &progress));
    CHECK(progress.photos == 1 && progress.settled == 0);
    OK(svbrdf_session_pose(session, 0, NULL, after, NULL));
    CHECK(fabs(before[0] - after[0]) < 0.1 && fabs(before[2] - after[2]) < 0.1);
    OK(svbrdf_session_snapshot_maps(session, &maps));
    OK(svbrdf_uncertainty_init(&uncertainty, sizeof uncertainty));
    EXPECT(svbrdf_maps_uncertainty(maps, &uncertainty), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_maps_destroy(maps));
    trusted(session);
    OK(svbrdf_session_remove_photo(session, 0));
    EXPECT(svbrdf_session_snapshot_maps(session, &maps), SVBRDF_NO_MAPS);
    EXPECT(svbrdf_session_snapshot_with_uncertainty(session, &maps), SVBRDF_NO_MAPS);
    /* The same photo twice. */
    OK(svbrdf_session_add_photo(session, &image, NULL, NULL));
    OK(svbrdf_session_add_photo(session, &image, NULL, NULL));
    OK(svbrdf_session_hints(session, on_hint, &told));
    CHECK(told == 1);
    OK(svbrdf_session_destroy(session));
    EXPECT(svbrdf_session_hints(session, on_hint, &told), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_session_remove_photo(session, 0), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_session_photo_fit(session, 0, &fit), SVBRDF_INVALID_HANDLE);
}

static svbrdf_session *fitted;
static int seen;

/* Called by the fit at the end of a phase: the steps before have been reported, the end has not. */
static void on_line(void *user, svbrdf_log_level level, const char *message)
{
    svbrdf_progress progress;
    CHECK(user == &seen && level >= SVBRDF_LOG_ERROR);
    if (strstr(message, "phase ended: ") == message) {
        OK(svbrdf_progress_init(&progress, sizeof progress));
        OK(svbrdf_session_progress(fitted, &progress));
        seen += progress.phase == SVBRDF_PHASE_FIT;
    }
}

/* Progress names the phase of the fit. */
static void phases(void)
{
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_budget budget;
    svbrdf_progress progress;
    svbrdf_image image;
    svbrdf_probe probe;
    unsigned char *rgb = malloc(3 * SIDE * SIDE);

    CHECK(rgb != NULL && strcmp(svbrdf_phase_name(SVBRDF_PHASE_NONE), "none") == 0);
    CHECK(strcmp(svbrdf_phase_name(SVBRDF_PHASE_REFINE), "refine") == 0);
    CHECK(strcmp(svbrdf_phase_name(4711), "unknown") == 0);
    rectified_options(&options);
    OK(svbrdf_set_log_callback(on_line, &seen));
    OK(svbrdf_session_create(&options, &session));
    gray_image(&image, rgb, 90);
    OK(svbrdf_probe_init(&probe, sizeof probe));
    EXPECT(svbrdf_session_probe(session, &image, NULL, &probe), SVBRDF_INVALID_ARGUMENT);
    free(rgb);
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_session_progress(session, &progress));
    CHECK(progress.phase == SVBRDF_PHASE_NONE);
    OK(svbrdf_budget_init(&budget, sizeof budget));
    budget.max_steps = 40;
    OK(svbrdf_session_set_budget(session, &budget));
    fitted = session;
    OK(push_gray(session, 90));
    OK(svbrdf_session_wait(session, -1));
    OK(svbrdf_set_log_callback(NULL, NULL));
    OK(svbrdf_session_progress(session, &progress));
    CHECK(progress.settled == 1 && progress.phase == SVBRDF_PHASE_NONE);
    CHECK(seen > 0);
    OK(svbrdf_session_destroy(session));
}

/* The guidance for a picture so many milliseconds after the first one. */
static svbrdf_guidance guided_at(svbrdf_session *session, const svbrdf_image *image, int ms)
{
    svbrdf_photo_info info;
    svbrdf_guidance guidance;
    OK(svbrdf_photo_info_init(&info, sizeof info));
    info.timestamp_ns = (int64_t)ms * 1000000;
    OK(svbrdf_guidance_init(&guidance, sizeof guidance));
    OK(svbrdf_session_guide(session, image, &info, NULL, &guidance));
    CHECK(guidance.message[0] != '\0');
    return guidance;
}

/* Hold, shoot, hold until it is added, move on, enough. */
static void guided(const picture *first, const picture *second)
{
    svbrdf_session *session = board_session();
    svbrdf_guide_options options;
    svbrdf_guidance guidance;
    svbrdf_probe probe;
    svbrdf_image image;
    int ms;

    preview(&image, first);
    CHECK(guided_at(session, &image, 0).action == SVBRDF_ACTION_HOLD);
    guidance = guided_at(session, &image, 200);
    CHECK(guidance.action == SVBRDF_ACTION_SHOOT && guidance.photos == 0);
    CHECK(guidance.has_target == 1 && guidance.target_tilt_deg == 0.0f && guidance.gain < 0.0f);
    CHECK(guided_at(session, &image, 300).action == SVBRDF_ACTION_HOLD);
    rgb8(&image, first);
    OK(svbrdf_session_add_photo(session, &image, NULL, NULL));
    preview(&image, first);
    /* The fit judges views between two steps, also while it is paused. */
    ms = 400;
    do {
        guidance = guided_at(session, &image, ms);
        ms += 33;
    } while (guidance.best_gain < 0.0f && ms < 1000000);
    CHECK(guidance.action == SVBRDF_ACTION_MOVE && guidance.photos == 1 && guidance.has_target == 1);
    CHECK(guidance.target_tilt_deg >= 10.0f && guidance.target_tilt_deg <= 50.0f);
    CHECK(guidance.gain >= 0.0f && guidance.gain < guidance.best_gain && guidance.best_gain < 1.0f);
    CHECK(guidance.degrees > 2.0f && fabs((double)guidance.offset_mm[0]) + fabs((double)guidance.offset_mm[1]) > 5.0);
    /* No board: the rejection of the probe, and no direction. */
    image.planes[0].data = calloc((size_t)3 * first->width * first->height, 1);
    CHECK(image.planes[0].data != NULL);
    OK(svbrdf_probe_init(&probe, sizeof probe));
    OK(svbrdf_session_guide(session, &image, NULL, &probe, &guidance));
    CHECK(guidance.action == SVBRDF_ACTION_ADJUST && guidance.has_target == 0);
    CHECK(probe.rejection == SVBRDF_REJECTION_TOO_DARK && probe.acceptable == 0);
    free((void *)(uintptr_t)image.planes[0].data);

    OK(svbrdf_guide_options_init(&options, sizeof options));
    CHECK(options.worth > 0.0f && options.worth <= 1.0f && options.most >= options.least);
    options.most = 1;
    OK(svbrdf_session_guide_begin(session, &options));
    preview(&image, second);
    CHECK(guided_at(session, &image, 2000000).action == SVBRDF_ACTION_ENOUGH);
    OK(svbrdf_session_guide_begin(session, NULL));
    EXPECT(svbrdf_session_guide(session, &image, NULL, NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    guidance.size = 3;
    EXPECT(svbrdf_session_guide(session, &image, NULL, NULL, &guidance), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_cancel(session));
    OK(svbrdf_guidance_init(&guidance, sizeof guidance));
    EXPECT(svbrdf_session_guide(session, &image, NULL, NULL, &guidance), SVBRDF_CANCELLED);
    OK(svbrdf_session_destroy(session));
    EXPECT(svbrdf_session_guide_begin(session, NULL), SVBRDF_INVALID_HANDLE);
}

void test_looked_at(const char *folder)
{
    picture first = read_ppm(folder, "00.ppm"), second = read_ppm(folder, "01.ppm");
    probes(&first, &second);
    taken_back(&first, &second);
    guided(&first, &second);
    phases();
    free(first.rgb);
    free(second.rgb);
}

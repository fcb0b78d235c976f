/* Reports about photos, their statements by callers, and callers of older headers. */
#include "check.h"

#include <math.h>

static svbrdf_session *board_session(const svbrdf_camera *given)
{
    svbrdf_session_options options;
    svbrdf_board board;
    svbrdf_camera camera;
    svbrdf_session *session = NULL;
    board_options(&options, &board, &camera);
    options.camera = given == NULL ? &camera : NULL;
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_session_pause(session));
    return session;
}

static svbrdf_photo_report push(svbrdf_session *session, const svbrdf_image *image,
                                const svbrdf_photo_info *info, svbrdf_status expected)
{
    svbrdf_photo_report report;
    OK(svbrdf_photo_report_init(&report, sizeof report));
    EXPECT(svbrdf_session_add_photo(session, image, info, &report), expected);
    if (expected == SVBRDF_REJECTED) {
        CHECK(strcmp(report.advice, svbrdf_last_error_message()) == 0);
    }
    return report;
}

/* Hints, where to go next, camera and poses. */
static void accepted_photos(const picture *first, const picture *second)
{
    svbrdf_session *session = board_session(NULL);
    svbrdf_photo_report report, again;
    svbrdf_next_view next;
    svbrdf_camera camera;
    svbrdf_paper paper;
    svbrdf_image image;
    double sigma[9], rotation[9], translation[3], rms = 0.0;
    int i;

    OK(svbrdf_next_view_init(&next, sizeof next));
    next.known = 7;
    OK(svbrdf_session_next_view(session, &next));
    CHECK(next.known == 0);
    EXPECT(svbrdf_session_pose(session, 0, rotation, translation, &rms), SVBRDF_INVALID_ARGUMENT);

    rgb8(&image, first);
    report = push(session, &image, NULL, SVBRDF_OK);
    CHECK(report.hints == 0 && report.advice[0] == '\0');
    OK(svbrdf_session_next_view(session, &next));
    CHECK(next.known == 1 && next.tilt_deg >= 10.0f && next.tilt_deg <= 50.0f);
    CHECK(next.azimuth_deg >= 0.0f && next.azimuth_deg < 360.0f);
    CHECK(fabs((double)next.direction[2] - cos((double)next.tilt_deg * 0.017453292519943295)) <
          1e-5);
    CHECK(fabs(hypot((double)next.direction[0], (double)next.direction[1]) -
               sin((double)next.tilt_deg * 0.017453292519943295)) < 1e-5);

    /* The same again shows nothing new; another view does. */
    again = push(session, &image, NULL, SVBRDF_OK);
    CHECK(again.hints == SVBRDF_HINT_NOTHING_NEW && again.same_view_as == 0);
    CHECK(strstr(again.advice, "photo 1 ") != NULL);
    rgb8(&image, second);
    again = push(session, &image, NULL, SVBRDF_OK);
    CHECK(again.index == 2 && again.hints == 0);

    OK(svbrdf_camera_init(&camera, sizeof camera));
    OK(svbrdf_session_camera(session, &camera, sigma));
    CHECK(camera.width == 2016 && fabs(camera.fx - 1493.938) < 1e-3 && sigma[0] == 0.0);
    EXPECT(svbrdf_session_camera(session, NULL, sigma), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_next_view(session, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_paper_init(&paper, sizeof paper));
    CHECK(paper.known == 0 && paper.aspect == 1.0);
    OK(svbrdf_session_paper(session, &paper));
    CHECK(paper.known == 1 && paper.aspect == 1.0 && paper.bow_mm[0] == 0.0);
    CHECK(paper.aspect_sigma > 0.0 && paper.bow_sigma_mm[1] > 0.0);
    CHECK(paper.elevation_mm == 0.0 && paper.elevation_sigma_mm > 0.0);
    EXPECT(svbrdf_session_paper(session, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_pose(session, 2, rotation, translation, &rms));
    CHECK(memcmp(rotation, again.rotation, sizeof rotation) == 0);
    for (i = 0; i < 3; i++) {
        CHECK(translation[i] == again.translation_mm[i]);
    }
    CHECK(rms == again.reprojection_rms_px);
    OK(svbrdf_session_pose(session, 0, NULL, NULL, NULL));
    EXPECT(svbrdf_session_pose(session, 3, NULL, NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_destroy(session));
    EXPECT(svbrdf_session_next_view(session, &next), SVBRDF_INVALID_HANDLE);

    /* Values with the sRGB curve said to be linear. */
    session = board_session(NULL);
    rgb8(&image, first);
    image.transfer = SVBRDF_TRANSFER_LINEAR;
    report = push(session, &image, NULL, SVBRDF_OK);
    CHECK(report.hints == SVBRDF_HINT_NOT_LINEAR && report.over_white > 0.2f);
    CHECK(strstr(report.advice, "not linear") != NULL);
    OK(svbrdf_session_destroy(session));
}

/* A height that is stated is used. */
static void raised_sample(void)
{
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_paper paper;
    OK(svbrdf_session_options_init(&options, sizeof options));
    CHECK(isnan(options.elevation_mm));
    options.elevation_mm = 99.0;
    EXPECT(svbrdf_session_create(&options, &session), SVBRDF_INVALID_ARGUMENT);
    options.elevation_mm = 2.5;
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_paper_init(&paper, sizeof paper));
    OK(svbrdf_session_paper(session, &paper));
    CHECK(paper.elevation_mm == 2.5 && paper.elevation_sigma_mm == 0.0);
    OK(svbrdf_session_destroy(session));
}

/* An unknown camera, begun with a focal length; the capture's is 26.6 mm in these terms. */
static void unknown_camera(const picture *first)
{
    svbrdf_camera camera;
    svbrdf_session *session = board_session(&camera);
    svbrdf_photo_info info;
    svbrdf_image image;
    double sigma[9];
    OK(svbrdf_camera_init(&camera, sizeof camera));
    camera.width = 1;
    OK(svbrdf_session_camera(session, &camera, NULL));
    CHECK(camera.width == 0 && camera.fx == 0.0);
    rgb8(&image, first);
    OK(svbrdf_photo_info_init(&info, sizeof info));
    info.focal_35mm = NAN;
    push(session, &image, &info, SVBRDF_INVALID_ARGUMENT);
    info.focal_35mm = 26.6f;
    push(session, &image, &info, SVBRDF_OK);
    OK(svbrdf_session_camera(session, &camera, sigma));
    CHECK(camera.width == 2016 && camera.height == 1512);
    CHECK(fabs(camera.fx / 1493.9 - 1.0) < 0.05 && sigma[0] > 0.0);
    OK(svbrdf_session_destroy(session));
}

/* Figures of rejected photos: one that was moved sideways while it was taken. */
static void rejected_photos(const picture *first)
{
    enum { BLUR = 31 };
    svbrdf_session *session = board_session(NULL);
    svbrdf_photo_report report;
    svbrdf_image image;
    size_t x, y, c, k, w = first->width, h = first->height;
    unsigned char *moved = malloc(3 * w * h);
    CHECK(moved != NULL);
    for (y = 0; y < h; y++) {
        for (c = 0; c < 3; c++) {
            const unsigned char *row = first->rgb + 3 * w * y + c;
            unsigned sum = 0;
            for (x = 0; x < w; x++) {
                for (sum = 0, k = 0; k < BLUR; k++) {
                    sum += row[3 * (x + k < w ? x + k : w - 1)];
                }
                moved[3 * (w * y + x) + c] = (unsigned char)(sum / BLUR);
            }
        }
    }
    rgb8(&image, first);
    image.planes[0].data = moved;
    report = push(session, &image, NULL, SVBRDF_REJECTED);
    CHECK(report.rejection == SVBRDF_REJECTION_BLURRED && report.measured > 10.0f);
    CHECK(report.blur_direction_deg >= 0.0f);
    CHECK(report.blur_direction_deg < 25.0f || report.blur_direction_deg > 155.0f);
    free(moved);
    OK(svbrdf_session_destroy(session));
}

/* A photo without flash beside the one with it. */
static void ambient_light(const picture *first)
{
    svbrdf_session *session = board_session(NULL);
    svbrdf_photo_report plain, report;
    svbrdf_photo_info info;
    svbrdf_image image, ambient;
    size_t n = (size_t)3 * first->width * first->height, i;
    float *lamp = malloc(n * sizeof *lamp);
    unsigned char *dark = calloc(n, 1);
    CHECK(lamp != NULL && dark != NULL);
    rgb8(&image, first);
    rgb8(&ambient, first);
    plain = push(session, &image, NULL, SVBRDF_OK);
    OK(svbrdf_photo_info_init(&info, sizeof info));
    CHECK(info.ambient == NULL && info.ambient_exposure == 0.0f);
    info.ambient = &ambient;

    /* Only ambient light: the difference is black except for a clipped highlight. */
    report = push(session, &image, &info, SVBRDF_REJECTED);
    CHECK(report.rejection == SVBRDF_REJECTION_BOARD_NOT_FOUND);
    /* No ambient light: nothing changes. */
    ambient.planes[0].data = dark;
    report = push(session, &image, &info, SVBRDF_OK);
    for (i = 0; i < 3; i++) {
        CHECK(fabs(report.translation_mm[i] - plain.translation_mm[i]) < 1e-3);
    }
    /* Taken with another exposure and in another layout. */
    ambient.format = SVBRDF_PIXEL_RGB_F32;
    ambient.planes[0].data = lamp;
    ambient.planes[0].bytes = n * sizeof *lamp;
    ambient.planes[0].row_stride = 3 * sizeof *lamp * first->width;
    for (i = 0; i < n; i++) {
        lamp[i] = 3.0f;
    }
    report = push(session, &image, &info, SVBRDF_REJECTED);
    CHECK(report.rejection == SVBRDF_REJECTION_BOARD_NOT_FOUND);
    info.ambient_exposure = 1e5f;
    push(session, &image, &info, SVBRDF_OK);
    lamp[n / 2] = NAN;
    report = push(session, &image, &info, SVBRDF_REJECTED);
    CHECK(report.rejection == SVBRDF_REJECTION_NOT_FINITE);

    info.ambient_exposure = -1.0f;
    push(session, &image, &info, SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "ambient") != NULL);
    info.ambient_exposure = NAN;
    push(session, &image, &info, SVBRDF_INVALID_ARGUMENT);
    info.ambient_exposure = 0.0f;
    ambient.format = 0;
    push(session, &image, &info, SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "ambient") != NULL);
    rgb8(&ambient, first);
    ambient.width /= 2;
    push(session, &image, &info, SVBRDF_INVALID_ARGUMENT);
    ambient.size = 3;
    push(session, &image, &info, SVBRDF_INVALID_ARGUMENT);
    free(lamp);
    free(dark);
    OK(svbrdf_session_destroy(session));
}

/* Programs built with a header that had fewer fields. */
static void older_callers(const picture *first)
{
    const size_t old_report = offsetof(svbrdf_photo_report, hints);
    const size_t old_info = offsetof(svbrdf_photo_info, ambient);
    svbrdf_session_options options;
    svbrdf_board board;
    svbrdf_camera camera;
    svbrdf_session *session = NULL;
    svbrdf_photo_report report;
    svbrdf_photo_info info;
    svbrdf_image image;
    size_t i;

    board_options(&options, &board, &camera);
    board.size = offsetof(svbrdf_board, patches);
    board.patches = 77; /* not theirs */
    OK(svbrdf_session_create(&options, &session));
    board.size = sizeof board;
    EXPECT(svbrdf_session_create(&options, &session), SVBRDF_INVALID_ARGUMENT);
    board.size = offsetof(svbrdf_board, patches) - 1;
    EXPECT(svbrdf_session_create(&options, &session), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_pause(session));

    memset(&report, 0x5A, sizeof report);
    memset(&info, 0x5A, sizeof info);
    OK(svbrdf_photo_report_init(&report, old_report));
    OK(svbrdf_photo_info_init(&info, old_info));
    rgb8(&image, first);
    info.timestamp_ns = 5;
    OK(svbrdf_session_add_photo(session, &image, &info, &report));
    CHECK(report.accepted == 1 && report.timestamp_ns == 5 && report.size == old_report);
    for (i = old_report; i < sizeof report; i++) {
        CHECK(((const unsigned char *)&report)[i] == 0x5A);
    }
    report.size = old_report - 1;
    EXPECT(svbrdf_session_add_photo(session, &image, &info, &report), SVBRDF_INVALID_ARGUMENT);
    report.size = old_report;
    info.size = old_info - 1;
    EXPECT(svbrdf_session_add_photo(session, &image, &info, &report), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_session_destroy(session));
}

void test_feedback(const char *folder)
{
    picture first = read_ppm(folder, "00.ppm"), second = read_ppm(folder, "01.ppm");
    accepted_photos(&first, &second);
    raised_sample();
    unknown_camera(&first);
    rejected_photos(&first);
    ambient_light(&first);
    older_callers(&first);
    free(first.rgb);
    free(second.rgb);
}

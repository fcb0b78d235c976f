/* Bad arguments of each kind: a status, a message, nothing lost. */
#include "check.h"

#include <math.h>

static svbrdf_session_options good_options(void)
{
    svbrdf_session_options options;
    rectified_options(&options);
    return options;
}

#define REFUSED_OPTION(change, expected)                                                         \
    do {                                                                                         \
        svbrdf_session_options o = good_options();                                               \
        svbrdf_session *s = (svbrdf_session *)&o;                                                \
        change;                                                                                  \
        EXPECT(svbrdf_session_create(&o, &s), expected);                                         \
        CHECK(s == (svbrdf_session *)&o); /* results are written on success only */              \
    } while (0)

static void options(void)
{
    svbrdf_session *session = NULL;
    svbrdf_session_options usual = good_options();
    struct {
        svbrdf_session_options known;
        uint64_t newer[2];
    } larger;
    svbrdf_camera camera;
    svbrdf_board board;
    double flash[3] = {0.0, (double)NAN, 0.0};

    EXPECT(svbrdf_session_create(NULL, &session), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_create(&usual, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_create((const svbrdf_session_options *)((const char *)&larger + 1),
                                 &session),
           SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.size = 0, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.size = sizeof o - 1, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.size = (size_t)-1, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.scene = 0, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.scene = 77, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.method = 3, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.refine = 2, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.falloff = 0, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.falloff = SVBRDF_FALLOFF_NONE, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.threads = 65, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.resolution = 300, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.resolution = 0xFFFFFFFFu, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.sample_mm[1] = NAN, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.sample_mm[0] = -1.0f, SVBRDF_INVALID_ARGUMENT);
    REFUSED_OPTION(o.models = (const svbrdf_models *)&o, SVBRDF_INVALID_HANDLE);

    /* A struct of a newer header: fine while its newer fields are not set. */
    OK(svbrdf_session_options_init(&larger.known, sizeof larger));
    CHECK(larger.known.size == sizeof larger && larger.newer[1] == 0);
    larger.known.scene = SVBRDF_SCENE_RECTIFIED;
    OK(svbrdf_session_create(&larger.known, &session));
    OK(svbrdf_session_destroy(session));
    larger.newer[1] = 1;
    EXPECT(svbrdf_session_create(&larger.known, &session), SVBRDF_UNSUPPORTED);

    OK(svbrdf_camera_init(&camera, sizeof camera));
    OK(svbrdf_board_init(&board, sizeof board));
    CHECK(board.rows == 17 && board.cols == 16 && board.square_mm == 11.5);
    REFUSED_OPTION((o.scene = SVBRDF_SCENE_BOARD, o.camera = &camera), SVBRDF_INVALID_ARGUMENT);
    camera.width = 640;
    camera.height = 480;
    camera.fx = camera.fy = 500.0;
    usual = good_options();
    usual.scene = SVBRDF_SCENE_BOARD;
    usual.camera = &camera;
    OK(svbrdf_session_create(&usual, &session));
    OK(svbrdf_session_destroy(session));
    usual.flash_offset_mm = flash;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    usual.flash_offset_mm = NULL;
    usual.board = &board;
    board.kind = 9;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    board.kind = SVBRDF_BOARD_CHARUCO_RING;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    board.dictionary = "nonsense";
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    board.kind = SVBRDF_BOARD_CHECKERBOARD_RING;
    board.top_left_white = 2;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    board.top_left_white = 0;
    board.hole_row_end = 0xFFFFFFFFu;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    board.hole_row_end = 14;
    board.square_mm = (double)INFINITY;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
    board.square_mm = 11.5;
    camera.distortion[3] = (double)NAN;
    EXPECT(svbrdf_session_create(&usual, &session), SVBRDF_INVALID_ARGUMENT);
}

static svbrdf_session *session_;
static const float above[3] = {0.0f, 0.0f, 150.0f};

#define REFUSED_IMAGE(change)                                                                    \
    do {                                                                                         \
        svbrdf_image i = good;                                                                   \
        change;                                                                                  \
        EXPECT(svbrdf_session_add_rectified_photo(session_, &i, NULL, above, above, NULL),            \
               SVBRDF_INVALID_ARGUMENT);                                                         \
    } while (0)

static void images(void)
{
    unsigned char *rgb = malloc(3 * SIDE * SIDE);
    svbrdf_image good;
    svbrdf_photo_info info;
    svbrdf_photo_report report;
    const float below[3] = {0.0f, 0.0f, -1.0f}, nan_at[3] = {NAN, 0.0f, 100.0f};
    float *floats = calloc(3 * SIDE * SIDE, sizeof(float));
    unsigned format;

    CHECK(rgb != NULL && floats != NULL);
    gray_image(&good, rgb, 90);
    REFUSED_IMAGE(i.size = 8);
    REFUSED_IMAGE(i.format = 0);
    REFUSED_IMAGE(i.format = 12);
    REFUSED_IMAGE(i.transfer = 0);
    REFUSED_IMAGE(i.transfer = 6);
    REFUSED_IMAGE(i.primaries = 0);
    CHECK(strstr(svbrdf_last_error_message(), "svbrdf_image.primaries") != NULL);
    REFUSED_IMAGE(i.primaries = 4);
    REFUSED_IMAGE(i.rotation = 45);
    REFUSED_IMAGE(i.width = 0);
    REFUSED_IMAGE(i.height = 0);
    REFUSED_IMAGE(i.width = 0xFFFFFFFFu);
    REFUSED_IMAGE((i.width = 0xFFFFFFFFu, i.height = 0xFFFFFFFFu));
    REFUSED_IMAGE(i.height = SIDE + 1);
    REFUSED_IMAGE(i.planes[0].data = NULL);
    REFUSED_IMAGE(i.planes[0].bytes -= 1);
    REFUSED_IMAGE(i.planes[0].bytes = (size_t)-1);
    REFUSED_IMAGE(i.planes[0].row_stride -= 1);
    REFUSED_IMAGE(i.planes[0].row_stride = 0);
    REFUSED_IMAGE(i.planes[0].row_stride = (size_t)-1);
    REFUSED_IMAGE(i.planes[0].pixel_stride = 2);
    REFUSED_IMAGE(i.planes[0].pixel_stride = (size_t)-1 / 2);
    for (format = SVBRDF_PIXEL_RGBA8; format <= SVBRDF_PIXEL_P010; format++) {
        REFUSED_IMAGE((i.format = format, i.planes[0].bytes = 100));
    }
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_YUV420)); /* no chroma */
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_P010));
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_P010, i.yuv_matrix = 7));
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_BAYER16, i.bayer_pattern = 0));
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_BAYER16, i.white_level = NAN));
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_BAYER16, i.black_level[3] = 70000.0f));
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_BAYER16, i.white_balance[1] = 0.0f));
    REFUSED_IMAGE((i.format = SVBRDF_PIXEL_BAYER16, i.color_matrix[8] = INFINITY));
    EXPECT(svbrdf_session_add_rectified_photo(session_, NULL, NULL, above, above, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, NULL, NULL, above, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, NULL, above, NULL, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, NULL, below, above, NULL),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, NULL, above, nan_at, NULL),
           SVBRDF_INVALID_ARGUMENT);
    /* A board photo in a session of rectified ones. */
    EXPECT(svbrdf_session_add_photo(session_, &good, NULL, NULL), SVBRDF_INVALID_ARGUMENT);

    OK(svbrdf_photo_info_init(&info, sizeof info));
    info.exposure = 0.0f;
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, &info, above, above, NULL),
           SVBRDF_INVALID_ARGUMENT);
    info.exposure = NAN;
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, &info, above, above, NULL),
           SVBRDF_INVALID_ARGUMENT);
    info.exposure = 1.0f;
    info.flash = 4;
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, &info, above, above, NULL),
           SVBRDF_INVALID_ARGUMENT);
    info.flash = SVBRDF_FLASH_TORCH;
    OK(svbrdf_photo_report_init(&report, sizeof report));
    report.size = 1;
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, &info, above, above, &report),
           SVBRDF_INVALID_ARGUMENT);
    report.size = sizeof report;

    /* Values that are no numbers are the photo's fault, not the caller's. */
    good.format = SVBRDF_PIXEL_RGB_F32;
    good.planes[0].data = floats;
    good.planes[0].bytes = 3 * SIDE * SIDE * sizeof(float);
    good.planes[0].row_stride = 3 * SIDE * sizeof(float);
    floats[777] = NAN;
    EXPECT(svbrdf_session_add_rectified_photo(session_, &good, &info, above, above, &report),
           SVBRDF_REJECTED);
    CHECK(report.rejection == SVBRDF_REJECTION_NOT_FINITE);
    REFUSED_IMAGE(i.saturation = NAN);
    REFUSED_IMAGE(i.saturation = 0.0f);
    free(floats);
    free(rgb);
}

void test_bad_arguments(const char *folder)
{
    svbrdf_session_options o = good_options();
    svbrdf_progress progress;
    svbrdf_maps *maps = NULL;
    svbrdf_session *never = (svbrdf_session *)&o;
    (void)folder;

    options();
    OK(svbrdf_session_create(&o, &session_));
    images();
    OK(svbrdf_progress_init(&progress, sizeof progress));
    EXPECT(svbrdf_session_progress(session_, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_snapshot_maps(session_, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_session_snapshot_maps(session_, &maps), SVBRDF_NO_MAPS);
    EXPECT(svbrdf_maps_export(NULL, NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_export(NULL, NULL, "anywhere"), SVBRDF_INVALID_HANDLE);
    OK(svbrdf_session_light(session_, NULL, NULL));
    EXPECT(svbrdf_image_init(NULL, sizeof(svbrdf_image)), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_progress_init(&progress, 3), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_models_from_folder(NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    CHECK(strcmp(svbrdf_status_name(-99), "unknown") == 0);

    /* NULL, foreign and stale handles. */
    EXPECT(svbrdf_session_wait(NULL, 0), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_session_pause(never), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_maps_size((const svbrdf_maps *)session_, NULL, NULL, NULL),
           SVBRDF_INVALID_HANDLE);
    /* Nothing was lost by all this. */
    OK(svbrdf_session_progress(session_, &progress));
    CHECK(progress.state == SVBRDF_STATE_READY && progress.photos == 0);
    OK(svbrdf_session_pause(session_));
    if (!quick()) {
        OK(push_gray(session_, 100));
        OK(svbrdf_session_snapshot_maps(session_, &maps));
        OK(svbrdf_maps_destroy(maps));
    }
    OK(svbrdf_session_destroy(session_));
    EXPECT(svbrdf_session_destroy(session_), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_session_progress(session_, &progress), SVBRDF_INVALID_HANDLE);
    OK(svbrdf_session_destroy(NULL));
}

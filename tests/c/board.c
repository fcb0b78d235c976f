/* Photos of a board, in every layout, to maps in a folder. */
#include "check.h"

#include <math.h>
#include <pthread.h>

picture read_ppm(const char *folder, const char *name)
{
    picture p;
    char path[4096];
    FILE *file;
    CHECK(snprintf(path, sizeof path, "%s/%s", folder, name) < (int)sizeof path);
    file = fopen(path, "rb");
    CHECK(file != NULL);
    CHECK(fscanf(file, "P6 %u %u 255", &p.width, &p.height) == 2);
    CHECK(fgetc(file) == '\n');
    p.rgb = malloc(3u * p.width * p.height);
    CHECK(p.rgb != NULL);
    CHECK(fread(p.rgb, 3u * p.width, p.height, file) == p.height);
    fclose(file);
    return p;
}

typedef struct {
    int progress, maps, log, phases;
    float last_fraction;
} counts;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static void count(int *what)
{
    CHECK(pthread_mutex_lock(&lock) == 0);
    ++*what;
    CHECK(pthread_mutex_unlock(&lock) == 0);
}

/* Whether the callbacks have told the end of the fit and its maps. */
static int told(const counts *c)
{
    int all;
    CHECK(pthread_mutex_lock(&lock) == 0);
    all = c->progress > 0 && c->maps > 0 && c->log >= 4 && c->phases == 2 && c->last_fraction >= 1.0f;
    CHECK(pthread_mutex_unlock(&lock) == 0);
    return all;
}

static void on_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress)
{
    counts *c = user;
    svbrdf_progress now;
    CHECK(progress->size == sizeof *progress);
    count(&c->progress);
    CHECK(pthread_mutex_lock(&lock) == 0);
    c->last_fraction = progress->fraction;
    CHECK(pthread_mutex_unlock(&lock) == 0);
    /* Callbacks may call every function. */
    OK(svbrdf_progress_init(&now, sizeof now));
    CHECK(svbrdf_session_progress(session, &now) != SVBRDF_INVALID_ARGUMENT);
}

static void on_maps(void *user, svbrdf_session *session)
{
    svbrdf_maps *maps = NULL;
    if (svbrdf_session_snapshot_maps(session, &maps) == SVBRDF_OK) {
        count(&((counts *)user)->maps);
        OK(svbrdf_maps_destroy(maps));
    }
}

static void on_log(void *user, svbrdf_log_level level, const char *message)
{
    count(&((counts *)user)->log);
    CHECK(level >= SVBRDF_LOG_ERROR && level <= SVBRDF_LOG_DEBUG);
    CHECK(message[0] != '\0');
    if (strstr(message, "phase ended: ") == message) {
        /* The fit's, of one photo: on the callback thread, one after the other. */
        counts *c = user;
        CHECK(level == SVBRDF_LOG_DEBUG && strstr(message, " milliseconds=") != NULL);
        CHECK(strstr(message, c->phases == 0 ? " phase=latent " : " phase=texels ") != NULL);
        count(&c->phases);
    }
    printf("log: %s\n", message);
}

void board_options(svbrdf_session_options *options, svbrdf_board *board, svbrdf_camera *camera)
{
    static const double flash[3] = {4.9223925516757925, 7.8090039183605695, 0.0};
    OK(svbrdf_board_init(board, sizeof *board));
    CHECK(board->patches == 1); /* the default one has them, this one has not */
    board->patches = 0;
    board->rows = 19;
    board->cols = 14;
    board->square_mm = 10.0;
    board->hole_row_start = 3;
    board->hole_col_start = 2;
    board->hole_row_end = 16;
    board->hole_col_end = 12;
    OK(svbrdf_camera_init(camera, sizeof *camera));
    camera->width = 2016;
    camera->height = 1512;
    camera->fx = 1493.9383274679394;
    camera->fy = 1492.8832900664995;
    camera->cx = 1014.8386867404545;
    camera->cy = 755.2944690154574;
    camera->distortion[0] = 0.0421587926023828;
    camera->distortion[1] = -0.042918096580716374;
    OK(svbrdf_session_options_init(options, sizeof *options));
    options->sample_mm[0] = options->sample_mm[1] = 88.0f;
    options->threads = 2;
    options->board = board;
    options->camera = camera;
    options->flash_offset_mm = flash;
}

static svbrdf_session *create(counts *c)
{
    svbrdf_session_options options;
    svbrdf_board board;
    svbrdf_camera camera;
    svbrdf_session *session = NULL;
    board_options(&options, &board, &camera);
    options.on_progress = on_progress;
    options.on_maps = on_maps;
    options.on_log = on_log;
    options.user_data = c;
    OK(svbrdf_session_create(&options, &session));
    return session;
}

void rgb8(svbrdf_image *image, const picture *p)
{
    OK(svbrdf_image_init(image, sizeof *image));
    image->format = SVBRDF_PIXEL_RGB8;
    image->transfer = SVBRDF_TRANSFER_SRGB;
    image->width = p->width;
    image->height = p->height;
    image->planes[0].data = p->rgb;
    image->planes[0].bytes = (size_t)3 * p->width * p->height;
    image->planes[0].row_stride = (size_t)3 * p->width;
}

/* One photo through the whole fit; the maps go to FOLDER/maps. */
void test_board(const char *folder)
{
    char out[4096];
    counts c = {0, 0, 0, 0, 0.0f};
    picture photo = read_ppm(folder, "00.ppm");
    svbrdf_session *session = create(&c);
    svbrdf_image image;
    svbrdf_photo_info info;
    svbrdf_photo_report report;
    svbrdf_progress progress;
    svbrdf_maps *maps = NULL;
    double offset[3];
    float ambient = -1.0f;
    unsigned char *black;

    EXPECT(svbrdf_session_snapshot_maps(session, &maps), SVBRDF_NO_MAPS);
    CHECK(maps == NULL);
    OK(svbrdf_photo_info_init(&info, sizeof info));
    OK(svbrdf_photo_report_init(&report, sizeof report));

    /* Rejections: a black photo, then one without flash. */
    rgb8(&image, &photo);
    black = calloc(image.planes[0].bytes, 1);
    image.planes[0].data = black;
    info.timestamp_ns = 41;
    EXPECT(svbrdf_session_add_photo(session, &image, &info, &report), SVBRDF_REJECTED);
    CHECK(strstr(svbrdf_last_error_message(), "too dark") != NULL);
    CHECK(report.accepted == 0 && report.rejection == SVBRDF_REJECTION_TOO_DARK);
    CHECK(report.timestamp_ns == 41 && report.measured < 0.01f);
    CHECK(strcmp(report.advice, svbrdf_last_error_message()) == 0);
    free(black);
    rgb8(&image, &photo);
    info.flash = SVBRDF_FLASH_OFF;
    EXPECT(svbrdf_session_add_photo(session, &image, &info, &report), SVBRDF_REJECTED);
    CHECK(report.rejection == SVBRDF_REJECTION_LIGHT_NOT_VISIBLE);
    EXPECT(svbrdf_session_snapshot_maps(session, &maps), SVBRDF_NO_MAPS);

    info.flash = SVBRDF_FLASH_FIRED;
    info.timestamp_ns = 42;
    OK(svbrdf_session_add_photo(session, &image, &info, &report));
    free(photo.rgb); /* Nothing of it is kept. */
    CHECK(report.accepted == 1 && report.index == 0 && report.has_pose == 1);
    CHECK(report.rejection == SVBRDF_REJECTION_NONE && report.timestamp_ns == 42);
    CHECK(report.hints == 0 && report.advice[0] == '\0' && report.measured == 0.0f);
    CHECK(report.reprojection_rms_px > 0.0 && report.reprojection_rms_px < 1.0);
    CHECK(report.translation_mm[2] > 50.0 && report.translation_mm[2] < 1000.0);
    /* Row 2 of the rotation is the camera's axis in the board frame: it looks down. */
    CHECK(report.rotation[8] < -0.5);
    OK(svbrdf_session_snapshot_maps(session, &maps));
    OK(svbrdf_maps_destroy(maps));

    OK(svbrdf_session_wait(session, -1));
    OK(svbrdf_session_wait(session, 0));
    OK(svbrdf_progress_init(&progress, sizeof progress));
    OK(svbrdf_session_progress(session, &progress));
    CHECK(progress.state == SVBRDF_STATE_READY && progress.settled == 1);
    CHECK(progress.photos == 1 && progress.fraction == 1.0f);
    CHECK(progress.loss > 0.0f && progress.loss < progress.loss_before);
    CHECK(progress.maps_revision > 1 && progress.seconds_left < 0.0f);
    OK(svbrdf_session_light(session, offset, &ambient));
    CHECK(fabs(offset[0] - 4.92) < 0.01 && ambient >= 0.0f && ambient < 1.0f);

    CHECK(snprintf(out, sizeof out, "%s/maps", folder) < (int)sizeof out);
    export_maps(session, out, SVBRDF_OK);
    /* A file stands where the folder should be. */
    CHECK(snprintf(out, sizeof out, "%s/00.ppm", folder) < (int)sizeof out);
    export_maps(session, out, SVBRDF_IO);
    EVENTUALLY(told(&c));
    OK(svbrdf_session_destroy(session));
}

static float linear(unsigned char v)
{
    float x = (float)v / 255.0f;
    return x <= 0.04045f ? x / 12.92f : powf((x + 0.055f) / 1.055f, 2.4f);
}

static unsigned char byte(double v)
{
    return (unsigned char)(v < 0.0 ? 0 : v > 255.0 ? 255 : v + 0.5);
}

/* Linear half floats: positive, below 2. */
static unsigned short half(float v)
{
    int exponent = 0;
    float mantissa;
    if (v < 6.2e-5f) {
        return 0;
    }
    mantissa = frexpf(v, &exponent);
    return (unsigned short)(((exponent + 14) << 10) | (int)((mantissa * 2.0f - 1.0f) * 1023.5f));
}

static void expect_pose(const svbrdf_photo_report *a, const svbrdf_photo_report *b, double mm)
{
    int i;
    for (i = 0; i < 3; i++) {
        CHECK(fabs(a->translation_mm[i] - b->translation_mm[i]) < mm);
    }
}

/* The same photo in every layout: the same pose. */
void test_layouts(const char *folder)
{
    counts c = {0, 0, 0, 0, 0.0f};
    picture p = read_ppm(folder, "00.ppm");
    size_t w = p.width, h = p.height, x, y, n = w * h, i;
    svbrdf_session *session = create(&c);
    svbrdf_photo_report reference, report;
    svbrdf_image image;
    unsigned format;
    unsigned char *bytes = malloc(16 * n + 64);
    CHECK(bytes != NULL);
    OK(svbrdf_session_pause(session));
    OK(svbrdf_photo_report_init(&reference, sizeof reference));
    report = reference;
    rgb8(&image, &p);
    OK(svbrdf_session_add_photo(session, &image, NULL, &reference));

    for (format = SVBRDF_PIXEL_RGBA8; format <= SVBRDF_PIXEL_P010; format++) {
        double tolerance_mm = 0.02;
        rgb8(&image, &p);
        image.format = format;
        image.planes[0].data = bytes;
        image.planes[0].row_stride = 0;
        image.planes[0].pixel_stride = 0;
        switch (format) {
        case SVBRDF_PIXEL_RGBA8: /* turned by a quarter: stored lying on its left side */
            for (i = 0; i < n; i++) {
                x = i % w;
                y = i / w;
                memcpy(bytes + 4 * ((w - 1 - x) * h + y), p.rgb + 3 * i, 3);
            }
            image.width = p.height;
            image.height = p.width;
            image.rotation = 90;
            image.planes[0].row_stride = 4 * h;
            image.planes[0].bytes = 4 * n;
            break;
        case SVBRDF_PIXEL_RGB16: /* rows 10 bytes longer than needed, at an odd address */
            image.planes[0].row_stride = 6 * w + 10;
            image.planes[0].data = bytes + 1;
            image.planes[0].bytes = h * image.planes[0].row_stride;
            for (i = 0; i < 3 * n; i++) {
                uint16_t v = (uint16_t)(p.rgb[i] * 257);
                memcpy(bytes + 1 + i / (3 * w) * (6 * w + 10) + i % (3 * w) * 2, &v, 2);
            }
            break;
        case SVBRDF_PIXEL_RGBA16:
        case SVBRDF_PIXEL_RGBA_F16:
            image.planes[0].row_stride = 8 * w;
            image.planes[0].bytes = 8 * n;
            for (i = 0; i < 3 * n; i++) {
                uint16_t v = format == SVBRDF_PIXEL_RGBA16 ? (uint16_t)(p.rgb[i] * 257)
                                                           : half(linear(p.rgb[i]));
                memcpy(bytes + i / 3 * 8 + i % 3 * 2, &v, 2);
            }
            image.saturation = 0.99f;
            tolerance_mm = 0.1; /* halves were cut off, not rounded */
            break;
        case SVBRDF_PIXEL_RGB_F32:
        case SVBRDF_PIXEL_RGBA_F32: {
            size_t pixel = format == SVBRDF_PIXEL_RGB_F32 ? 12 : 16;
            image.planes[0].row_stride = pixel * w;
            image.planes[0].bytes = pixel * n;
            image.saturation = 0.99f;
            for (i = 0; i < 3 * n; i++) {
                float v = linear(p.rgb[i]);
                memcpy(bytes + i / 3 * pixel + i % 3 * 4, &v, 4);
            }
            break;
        }
        case SVBRDF_PIXEL_YUV420: /* NV21: V before U in one plane */
            image.yuv_matrix = SVBRDF_YUV_BT601_FULL;
            image.planes[0].row_stride = w;
            image.planes[0].bytes = n;
            for (i = 0; i < n; i++) {
                const unsigned char *q = p.rgb + 3 * i;
                bytes[i] = byte(0.299 * q[0] + 0.587 * q[1] + 0.114 * q[2]);
            }
            for (y = 0; y < h; y += 2) {
                for (x = 0; x < w; x += 2) {
                    const unsigned char *q = p.rgb + 3 * (y * w + x);
                    double luma = 0.299 * q[0] + 0.587 * q[1] + 0.114 * q[2];
                    unsigned char *vu = bytes + n + y / 2 * w + x;
                    vu[0] = byte(128.0 + (q[0] - luma) / 1.402);
                    vu[1] = byte(128.0 + (q[2] - luma) / 1.772);
                }
            }
            for (i = 1; i <= 2; i++) {
                image.planes[i].data = bytes + n + (i == 1);
                image.planes[i].row_stride = w;
                image.planes[i].pixel_stride = 2;
                image.planes[i].bytes = n / 2 - (i == 1);
            }
            tolerance_mm = 0.1;
            break;
        case SVBRDF_PIXEL_BGRA8: /* upside down */
            for (i = 0; i < n; i++) {
                const unsigned char *q = p.rgb + 3 * (n - 1 - i);
                bytes[4 * i] = q[2];
                bytes[4 * i + 1] = q[1];
                bytes[4 * i + 2] = q[0];
            }
            image.rotation = 180;
            image.planes[0].row_stride = 4 * w;
            image.planes[0].bytes = 4 * n;
            break;
        case SVBRDF_PIXEL_P010: /* as video: BT.2020, 64 to 940 */
            image.yuv_matrix = SVBRDF_YUV_BT2020_LIMITED;
            image.planes[0].row_stride = 2 * w;
            image.planes[0].bytes = 2 * n;
            for (i = 0; i < n; i++) {
                const unsigned char *q = p.rgb + 3 * i;
                double luma = 0.2627 * q[0] + 0.6780 * q[1] + 0.0593 * q[2];
                uint16_t *words = (uint16_t *)bytes;
                words[i] = (uint16_t)((unsigned)(64.5 + luma * 876.0 / 255.0) << 6);
                if (i % w % 2 == 0 && i / w % 2 == 0) {
                    uint16_t *uv = words + n + i / w / 2 * w + i % w;
                    uv[0] = (uint16_t)((unsigned)(512.5 + (q[2] - luma) / 1.8814 * 896.0 / 255.0) << 6);
                    uv[1] = (uint16_t)((unsigned)(512.5 + (q[0] - luma) / 1.4746 * 896.0 / 255.0) << 6);
                }
            }
            for (i = 1; i <= 2; i++) {
                image.planes[i].data = bytes + 2 * n + (i == 2 ? 2 : 0);
                image.planes[i].row_stride = 2 * w;
                image.planes[i].pixel_stride = 4;
                image.planes[i].bytes = n - (i == 2 ? 2 : 0);
            }
            tolerance_mm = 0.1;
            break;
        default: /* Bayer, 10 bits over a black level, red and blue half as bright */
            image.bayer_pattern = SVBRDF_BAYER_GRBG;
            image.white_level = 1023.0f;
            image.white_balance[0] = image.white_balance[2] = 2.0f;
            image.planes[0].row_stride = 2 * w;
            image.planes[0].bytes = 2 * n;
            for (i = 0; i < 4; i++) {
                image.black_level[i] = 64.0f;
            }
            for (i = 0; i < n; i++) {
                size_t odd_x = i % w & 1, odd_y = i / w & 1;
                size_t channel = odd_x == odd_y ? 1 : odd_x ? 0 : 2;
                float v = linear(p.rgb[3 * i + channel]) * (channel == 1 ? 1.0f : 0.5f);
                uint16_t raw = (uint16_t)(64.0f + 959.0f * v + 0.5f);
                memcpy(bytes + 2 * i, &raw, 2);
            }
            tolerance_mm = 0.3; /* two thirds of the values were thrown away */
        }
        OK(svbrdf_session_add_photo(session, &image, NULL, &report));
        CHECK(report.index == format - 1);
        expect_pose(&report, &reference, tolerance_mm);
    }
    free(bytes);
    free(p.rgb);
    EXPECT(svbrdf_session_wait(session, 10), SVBRDF_TIMEOUT);
    OK(svbrdf_session_destroy(session));
}

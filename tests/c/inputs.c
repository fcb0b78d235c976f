/* One picture in the formats, curves and primaries of phones: the same maps. */
#include "check.h"

#include <math.h>

enum { TEXELS = SIDE * SIDE };

/* Linear Rec. 709 and D65 to the primaries, from their chromaticities (ITU-R BT.709, SMPTE EG 432-1,
 * ITU-R BT.2020). */
static const double to_display_p3[9] = {0.8224621, 0.1775380, 0.0,       0.0331941, 0.9668058,
                                        0.0,       0.0170827, 0.0723974, 0.9105199};
static const double to_rec2020[9] = {0.6274039, 0.3292830, 0.0433131, 0.0690973, 0.9195404,
                                     0.0113623, 0.0163914, 0.0880133, 0.8955953};

static double srgb(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

/* The OETF of ITU-R BT.2100's hybrid log-gamma. */
static double hlg(double linear)
{
    return linear <= 1.0 / 12.0 ? sqrt(3.0 * linear)
                                : 0.17883277 * log(12.0 * linear - 0.28466892) + 0.55991073;
}

/* The inverse EOTF of ITU-R BT.2100's perceptual quantiser, 1 being 203 cd/m2. */
static double pq(double linear)
{
    double y = pow(linear * 203.0 / 10000.0, 0.1593017578125);
    return pow((0.8359375 + 18.8515625 * y) / (1.0 + 18.6875 * y), 78.84375);
}

/* A smooth picture in colours: linear Rec. 709, three values a pixel. */
static float *picture_in_colours(void)
{
    float *rgb = malloc(3 * TEXELS * sizeof *rgb);
    size_t i;
    CHECK(rgb != NULL);
    for (i = 0; i < TEXELS; i++) {
        double x = (double)(i % SIDE) / SIDE, y = (double)(i / SIDE) / SIDE;
        rgb[3 * i] = (float)(0.15 + 0.25 * x);
        rgb[3 * i + 1] = (float)(0.20 + 0.10 * y);
        rgb[3 * i + 2] = (float)(0.30 - 0.20 * x * y);
    }
    return rgb;
}

/* It with other primaries and a curve. */
static double *stored(const float *rgb, const double matrix[9], double (*curve)(double))
{
    double *out = malloc(3 * TEXELS * sizeof *out);
    size_t i, c, k;
    CHECK(out != NULL);
    for (i = 0; i < TEXELS; i++) {
        for (c = 0; c < 3; c++) {
            double sum = matrix == NULL ? (double)rgb[3 * i + c] : 0.0;
            for (k = 0; matrix != NULL && k < 3; k++) {
                sum += matrix[3 * c + k] * (double)rgb[3 * i + k];
            }
            out[3 * i + c] = curve(sum);
        }
    }
    return out;
}

/* Diffuse albedo of the first maps. */
static void push(const svbrdf_image *image, float *diffuse)
{
    static const float above[3] = {0.0f, 10.0f, 150.0f};
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_maps *maps = NULL;
    rectified_options(&options);
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_session_pause(session));
    OK(svbrdf_session_add_rectified_photo(session, image, NULL, above, above, NULL));
    OK(svbrdf_session_snapshot_maps(session, &maps));
    OK(svbrdf_maps_copy(maps, SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_FORMAT_F32, diffuse,
                        3 * TEXELS * sizeof *diffuse, 0));
    OK(svbrdf_maps_destroy(maps));
    OK(svbrdf_session_destroy(session));
}

static double difference(const svbrdf_image *image, const float *expected)
{
    float *found = malloc(3 * TEXELS * sizeof *found);
    double worst = 0.0;
    size_t i;
    CHECK(found != NULL);
    push(image, found);
    for (i = 0; i < 3 * TEXELS; i++) {
        double off = fabs((double)found[i] - (double)expected[i]);
        worst = off > worst ? off : worst;
    }
    free(found);
    return worst;
}

static svbrdf_image image_of(svbrdf_pixel_format format, const void *data, size_t pixel)
{
    svbrdf_image image;
    OK(svbrdf_image_init(&image, sizeof image));
    image.format = format;
    image.width = image.height = SIDE;
    image.planes[0].data = data;
    image.planes[0].bytes = pixel * TEXELS;
    image.planes[0].row_stride = pixel * SIDE;
    return image;
}

static double as_rgb16(const float *rgb, const double matrix[9], double (*curve)(double),
                       svbrdf_transfer transfer, svbrdf_primaries primaries, const float *expected)
{
    double *values = stored(rgb, matrix, curve), off;
    uint16_t *words = malloc(3 * TEXELS * sizeof *words);
    svbrdf_image image = image_of(SVBRDF_PIXEL_RGB16, words, 6);
    size_t i;
    CHECK(words != NULL);
    for (i = 0; i < 3 * TEXELS; i++) {
        words[i] = (uint16_t)(65535.0 * values[i] + 0.5);
    }
    image.transfer = transfer;
    image.primaries = primaries;
    off = difference(&image, expected);
    free(words);
    free(values);
    return off;
}

static double as_bgra8(const float *rgb, const float *expected)
{
    double *values = stored(rgb, to_display_p3, srgb), off;
    unsigned char *bytes = malloc(4 * TEXELS);
    svbrdf_image image = image_of(SVBRDF_PIXEL_BGRA8, bytes, 4);
    size_t i;
    CHECK(bytes != NULL);
    for (i = 0; i < 4 * TEXELS; i++) {
        bytes[i] = i % 4 == 3 ? 7 : (unsigned char)(255.0 * values[i / 4 * 3 + 2 - i % 4] + 0.5);
    }
    image.primaries = SVBRDF_PRIMARIES_DISPLAY_P3;
    off = difference(&image, expected);
    free(bytes);
    free(values);
    return off;
}

/* As phones take HDR video: BT.2020, 64 to 940, chroma of every second pixel. */
static double as_p010(const float *rgb, double (*curve)(double), svbrdf_transfer transfer,
                      const float *expected)
{
    double *values = stored(rgb, to_rec2020, curve), off;
    uint16_t *words = malloc(3 * TEXELS);
    svbrdf_image image = image_of(SVBRDF_PIXEL_P010, words, 2);
    size_t i;
    CHECK(words != NULL);
    for (i = 0; i < TEXELS; i++) {
        const double *v = values + 3 * i;
        double luma = 0.2627 * v[0] + 0.6780 * v[1] + 0.0593 * v[2];
        words[i] = (uint16_t)((unsigned)(64.5 + 876.0 * luma) << 6);
        if (i % SIDE % 2 == 0 && i / SIDE % 2 == 0) {
            uint16_t *uv = words + TEXELS + i / SIDE / 2 * SIDE + i % SIDE;
            uv[0] = (uint16_t)((unsigned)(512.5 + 896.0 * (v[2] - luma) / 1.8814) << 6);
            uv[1] = (uint16_t)((unsigned)(512.5 + 896.0 * (v[0] - luma) / 1.4746) << 6);
        }
    }
    for (i = 1; i <= 2; i++) {
        image.planes[i].data = words + TEXELS + (i - 1);
        image.planes[i].row_stride = 2 * SIDE;
        image.planes[i].pixel_stride = 4;
        image.planes[i].bytes = TEXELS - 2 * (i - 1);
    }
    image.yuv_matrix = SVBRDF_YUV_BT2020_LIMITED;
    image.transfer = transfer;
    image.primaries = SVBRDF_PRIMARIES_REC2020;
    off = difference(&image, expected);
    free(words);
    free(values);
    return off;
}

void test_inputs(const char *folder)
{
    /* Steps of 16 bits, of 8, and of 10 over 876 levels with chroma of every second pixel, which the
     * networks enlarge. A wrong curve or wrong primaries are off by at least twice as much. */
    const double fine = 0.001, coarse = 0.02, wrong = 0.04;
    float *rgb = picture_in_colours();
    float *expected = malloc(3 * TEXELS * sizeof *expected);
    svbrdf_image image = image_of(SVBRDF_PIXEL_RGB_F32, rgb, 12);
    double off[10];
    size_t i;
    (void)folder;
    CHECK(expected != NULL);
    push(&image, expected);
    off[0] = as_rgb16(rgb, NULL, srgb, SVBRDF_TRANSFER_SRGB, SVBRDF_PRIMARIES_REC709, expected);
    off[1] = as_rgb16(rgb, NULL, hlg, SVBRDF_TRANSFER_HLG, SVBRDF_PRIMARIES_REC709, expected);
    off[2] = as_rgb16(rgb, NULL, pq, SVBRDF_TRANSFER_PQ, SVBRDF_PRIMARIES_REC709, expected);
    off[3] = as_rgb16(rgb, to_display_p3, srgb, SVBRDF_TRANSFER_SRGB, SVBRDF_PRIMARIES_DISPLAY_P3,
                      expected);
    off[4] = as_rgb16(rgb, to_rec2020, hlg, SVBRDF_TRANSFER_HLG, SVBRDF_PRIMARIES_REC2020,
                      expected);
    off[5] = as_bgra8(rgb, expected);
    off[6] = as_p010(rgb, hlg, SVBRDF_TRANSFER_HLG, expected);
    off[7] = as_p010(rgb, pq, SVBRDF_TRANSFER_PQ, expected);
    off[8] = as_rgb16(rgb, NULL, hlg, SVBRDF_TRANSFER_SRGB, SVBRDF_PRIMARIES_REC709, expected);
    off[9] = as_rgb16(rgb, to_rec2020, srgb, SVBRDF_TRANSFER_SRGB, SVBRDF_PRIMARIES_REC709, expected);
    for (i = 0; i < 10; i++) {
        printf("%u: %.5f\n", (unsigned)i, off[i]);
        CHECK(i < 5 ? off[i] < fine : i < 8 ? off[i] < coarse : off[i] > wrong);
    }
    free(rgb);
    free(expected);
}

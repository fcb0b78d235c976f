/* Outputs: maps in every format against closed forms, reduced, rendered; printed boards. */
#include "check.h"

#include <math.h>

enum { TEXELS = SIDE * SIDE };

/* Maps that differ from texel to texel. */
static svbrdf_session *uneven_session(void)
{
    static const float above[3] = {0.0f, 10.0f, 150.0f};
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_image image;
    unsigned char *rgb = malloc(3 * TEXELS);
    size_t i;
    CHECK(rgb != NULL);
    gray_image(&image, rgb, 0);
    for (i = 0; i < 3 * TEXELS; i++) {
        rgb[i] = (unsigned char)(60 + (i / 3 % SIDE * (i % 3 + 1) + i / (3 * SIDE) * 5) % 160);
    }
    rectified_options(&options);
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_session_pause(session));
    OK(svbrdf_session_add_rectified_photo(session, &image, NULL, above, above, NULL));
    free(rgb);
    return session;
}

/* The value of a half float. */
static double half_value(uint16_t half)
{
    int exponent = half >> 10 & 31, mantissa = half & 1023;
    double size = exponent == 0 ? ldexp(mantissa, -24) : ldexp(1024 + mantissa, exponent - 25);
    CHECK(exponent != 31);
    return half >> 15 ? -size : size;
}

/* Whether a half float is the one nearest to a value, of at most half a step from it. */
static int is_nearest(uint16_t half, float value)
{
    int exponent = 0;
    (void)frexp((double)value, &exponent);
    return fabs(half_value(half) - (double)value) <= ldexp(0.5, (exponent < -13 ? -13 : exponent) - 11);
}

/* Whether a byte is the nearest one to a share of 255; single precision decides in the middle. */
static int is_byte(unsigned char byte, double share)
{
    return fabs(255.0 * (share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share) - byte) < 0.5005;
}

static double srgb(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

static const void *view(const svbrdf_maps *maps, svbrdf_map map, svbrdf_map_format format)
{
    svbrdf_map_view seen;
    OK(svbrdf_map_view_init(&seen, sizeof seen));
    OK(svbrdf_maps_view(maps, map, format, &seen));
    return seen.data;
}

static void formats(const svbrdf_maps *maps)
{
    svbrdf_map map;
    svbrdf_map_view seen;
    size_t i, c;
    const float *up = view(maps, SVBRDF_MAP_NORMAL, SVBRDF_MAP_FORMAT_F32);
    const unsigned char *r8 = view(maps, SVBRDF_MAP_ROUGHNESS, SVBRDF_MAP_FORMAT_R8);
    for (map = SVBRDF_MAP_NORMAL; map <= SVBRDF_MAP_NORMAL_DIRECTX; map++) {
        const float *exact = view(maps, map, SVBRDF_MAP_FORMAT_F32);
        const float *wide = view(maps, map, SVBRDF_MAP_FORMAT_RGBA32F);
        const uint16_t *half = view(maps, map, SVBRDF_MAP_FORMAT_RGBA16F);
        const unsigned char *bytes = view(maps, map, SVBRDF_MAP_FORMAT_RGBA8);
        int normal = map == SVBRDF_MAP_NORMAL || map == SVBRDF_MAP_NORMAL_DIRECTX;
        for (i = 0; i < TEXELS; i++) {
            CHECK(wide[4 * i + 3] == 1.0f && half[4 * i + 3] == 0x3C00 && bytes[4 * i + 3] == 255);
            for (c = 0; c < 3; c++) {
                float value = map != SVBRDF_MAP_ROUGHNESS ? exact[3 * i + c]
                              : c == 0                    ? 1.0f
                              : c == 1                    ? exact[i]
                                                          : 0.0f;
                double share = normal ? 0.5 * (double)value + 0.5 : (double)value;
                if (map == SVBRDF_MAP_DIFFUSE || map == SVBRDF_MAP_SPECULAR) {
                    share = srgb(share);
                }
                CHECK(wide[4 * i + c] == value && is_nearest(half[4 * i + c], value));
                CHECK(is_byte(bytes[4 * i + c], share));
            }
            if (map == SVBRDF_MAP_ROUGHNESS) {
                CHECK(r8[i] == bytes[4 * i + 1]);
            } else if (map == SVBRDF_MAP_NORMAL_DIRECTX) {
                CHECK(exact[3 * i] == up[3 * i] && exact[3 * i + 1] == -up[3 * i + 1]);
                CHECK(exact[3 * i + 2] == up[3 * i + 2]);
            }
        }
        OK(svbrdf_map_view_init(&seen, sizeof seen));
        if (map != SVBRDF_MAP_ROUGHNESS) {
            EXPECT(svbrdf_maps_view(maps, map, SVBRDF_MAP_FORMAT_R8, &seen),
                   SVBRDF_INVALID_ARGUMENT);
        }
    }
    EXPECT(svbrdf_maps_view(maps, 1, SVBRDF_MAP_FORMAT_RGBA32F + 1, &seen), SVBRDF_INVALID_ARGUMENT);
}

/* Means of squares of texels, of slopes for normals. */
static void reduced(const svbrdf_maps *maps)
{
    const float *normal = view(maps, SVBRDF_MAP_NORMAL, SVBRDF_MAP_FORMAT_F32);
    const float *diffuse = view(maps, SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_FORMAT_F32);
    const float *rough = view(maps, SVBRDF_MAP_ROUGHNESS, SVBRDF_MAP_FORMAT_F32);
    svbrdf_maps *small = NULL;
    unsigned level, width = 0, height = 0;
    float mm[2];
    for (level = 0; level <= 8; level++) {
        unsigned side = 1u << level, w = SIDE / side, x, y, k;
        OK(svbrdf_maps_reduced(maps, level, &small));
        OK(svbrdf_maps_size(small, &width, &height, mm));
        CHECK(width == w && height == w && mm[0] == 100.0f && mm[1] == 100.0f);
        for (y = 0; y < w; y++) {
            for (x = 0; x < w; x++) {
                const float *n = (const float *)view(small, 1, 1) + 3 * (y * w + x);
                double p = 0, q = 0, d = 0, r = 0, scale = 1.0 / (side * side), length;
                for (k = 0; k < side * side; k++) {
                    size_t i = (size_t)(y * side + k / side) * SIDE + x * side + k % side;
                    p += scale * (double)normal[3 * i] / (double)normal[3 * i + 2];
                    q += scale * (double)normal[3 * i + 1] / (double)normal[3 * i + 2];
                    d += scale * (double)diffuse[3 * i + 2];
                    r += scale * (double)rough[i];
                }
                length = sqrt(1 + p * p + q * q);
                /* Single precision, some roundings a level. */
                CHECK(fabs(p / length - (double)n[0]) < 2e-6 && fabs(q / length - (double)n[1]) < 2e-6);
                n = (const float *)view(small, SVBRDF_MAP_DIFFUSE, 1) + 3 * (y * w + x);
                CHECK(fabs(d - (double)n[2]) < 2e-6);
                n = (const float *)view(small, SVBRDF_MAP_ROUGHNESS, 1) + y * w + x;
                CHECK(fabs(r - (double)n[0]) < 2e-6);
            }
        }
        OK(svbrdf_maps_destroy(small));
    }
    small = NULL;
    EXPECT(svbrdf_maps_reduced(maps, 9, &small), SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "256x256") != NULL);
    EXPECT(svbrdf_maps_reduced(maps, 0xFFFFFFFFu, &small), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_reduced(maps, 1, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_reduced(NULL, 1, &small), SVBRDF_INVALID_HANDLE);
    CHECK(small == NULL);
}

static void unit(double v[3])
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    v[0] /= length, v[1] /= length, v[2] /= length;
}

static double cosine(const double a[3], const double b[3])
{
    double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    return dot < 1e-3 ? 1e-3 : dot;
}

/* Cook-Torrance, GGX: radiance of one texel in one channel under an irradiance of 1 before the cosine. */
static double radiance(const svbrdf_maps *maps, size_t i, size_t c, const float camera[3],
                       const float light[3], double irradiance)
{
    const float *normal = (const float *)view(maps, SVBRDF_MAP_NORMAL, 1) + 3 * i;
    double kd = (double)((const float *)view(maps, SVBRDF_MAP_DIFFUSE, 1))[3 * i + c];
    double f0 = (double)((const float *)view(maps, SVBRDF_MAP_SPECULAR, 1))[3 * i + c];
    double rough = (double)((const float *)view(maps, SVBRDF_MAP_ROUGHNESS, 1))[i];
    double x = 100.0 * (((double)(i % SIDE) + 0.5) / SIDE - 0.5);
    double y = 100.0 * (0.5 - ((double)(i / SIDE) + 0.5) / SIDE);
    double l[3], v[3], h[3], n[3], a = rough * rough, k = 0.5 * a, nl, nv, nh, vh, d, fresnel;
    int j;
    for (j = 0; j < 3; j++) {
        double at = j == 0 ? x : j == 1 ? y : 0.0;
        l[j] = (double)light[j] - at;
        v[j] = (double)camera[j] - at;
        n[j] = (double)normal[j];
    }
    unit(l);
    unit(v);
    for (j = 0; j < 3; j++) {
        h[j] = l[j] + v[j];
    }
    unit(h);
    nl = cosine(n, l), nv = cosine(n, v), nh = cosine(n, h), vh = cosine(v, h);
    d = nh * nh * (a * a - 1.0) + 1.0;
    fresnel = f0 + (1.0 - f0) * exp2((-5.55473 * vh - 6.98316) * vh);
    return irradiance * nl *
           (kd / 3.14159265358979 + fresnel * a * a /
                                        (4.0 * 3.14159265358979 * d * d *
                                         (nl * (1.0 - k) + k) * (nv * (1.0 - k) + k)));
}

static void rendered(const svbrdf_maps *maps)
{
    svbrdf_render_options options;
    float *exact = malloc(16 * TEXELS), *bright = malloc(12 * TEXELS);
    uint16_t *half = malloc(8 * TEXELS);
    enum { STRIDE = 4 * SIDE + 9 };
    unsigned char *bytes = malloc(STRIDE * SIDE);
    size_t i, c;
    CHECK(exact != NULL && bright != NULL && half != NULL && bytes != NULL);
    OK(svbrdf_render_options_init(&options, sizeof options));
    options.camera_mm[0] = -20.0f;
    options.light_mm[0] = 60.0f;
    options.light_mm[1] = 40.0f;
    options.light_mm[2] = 150.0f;
    options.light_power[2] = 2.0f;
    OK(svbrdf_maps_render(maps, &options, SVBRDF_MAP_FORMAT_RGBA32F, exact, 16 * TEXELS, 0));
    OK(svbrdf_maps_render(maps, &options, SVBRDF_MAP_FORMAT_RGBA16F, half, 8 * TEXELS, 0));
    memset(bytes, 0x5A, STRIDE * SIDE);
    OK(svbrdf_maps_render(maps, &options, SVBRDF_MAP_FORMAT_RGBA8, bytes, STRIDE * SIDE, STRIDE));
    for (i = 0; i < TEXELS; i++) {
        const unsigned char *byte = bytes + i / SIDE * STRIDE + 4 * (i % SIDE);
        CHECK(exact[4 * i + 3] == 1.0f && half[4 * i + 3] == 0x3C00 && byte[3] == 255);
        CHECK(i % SIDE != SIDE - 1 || byte[4] == 0x5A);
        for (c = 0; c < 3; c++) {
            double expected = radiance(maps, i, c, options.camera_mm, options.light_mm,
                                       (double)options.light_power[c]);
            double found = (double)exact[4 * i + c];
            /* Single precision and an exponential by polynomial. */
            CHECK(fabs(found - expected) < 1e-5 + 2e-4 * expected);
            CHECK(is_nearest(half[4 * i + c], exact[4 * i + c]));
            CHECK(is_byte(byte[c], srgb(found)));
        }
    }
    /* At its distance a light that falls off is as bright; a surround is seen by all of the material. */
    options.falloff = SVBRDF_FALLOFF_INVERSE_SQUARE;
    options.ambient[1] = 0.25f;
    for (c = 0; c < 3; c++) {
        options.light_power[c] = 40000.0f;
    }
    OK(svbrdf_maps_render(maps, &options, SVBRDF_MAP_FORMAT_F32, bright, 12 * TEXELS, 0));
    for (i = 0; i < TEXELS; i++) {
        double x = 60.0 - 100.0 * (((double)(i % SIDE) + 0.5) / SIDE - 0.5);
        double y = 40.0 - 100.0 * (0.5 - ((double)(i / SIDE) + 0.5) / SIDE);
        double irradiance = 40000.0 / (x * x + y * y + 150.0 * 150.0);
        for (c = 0; c < 2; c++) {
            double expected =
                radiance(maps, i, c, options.camera_mm, options.light_mm, irradiance);
            if (c == 1) {
                expected += 0.25 * (double)(((const float *)view(maps, SVBRDF_MAP_DIFFUSE, 1))[3 * i + 1] +
                                            ((const float *)view(maps, SVBRDF_MAP_SPECULAR, 1))[3 * i + 1]);
            }
            CHECK(fabs((double)bright[3 * i + c] - expected) < 1e-5 + 2e-4 * expected);
        }
    }
    OK(svbrdf_maps_render(maps, NULL, SVBRDF_MAP_FORMAT_RGB8, bytes, 3 * TEXELS, 0));
#define REFUSED_RENDERING(change)                                                                \
    do {                                                                                         \
        svbrdf_render_options o;                                                                 \
        svbrdf_map_format format = SVBRDF_MAP_FORMAT_RGBA8;                                      \
        size_t size = 4 * TEXELS, stride = 0;                                                    \
        OK(svbrdf_render_options_init(&o, sizeof o));                                            \
        change;                                                                                  \
        EXPECT(svbrdf_maps_render(maps, &o, format, bytes, size, stride),                        \
               SVBRDF_INVALID_ARGUMENT);                                                         \
    } while (0)
    REFUSED_RENDERING((void)(size -= 1));
    REFUSED_RENDERING((void)(stride = 4 * SIDE - 1));
    REFUSED_RENDERING((void)(stride = 4 * SIDE + 1)); /* ends beyond the memory */
    REFUSED_RENDERING((void)(stride = (size_t)-1));
    REFUSED_RENDERING((void)(format = SVBRDF_MAP_FORMAT_R8));
    REFUSED_RENDERING((void)(format = 0));
    REFUSED_RENDERING((void)(o.size = 8));
    REFUSED_RENDERING((void)(o.falloff = SVBRDF_FALLOFF_AUTO));
    REFUSED_RENDERING((void)(o.camera_mm[2] = 0.0f));
    REFUSED_RENDERING((void)(o.light_mm[0] = NAN));
    REFUSED_RENDERING((void)(o.light_power[1] = -1.0f));
    REFUSED_RENDERING((void)(o.ambient[1] = INFINITY));
    EXPECT(svbrdf_maps_render(maps, NULL, SVBRDF_MAP_FORMAT_RGBA8, NULL, 4 * TEXELS, 0),
           SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_render(NULL, NULL, SVBRDF_MAP_FORMAT_RGBA8, bytes, 4 * TEXELS, 0),
           SVBRDF_INVALID_HANDLE);
    free(exact);
    free(bright);
    free(half);
    free(bytes);
}

static void print(const char *folder, const svbrdf_board *board, svbrdf_page page,
                  svbrdf_sheet_format format, const char *name, const char *begins)
{
    svbrdf_buffer *buffer = NULL;
    const void *data = NULL;
    size_t bytes = 0;
    char path[4096];
    FILE *file;
    OK(svbrdf_board_print(board, page, format, &buffer));
    OK(svbrdf_buffer_view(buffer, &data, &bytes));
    CHECK(bytes > 1000 && memcmp(data, begins, strlen(begins)) == 0);
    CHECK(snprintf(path, sizeof path, "%s/%s", folder, name) < (int)sizeof path);
    file = fopen(path, "wb");
    CHECK(file != NULL && fwrite(data, 1, bytes, file) == bytes && fclose(file) == 0);
    OK(svbrdf_buffer_destroy(buffer));
}

/* Boards into files, which whoever runs this compares with the Rust library's. */
static void boards(const char *folder)
{
    svbrdf_board board;
    svbrdf_buffer *none = NULL;
    OK(svbrdf_board_init(&board, sizeof board));
    board.kind = SVBRDF_BOARD_CHARUCO_RING;
    board.marker_mm = 8.0;
    board.dictionary = "DICT_4X4_250";
    print(folder, NULL, SVBRDF_PAGE_A4, SVBRDF_SHEET_PDF, "board.pdf", "%PDF-1.6\n");
    print(folder, &board, SVBRDF_PAGE_LETTER, SVBRDF_SHEET_SVG, "board.svg", "<svg ");
    print(folder, &board, SVBRDF_PAGE_A4, SVBRDF_SHEET_PNG, "board.png", "\x89PNG\r\n");
    EXPECT(svbrdf_board_print(&board, 0, SVBRDF_SHEET_PDF, &none), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_board_print(&board, SVBRDF_PAGE_A4, 4, &none), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_board_print(&board, SVBRDF_PAGE_A4, SVBRDF_SHEET_PDF, NULL),
           SVBRDF_INVALID_ARGUMENT);
    board.dictionary = "DICT_4X4_50";
    EXPECT(svbrdf_board_print(&board, SVBRDF_PAGE_A4, SVBRDF_SHEET_PDF, &none),
           SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "marker for each") != NULL);
    board.kind = SVBRDF_BOARD_CHECKERBOARD_RING;
    board.square_mm = 14.0;
    EXPECT(svbrdf_board_print(&board, SVBRDF_PAGE_A4, SVBRDF_SHEET_PDF, &none),
           SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "too large") != NULL);
    board.rows = 0xFFFFFFFFu;
    EXPECT(svbrdf_board_print(&board, SVBRDF_PAGE_A4, SVBRDF_SHEET_PNG, &none),
           SVBRDF_INVALID_ARGUMENT);
    CHECK(none == NULL);
}

void test_outputs(const char *folder)
{
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_maps *maps = NULL;
    rectified_options(&options);
    OK(svbrdf_session_create(&options, &session));
    EXPECT(svbrdf_session_snapshot_maps(session, &maps), SVBRDF_NO_MAPS);
    OK(svbrdf_session_destroy(session));
    EXPECT(svbrdf_session_snapshot_maps(session, &maps), SVBRDF_INVALID_HANDLE);

    session = uneven_session();
    OK(svbrdf_session_snapshot_maps(session, &maps));
    formats(maps);
    reduced(maps);
    rendered(maps);
    OK(svbrdf_maps_destroy(maps));
    OK(svbrdf_session_destroy(session));
    boards(folder);
}

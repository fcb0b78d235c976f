/* Maps of values in memory, with and without anisotropy, a coat and sheen. */
#include "check.h"

#include <math.h>

enum { WIDE = 6, HIGH = 4, TEXELS = WIDE * HIGH };

typedef struct {
    float normal[3 * TEXELS], diffuse[3 * TEXELS], specular[3 * TEXELS], roughness[TEXELS];
    float anisotropy[3 * TEXELS], coat[3 * TEXELS], sheen[3 * TEXELS], sheen_roughness[TEXELS];
} material;

static void fill(material *m)
{
    int i, c;
    for (i = 0; i < TEXELS; i++) {
        const float angle = 3.0f * (float)i / TEXELS - 1.0f;
        const float x = 0.2f * sinf((float)i), y = 0.1f * cosf(2.0f * (float)i);
        m->normal[3 * i] = x;
        m->normal[3 * i + 1] = y;
        m->normal[3 * i + 2] = sqrtf(1.0f - x * x - y * y);
        for (c = 0; c < 3; c++) {
            m->diffuse[3 * i + c] = 0.1f * (float)(c + 1);
            m->specular[3 * i + c] = 0.9f - 0.02f * (float)i;
        }
        m->roughness[i] = 0.2f + 0.01f * (float)i;
        m->anisotropy[3 * i] = cosf(angle);
        m->anisotropy[3 * i + 1] = sinf(angle);
        /* The first row is isotropic. */
        m->anisotropy[3 * i + 2] = i < WIDE ? 0.0f : 0.02f * (float)i;
        m->coat[3 * i] = i < WIDE ? 0.0f : 0.5f;
        m->coat[3 * i + 1] = 0.05f * (float)(i % WIDE + 1);
        m->coat[3 * i + 2] = 0.0f;
        for (c = 0; c < 3; c++) {
            m->sheen[3 * i + c] = i < WIDE ? 0.0f : 0.2f * (float)(c + 1);
        }
        m->sheen_roughness[i] = 0.3f + 0.02f * (float)i;
    }
}

static void input_of(svbrdf_maps_input *input, const material *m, int lobes)
{
    OK(svbrdf_maps_input_init(input, sizeof *input));
    CHECK(input->sample_mm[0] == 100.0f && input->sample_mm[1] == 100.0f && input->coat == NULL);
    input->width = WIDE;
    input->height = HIGH;
    input->sample_mm[1] = 60.0f;
    input->normal = m->normal;
    input->diffuse = m->diffuse;
    input->specular = m->specular;
    input->roughness = m->roughness;
    input->anisotropy = lobes & SVBRDF_LOBE_ANISOTROPY ? m->anisotropy : NULL;
    input->coat = lobes & SVBRDF_LOBE_COAT ? m->coat : NULL;
    CHECK(input->sheen == NULL && input->sheen_roughness == NULL);
    if (lobes & SVBRDF_LOBE_SHEEN) {
        input->sheen = m->sheen;
        input->sheen_roughness = m->sheen_roughness;
    }
}

static void same(const svbrdf_maps *maps, svbrdf_map map, const float *expected, unsigned channels)
{
    svbrdf_map_view view;
    unsigned i;
    OK(svbrdf_map_view_init(&view, sizeof view));
    OK(svbrdf_maps_view(maps, map, SVBRDF_MAP_FORMAT_F32, &view));
    CHECK(view.width == WIDE && view.height == HIGH && view.channels == channels);
    for (i = 0; i < channels * TEXELS; i++) {
        /* Single precision, and logarithms of ratios of alpha. */
        CHECK(fabsf(((const float *)view.data)[i] - expected[i]) < 1e-5f);
    }
}

static void check_anisotropy(const svbrdf_maps *maps, const material *m)
{
    svbrdf_map_view view, bytes;
    unsigned i;
    OK(svbrdf_map_view_init(&view, sizeof view));
    OK(svbrdf_map_view_init(&bytes, sizeof bytes));
    OK(svbrdf_maps_view(maps, SVBRDF_MAP_ANISOTROPY, SVBRDF_MAP_FORMAT_F32, &view));
    OK(svbrdf_maps_view(maps, SVBRDF_MAP_ANISOTROPY, SVBRDF_MAP_FORMAT_RGBA8, &bytes));
    CHECK(view.channels == 3 && bytes.channels == 4);
    for (i = 0; i < TEXELS; i++) {
        const float *found = (const float *)view.data + 3 * i, *given = m->anisotropy + 3 * i;
        const unsigned char *b = (const unsigned char *)bytes.data + 4 * i;
        const float along = found[0] * given[0] + found[1] * given[1];
        CHECK(fabsf(found[2] - given[2]) < 1e-3f);
        /* Within a quarter turn of their mean, directions are not turned round. Those of isotropic texels
         * are all the same. */
        CHECK(given[2] > 0.0f ? along > 0.9999f : memcmp(found, view.data, 8) == 0);
        CHECK(fabsf(found[0] * found[0] + found[1] * found[1] - 1.0f) < 1e-5f);
        CHECK(fabsf(found[0] * 127.5f + 127.5f - (float)b[0]) <= 0.501f);
        CHECK(fabsf(found[1] * 127.5f + 127.5f - (float)b[1]) <= 0.501f);
        CHECK(fabsf(found[2] * 255.0f - (float)b[2]) <= 0.501f && b[3] == 255);
    }
}

static void check_kinds(void)
{
    static const svbrdf_lobes all =
        SVBRDF_LOBE_ANISOTROPY | SVBRDF_LOBE_COAT | SVBRDF_LOBE_SHEEN;
    svbrdf_maps_input input;
    svbrdf_maps *maps = NULL, *half = NULL;
    svbrdf_map_view view;
    svbrdf_lobes lobes, found;
    float copy[3 * TEXELS], mm[2];
    material m;
    fill(&m);
    OK(svbrdf_map_view_init(&view, sizeof view));
    for (lobes = 0; lobes <= all; lobes++) {
        const svbrdf_status coat = lobes & SVBRDF_LOBE_COAT ? SVBRDF_OK : SVBRDF_NO_LOBE;
        const svbrdf_status sheen = lobes & SVBRDF_LOBE_SHEEN ? SVBRDF_OK : SVBRDF_NO_LOBE;
        const svbrdf_status turned = lobes & SVBRDF_LOBE_ANISOTROPY ? SVBRDF_OK : SVBRDF_NO_LOBE;
        input_of(&input, &m, (int)lobes);
        OK(svbrdf_maps_from_memory(&input, &maps));
        OK(svbrdf_maps_lobes(maps, &found));
        CHECK(found == lobes);
        OK(svbrdf_maps_size(maps, NULL, NULL, mm));
        CHECK(mm[0] == 100.0f && mm[1] == 60.0f);
        same(maps, SVBRDF_MAP_NORMAL, m.normal, 3);
        same(maps, SVBRDF_MAP_DIFFUSE, m.diffuse, 3);
        same(maps, SVBRDF_MAP_SPECULAR, m.specular, 3);
        same(maps, SVBRDF_MAP_ROUGHNESS, m.roughness, 1);
        EXPECT(svbrdf_maps_view(maps, SVBRDF_MAP_COAT, SVBRDF_MAP_FORMAT_F32, &view), coat);
        EXPECT(svbrdf_maps_copy(maps, SVBRDF_MAP_ANISOTROPY, SVBRDF_MAP_FORMAT_F32, copy,
                                sizeof copy, 0),
               turned);
        if (coat == SVBRDF_OK) {
            same(maps, SVBRDF_MAP_COAT, m.coat, 3);
        }
        EXPECT(svbrdf_maps_view(maps, SVBRDF_MAP_SHEEN, SVBRDF_MAP_FORMAT_RGBA8, &view), sheen);
        if (sheen == SVBRDF_OK) {
            /* 0.2 on the sRGB curve. */
            CHECK(((const unsigned char *)view.data)[4 * WIDE + 3] == 255);
            CHECK(((const unsigned char *)view.data)[4 * WIDE] == 124);
            same(maps, SVBRDF_MAP_SHEEN, m.sheen, 3);
        }
        EXPECT(svbrdf_maps_view(maps, SVBRDF_MAP_SHEEN_ROUGHNESS, SVBRDF_MAP_FORMAT_R8, &view),
               sheen);
        if (sheen == SVBRDF_OK) {
            same(maps, SVBRDF_MAP_SHEEN_ROUGHNESS, m.sheen_roughness, 1);
        }
        if (turned == SVBRDF_OK) {
            check_anisotropy(maps, &m);
            EXPECT(svbrdf_maps_view(maps, SVBRDF_MAP_ANISOTROPY, SVBRDF_MAP_FORMAT_R8, &view),
                   SVBRDF_INVALID_ARGUMENT);
        }
        EXPECT(svbrdf_maps_deviations(maps, SVBRDF_MAP_COAT, &view), SVBRDF_INVALID_ARGUMENT);
        EXPECT(svbrdf_maps_deviations(maps, SVBRDF_MAP_SHEEN, &view), SVBRDF_INVALID_ARGUMENT);
        OK(svbrdf_maps_reduced(maps, 1, &half));
        OK(svbrdf_maps_lobes(half, &found));
        CHECK(found == lobes);
        OK(svbrdf_maps_destroy(half));
        OK(svbrdf_maps_destroy(maps));
    }
    /* Lobes that are given but nowhere there are not shown. */
    memset(m.coat, 0, sizeof m.coat);
    input_of(&input, &m, SVBRDF_LOBE_COAT);
    OK(svbrdf_maps_from_memory(&input, &maps));
    OK(svbrdf_maps_lobes(maps, &found));
    CHECK(found == 0);
    EXPECT(svbrdf_maps_view(maps, SVBRDF_MAP_COAT, SVBRDF_MAP_FORMAT_F32, &view), SVBRDF_NO_LOBE);
    CHECK(strstr(svbrdf_last_error_message(), "coat") != NULL);
    EXPECT(svbrdf_maps_lobes(maps, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_maps_destroy(maps));
    EXPECT(svbrdf_maps_lobes(maps, &found), SVBRDF_INVALID_HANDLE);
}

/* Radiance of the middle of a flat mirror-coloured texel below a camera: glTF's formulas, with the
 * library's Fresnel and masking terms. */
static double expected(double across, double along, double turn, double weight, double coat,
                       const float light_mm[3])
{
    const double pi = acos(-1.0), length = sqrt(light_mm[0] * light_mm[0] +
                                                light_mm[1] * light_mm[1] + light_mm[2] * light_mm[2]);
    const double l[3] = {light_mm[0] / length, light_mm[1] / length, light_mm[2] / length};
    const double norm = sqrt(l[0] * l[0] + l[1] * l[1] + (l[2] + 1) * (l[2] + 1));
    const double x = l[0] / norm, y = l[1] / norm, nh = (l[2] + 1) / norm;
    const double t = x * cos(turn) + y * sin(turn), b = y * cos(turn) - x * sin(turn);
    const double fresnel = pow(2.0, (-5.55473 * nh - 6.98316) * nh);
    const double over = weight * (0.04 + 0.96 * fresnel);
    double alpha[2][2], value[2];
    int i;
    alpha[0][0] = along, alpha[0][1] = across, alpha[1][0] = alpha[1][1] = coat * coat;
    for (i = 0; i < 2; i++) {
        const double ax = alpha[i][0], ay = alpha[i][1], k = sqrt(ax * ay) / 2;
        const double d = t * t / (ax * ax) + b * b / (ay * ay) + nh * nh;
        value[i] = 1 / (pi * ax * ay * d * d) / (4 * (l[2] * (1 - k) + k));
    }
    /* A light of power pi. */
    return pi * l[2] * ((1 - over) * value[0] + over * value[1]);
}

static void check_rendering(void)
{
    static const float normal[3] = {0, 0, 1}, diffuse[3] = {0, 0, 0}, specular[3] = {1, 1, 1};
    const float roughness = 0.3f, turn = 0.6f, strength = 0.5f;
    const float anisotropy[3] = {cosf(turn), sinf(turn), strength}, coat[3] = {0.7f, 0.2f, 0};
    svbrdf_maps_input input;
    svbrdf_render_options options;
    svbrdf_maps *maps = NULL;
    int i, coated;
    for (coated = 0; coated < 2; coated++) {
        OK(svbrdf_maps_input_init(&input, sizeof input));
        input.width = input.height = 1;
        input.normal = normal;
        input.diffuse = diffuse;
        input.specular = specular;
        input.roughness = &roughness;
        input.anisotropy = anisotropy;
        input.coat = coated ? coat : NULL;
        OK(svbrdf_maps_from_memory(&input, &maps));
        OK(svbrdf_render_options_init(&options, sizeof options));
        for (i = 0; i < 8; i++) {
            const double across = roughness * roughness;
            const double along = across + (1 - across) * strength * strength;
            float rgb[3];
            double wanted;
            options.light_mm[0] = 150.0f * cosf(0.4f * (float)i);
            options.light_mm[1] = 150.0f * sinf(0.4f * (float)i);
            OK(svbrdf_maps_render(maps, &options, SVBRDF_MAP_FORMAT_F32, rgb, sizeof rgb, 0));
            wanted = expected(across, along, turn, coated ? 0.7 : 0.0, 0.2, options.light_mm);
            /* Single precision. */
            CHECK(fabs(rgb[0] / wanted - 1) < 1e-3 && rgb[0] == rgb[2]);
        }
        OK(svbrdf_maps_destroy(maps));
    }
}

/* Counts the remarks on formats. */
static void on_remark(void *user, svbrdf_log_level level, const char *message)
{
    CHECK(level == SVBRDF_LOG_WARNING && strstr(message, " has no ") != NULL);
    ++*(int *)user;
}

static void check_faults(const char *folder)
{
    svbrdf_maps_input input;
    svbrdf_export_options options;
    svbrdf_maps *maps = NULL;
    char path[4096];
    material m;
    float crooked[3 * TEXELS + 1];
    int remarks = 0;
    fill(&m);
    input_of(&input, &m, 7);
    EXPECT(svbrdf_maps_from_memory(NULL, &maps), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_from_memory(&input, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_input_init(&input, sizeof input - 8), SVBRDF_INVALID_ARGUMENT);
#define REFUSED(what, change)                                                                    \
    do {                                                                                         \
        fill(&m);                                                                                \
        input_of(&input, &m, 7);                                                                 \
        change;                                                                                  \
        EXPECT(svbrdf_maps_from_memory(&input, &maps), SVBRDF_INVALID_ARGUMENT);                 \
        CHECK(strstr(svbrdf_last_error_message(), "svbrdf_maps_input." what) != NULL);           \
    } while (0)
    REFUSED("width", input.width = 0);
    REFUSED("height", input.height = 4097);
    REFUSED("sample_mm", input.sample_mm[0] = 0.0f);
    REFUSED("normal", input.normal = NULL);
    REFUSED("normal", m.normal[5] = -0.1f);
    REFUSED("diffuse", m.diffuse[7] = 1.1f);
    REFUSED("specular", m.specular[0] = nanf(""));
    REFUSED("roughness", m.roughness[TEXELS - 1] = -0.1f);
    REFUSED("anisotropy", m.anisotropy[2] = -0.1f);
    REFUSED("anisotropy", m.anisotropy[0] = 2.0f);
    REFUSED("coat", m.coat[1] = 1.5f);
    REFUSED("sheen", m.sheen[4] = -0.5f);
    REFUSED("sheen_roughness", m.sheen_roughness[0] = 2.0f);
    REFUSED("sheen_roughness", input.sheen_roughness = NULL);
    REFUSED("sheen", input.sheen = NULL);
    CHECK(maps == NULL);
    /* Any alignment; files are written of maps with lobes too. */
    fill(&m);
    input_of(&input, &m, 7);
    memcpy((char *)crooked + 1, m.coat, sizeof m.coat);
    input.coat = (const float *)(const void *)((char *)crooked + 1);
    OK(svbrdf_maps_from_memory(&input, &maps));
    same(maps, SVBRDF_MAP_COAT, m.coat, 3);
    CHECK(snprintf(path, sizeof path, "%s/lobes", folder) < (int)sizeof path);
    OK(svbrdf_maps_export(maps, NULL, path));
    OK(svbrdf_export_options_init(&options, sizeof options));
    OK(svbrdf_maps_export(maps, &options, path));
    /* Lobes that a format does not have are reported. */
    options.formats = "usdz,unity-hdrp,unity-urp";
    OK(svbrdf_set_log_callback(on_remark, &remarks));
    OK(svbrdf_maps_export(maps, &options, path));
    OK(svbrdf_set_log_callback(NULL, NULL));
    CHECK(remarks == 3);
    OK(svbrdf_maps_destroy(maps));
}

void test_lobes(const char *folder)
{
    check_kinds();
    check_rendering();
    check_faults(folder);
}

/* A C99 client that does everything the header offers: client TEST FOLDER. */
#include "check.h"

int quick(void)
{
    return getenv("SVBRDF_TEST_QUICK") != NULL;
}

void gray_image(svbrdf_image *image, unsigned char *rgb, int level)
{
    memset(rgb, level, 3 * SIDE * SIDE);
    OK(svbrdf_image_init(image, sizeof *image));
    image->format = SVBRDF_PIXEL_RGB8;
    image->width = SIDE;
    image->height = SIDE;
    image->planes[0].data = rgb;
    image->planes[0].bytes = 3 * SIDE * SIDE;
    image->planes[0].row_stride = 3 * SIDE;
}

void rectified_options(svbrdf_session_options *options)
{
    OK(svbrdf_session_options_init(options, sizeof *options));
    options->scene = SVBRDF_SCENE_RECTIFIED;
    options->threads = 1;
}

svbrdf_status push_gray(svbrdf_session *session, int level)
{
    static const float above[3] = {0.0f, 10.0f, 150.0f};
    svbrdf_image image;
    svbrdf_status status;
    unsigned char *rgb = malloc(3 * SIDE * SIDE);
    CHECK(rgb != NULL);
    gray_image(&image, rgb, level);
    status = svbrdf_session_add_rectified_photo(session, &image, NULL, above, above, NULL);
    free(rgb);
    return status;
}

void export_maps(const svbrdf_session *session, const char *path, svbrdf_status expected)
{
    svbrdf_maps *maps = NULL;
    OK(svbrdf_session_snapshot_maps(session, &maps));
    EXPECT(svbrdf_maps_export(maps, NULL, path), expected);
    OK(svbrdf_maps_destroy(maps));
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name;
        void (*run)(const char *folder);
    } tests[] = {
        {"board", test_board},         {"layouts", test_layouts},
        {"maps", test_maps},           {"bad-arguments", test_bad_arguments},
        {"lifecycle", test_lifecycle}, {"threads", test_threads},
        {"state", test_state},         {"capture", test_capture},
        {"faults", test_faults},       {"feedback", test_feedback},
        {"races", test_races},         {"looked-at", test_looked_at},
        {"outputs", test_outputs},     {"flow", test_flow},
        {"inputs", test_inputs},       {"progress", test_progress},
        {"lobes", test_lobes},
    };
    size_t i;
    CHECK(argc == 3);
    CHECK(svbrdf_version_number() >> 16 == SVBRDF_VERSION_MAJOR);
    CHECK(strlen(svbrdf_version()) >= 5);
    CHECK(svbrdf_features() & SVBRDF_FEATURE_YUV);
    CHECK(svbrdf_features() & SVBRDF_FEATURE_RAW);
    CHECK(svbrdf_features() & SVBRDF_FEATURE_EMBEDDED_MODELS);
    for (i = 0; i < sizeof tests / sizeof tests[0]; i++) {
        if (strcmp(argv[1], tests[i].name) == 0) {
            tests[i].run(argv[2]);
            printf("%s: done\n", argv[1]);
            return 0;
        }
    }
    fprintf(stderr, "no test %s\n", argv[1]);
    return 1;
}

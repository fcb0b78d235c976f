/* Maps in every format, in the library's memory and in the client's. */
#include "check.h"

#include <math.h>

static void read_model(const char *folder, const char *name, void **data, size_t *bytes)
{
    char path[4096];
    FILE *file;
    long end;
    CHECK(snprintf(path, sizeof path, "%s/models/%s", folder, name) < (int)sizeof path);
    file = fopen(path, "rb");
    CHECK(file != NULL && fseek(file, 0, SEEK_END) == 0);
    end = ftell(file);
    CHECK(end > 0 && fseek(file, 0, SEEK_SET) == 0);
    *bytes = (size_t)end;
    *data = malloc(*bytes);
    CHECK(*data != NULL && fread(*data, 1, *bytes, file) == *bytes);
    fclose(file);
}

static svbrdf_models *load_models(const char *folder)
{
    void *data[4];
    size_t bytes[4];
    svbrdf_models *models = NULL;
    char path[4096];
    int i;
    read_model(folder, "decoder.bin", &data[0], &bytes[0]);
    read_model(folder, "encoder.onnx", &data[1], &bytes[1]);
    read_model(folder, "photo.onnx", &data[2], &bytes[2]);
    read_model(folder, "completion.onnx", &data[3], &bytes[3]);
    /* Cut short. */
    EXPECT(svbrdf_models_from_memory(data[0], bytes[0] / 2, data[1], bytes[1], data[2], bytes[2],
                                     data[3], bytes[3], &models),
           SVBRDF_BAD_MODEL);
    EXPECT(svbrdf_models_from_memory(data[0], bytes[0], data[1], bytes[1] / 2, data[2], bytes[2],
                                     data[3], bytes[3], &models),
           SVBRDF_BAD_MODEL);
    EXPECT(svbrdf_models_from_memory(data[0], bytes[0], data[1], bytes[1], data[2], bytes[2],
                                     data[3], bytes[3] / 2, &models),
           SVBRDF_BAD_MODEL);
    EXPECT(svbrdf_models_from_memory(data[0], bytes[0], NULL, 1, data[2], bytes[2], data[3],
                                     bytes[3], &models),
           SVBRDF_INVALID_ARGUMENT);
    CHECK(models == NULL);
    OK(svbrdf_models_from_memory(data[0], bytes[0], data[1], bytes[1], data[2], bytes[2],
                                 data[3], bytes[3], &models));
    for (i = 0; i < 4; i++) {
        free(data[i]);
    }
    OK(svbrdf_models_destroy(models));
    EXPECT(svbrdf_models_from_folder("/nowhere", &models), SVBRDF_IO);
    CHECK(snprintf(path, sizeof path, "%s/models", folder) < (int)sizeof path);
    OK(svbrdf_models_from_folder(path, &models));
    return models;
}

/* Files for other programs, in memory and on disk. */
static void check_packages(const svbrdf_maps *maps, const char *folder)
{
    svbrdf_export_options options;
    svbrdf_package *package = NULL;
    const char *name = NULL;
    const void *data = NULL;
    char path[4096];
    size_t bytes = 0;
    uint32_t count = 0, i, found = 0;
    OK(svbrdf_export_options_init(&options, sizeof options));
    options.formats = "glb, usdz,unity-hdrp";
    options.texture = SVBRDF_TEXTURE_JPEG;
    options.max_size = 16;
    options.photos = 3;
    OK(svbrdf_maps_export_package(maps, &options, &package));
    OK(svbrdf_package_count(package, &count));
    CHECK(count > 6);
    for (i = 0; i < count; i++) {
        OK(svbrdf_package_file(package, i, &name, &data, &bytes));
        CHECK(bytes > 0);
        if (strcmp(name, "material.glb") == 0) {
            CHECK(memcmp(data, "glTF\2\0\0\0", 8) == 0);
            found++;
        } else if (strcmp(name, "material.usdz") == 0) {
            CHECK(memcmp(data, "PK\3\4", 4) == 0);
            found++;
        } else if (strcmp(name, "unity-hdrp/mask_map.png") == 0) {
            CHECK(memcmp(data, "\x89PNG", 4) == 0);
            found++;
        }
    }
    CHECK(found == 3);
    EXPECT(svbrdf_package_file(package, count, &name, &data, &bytes), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_package_file(package, 0, NULL, NULL, NULL));
    EXPECT(svbrdf_package_count(package, NULL), SVBRDF_INVALID_ARGUMENT);
    OK(svbrdf_package_destroy(package));
    EXPECT(svbrdf_package_destroy(package), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_package_count(package, &count), SVBRDF_INVALID_HANDLE);
    OK(svbrdf_package_destroy(NULL));

    CHECK(snprintf(path, sizeof path, "%s/packages", folder) < (int)sizeof path);
    OK(svbrdf_maps_export(maps, &options, path));
    EXPECT(svbrdf_maps_export(maps, &options, "/proc/nowhere"), SVBRDF_IO);
    EXPECT(svbrdf_maps_export(maps, &options, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_export(NULL, &options, path), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_maps_export_package(maps, &options, NULL), SVBRDF_INVALID_ARGUMENT);
    options.formats = "glb,obj";
    EXPECT(svbrdf_maps_export_package(maps, &options, &package), SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "obj") != NULL);
    options.formats = NULL;
    options.tile = 2;
    EXPECT(svbrdf_maps_export_package(maps, &options, &package), SVBRDF_INVALID_ARGUMENT);
    CHECK(strstr(svbrdf_last_error_message(), "tile") != NULL);
    options.tile = 0;
    options.texture = 9;
    EXPECT(svbrdf_maps_export_package(maps, &options, &package), SVBRDF_INVALID_ARGUMENT);
    options.texture = SVBRDF_TEXTURE_PNG8;
    options.max_size = 1;
    EXPECT(svbrdf_maps_export_package(maps, &options, &package), SVBRDF_INVALID_ARGUMENT);
}

void test_maps(const char *folder)
{
    static const unsigned formats[] = {SVBRDF_MAP_FORMAT_F32, SVBRDF_MAP_FORMAT_RGB8,
                                       SVBRDF_MAP_FORMAT_RGBA8, SVBRDF_MAP_FORMAT_RGBA16F,
                                       SVBRDF_MAP_FORMAT_RGBA32F, SVBRDF_MAP_FORMAT_R8};
    static const unsigned sample_bytes[] = {4, 1, 1, 2, 4, 1};
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_maps *maps = NULL;
    svbrdf_map_view view;
    svbrdf_models *models = load_models(folder);
    unsigned width = 0, height = 0, map;
    float sample_mm[2];
    char path[4096];
    size_t f, y, i;

    rectified_options(&options);
    options.models = models;
    options.sample_mm[0] = 50.0f;
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_models_destroy(models)); /* The session keeps its share. */
    OK(svbrdf_session_pause(session));
    OK(push_gray(session, 120));
    OK(svbrdf_session_snapshot_maps(session, &maps));
    OK(svbrdf_session_destroy(session));

    OK(svbrdf_maps_size(maps, &width, &height, sample_mm));
    CHECK(width == SIDE && height == SIDE && sample_mm[0] == 50.0f && sample_mm[1] == 100.0f);
    OK(svbrdf_maps_size(maps, NULL, NULL, NULL));
    OK(svbrdf_map_view_init(&view, sizeof view));
    for (map = SVBRDF_MAP_NORMAL; map <= SVBRDF_MAP_NORMAL_DIRECTX; map++) {
        for (f = 0; f < sizeof formats / sizeof formats[0]; f++) {
            size_t row, stride, bytes;
            unsigned char *copy;
            const void *again;
            if (formats[f] == SVBRDF_MAP_FORMAT_R8 && map != SVBRDF_MAP_ROUGHNESS) {
                continue;
            }
            OK(svbrdf_maps_view(maps, map, formats[f], &view));
            CHECK(view.width == SIDE && view.height == SIDE);
            row = (size_t)SIDE * view.channels * sample_bytes[f];
            CHECK(view.row_stride == row && view.bytes == row * SIDE);
            again = view.data;
            OK(svbrdf_maps_view(maps, map, formats[f], &view));
            CHECK(again == view.data);
            /* Into memory with gaps that stay untouched, of exactly the size needed. */
            stride = row + 7;
            bytes = stride * (SIDE - 1) + row;
            copy = malloc(bytes);
            CHECK(copy != NULL);
            memset(copy, 0x5A, bytes);
            OK(svbrdf_maps_copy(maps, map, formats[f], copy, bytes, stride));
            for (y = 0; y < SIDE; y++) {
                CHECK(memcmp(copy + y * stride, (const char *)view.data + y * row, row) == 0);
                CHECK(y == SIDE - 1 || copy[y * stride + row] == 0x5A);
            }
            EXPECT(svbrdf_maps_copy(maps, map, formats[f], copy, bytes - 1, stride),
                   SVBRDF_INVALID_ARGUMENT);
            EXPECT(svbrdf_maps_copy(maps, map, formats[f], copy, bytes, row - 1),
                   SVBRDF_INVALID_ARGUMENT);
            EXPECT(svbrdf_maps_copy(maps, map, formats[f], copy, bytes, (size_t)-1),
                   SVBRDF_INVALID_ARGUMENT);
            EXPECT(svbrdf_maps_copy(maps, map, formats[f], NULL, bytes, stride),
                   SVBRDF_INVALID_ARGUMENT);
            free(copy);
        }
    }
    /* Floats against bytes: the encodings are those that the header names. */
    {
        svbrdf_map_view normal = view, packed = view, roughness = view, orm = view;
        const float *n;
        const unsigned char *b;
        OK(svbrdf_maps_view(maps, SVBRDF_MAP_NORMAL, SVBRDF_MAP_FORMAT_F32, &normal));
        OK(svbrdf_maps_view(maps, SVBRDF_MAP_NORMAL, SVBRDF_MAP_FORMAT_RGBA8, &packed));
        OK(svbrdf_maps_view(maps, SVBRDF_MAP_ROUGHNESS, SVBRDF_MAP_FORMAT_F32, &roughness));
        OK(svbrdf_maps_view(maps, SVBRDF_MAP_ROUGHNESS, SVBRDF_MAP_FORMAT_RGBA8, &orm));
        CHECK(roughness.channels == 1 && normal.channels == 3 && packed.channels == 4);
        for (i = 0; i < SIDE * SIDE; i++) {
            n = (const float *)normal.data + 3 * i;
            b = (const unsigned char *)packed.data + 4 * i;
            CHECK(fabsf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - 1.0f) < 1e-5f && n[2] > 0.0f);
            CHECK(fabsf(n[1] * 127.5f + 127.5f - (float)b[1]) <= 0.501f && b[3] == 255);
            b = (const unsigned char *)orm.data + 4 * i;
            CHECK(b[0] == 255 && b[2] == 0 && b[3] == 255);
            CHECK(fabsf(((const float *)roughness.data)[i] * 255.0f - (float)b[1]) <= 0.501f);
        }
    }
    EXPECT(svbrdf_maps_view(maps, 0, SVBRDF_MAP_FORMAT_F32, &view), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_view(maps, 10, SVBRDF_MAP_FORMAT_F32, &view), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_view(maps, 1, 0, &view), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_view(maps, 1, 4, &view), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_view(maps, 1, 1, NULL), SVBRDF_INVALID_ARGUMENT);
    CHECK(snprintf(path, sizeof path, "%s/snapshot", folder) < (int)sizeof path);
    OK(svbrdf_maps_export(maps, NULL, path));
    EXPECT(svbrdf_maps_export(maps, NULL, NULL), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_export(maps, NULL, ""), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_export(maps, NULL, "\xff\xfe"), SVBRDF_INVALID_ARGUMENT);
    EXPECT(svbrdf_maps_export(maps, NULL, "/proc/nowhere"), SVBRDF_IO);
    check_packages(maps, folder);
    OK(svbrdf_maps_destroy(maps));
    EXPECT(svbrdf_maps_destroy(maps), SVBRDF_INVALID_HANDLE);
    EXPECT(svbrdf_maps_size(maps, &width, &height, NULL), SVBRDF_INVALID_HANDLE);
    OK(svbrdf_maps_destroy(NULL));
    OK(svbrdf_models_destroy(NULL));
    EXPECT(svbrdf_models_destroy(models), SVBRDF_INVALID_HANDLE);
}

/* Turns maps in memory into files of other programs, in memory.
 *
 *   export_in_memory */
#include <stdio.h>

#include "svbrdf.h"

enum { SIDE = 64, TEXELS = SIDE * SIDE };

static int failed(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, svbrdf_last_error_message());
    return 1;
}

int main(void)
{
    static float normal[3 * TEXELS], diffuse[3 * TEXELS], specular[3 * TEXELS], roughness[TEXELS];
    svbrdf_maps_input input;
    svbrdf_export_options options;
    svbrdf_maps *maps = NULL;
    svbrdf_package *package = NULL;
    uint32_t count = 0, i;
    for (i = 0; i < TEXELS; i++) {
        normal[3 * i + 2] = 1.0f;
        diffuse[3 * i] = 0.4f;
        specular[3 * i] = specular[3 * i + 1] = specular[3 * i + 2] = 0.04f;
        roughness[i] = (float)(i % SIDE) / SIDE;
    }
    svbrdf_maps_input_init(&input, sizeof input);
    input.width = input.height = SIDE;
    input.normal = normal;
    input.diffuse = diffuse;
    input.specular = specular;
    input.roughness = roughness;
    svbrdf_export_options_init(&options, sizeof options);
    options.formats = "glb,unreal";
    if (svbrdf_maps_from_memory(&input, &maps) != SVBRDF_OK ||
        svbrdf_maps_export_package(maps, &options, &package) != SVBRDF_OK ||
        svbrdf_package_count(package, &count) != SVBRDF_OK) {
        return failed("export");
    }
    for (i = 0; i < count; i++) {
        const char *name = NULL;
        const void *data = NULL; /* valid until svbrdf_package_destroy() */
        size_t bytes = 0;
        if (svbrdf_package_file(package, i, &name, &data, &bytes) != SVBRDF_OK) {
            return failed("file");
        }
        printf("%s: %lu bytes\n", name, (unsigned long)bytes);
    }
    svbrdf_package_destroy(package);
    svbrdf_maps_destroy(maps);
    return 0;
}

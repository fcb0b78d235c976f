/* Maps from photos in memory that are rectified already, each with the positions of camera and light.
 *
 *   rectified
 *
 * The photos are rendered from known maps, with which the result is compared. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "svbrdf.h"

enum { SIDE = 256, TEXELS = SIDE * SIDE };

static int failed(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, svbrdf_last_error_message());
    return 1;
}

/* Stripes of a matte material. */
static svbrdf_status known_maps(svbrdf_maps **out)
{
    static float normal[3 * TEXELS], diffuse[3 * TEXELS], specular[3 * TEXELS], roughness[TEXELS];
    svbrdf_maps_input input;
    int i, c;
    for (i = 0; i < TEXELS; i++) {
        normal[3 * i + 2] = 1.0f;
        roughness[i] = 0.6f;
        for (c = 0; c < 3; c++) {
            diffuse[3 * i + c] = (i % SIDE / 32 + c) % 2 == 0 ? 0.4f : 0.15f;
            specular[3 * i + c] = 0.04f;
        }
    }
    svbrdf_maps_input_init(&input, sizeof input);
    input.width = input.height = SIDE;
    input.normal = normal;
    input.diffuse = diffuse;
    input.specular = specular;
    input.roughness = roughness;
    return svbrdf_maps_from_memory(&input, out);
}

/* Adds a photo by a camera and a flash at `mm` above the sample. */
static svbrdf_status add(svbrdf_session *session, const svbrdf_maps *truth, const float mm[3])
{
    static float pixels[4 * TEXELS];
    svbrdf_render_options render;
    svbrdf_image image;
    svbrdf_status status;
    int i;
    svbrdf_render_options_init(&render, sizeof render);
    for (i = 0; i < 3; i++) {
        render.camera_mm[i] = render.light_mm[i] = mm[i];
    }
    status = svbrdf_maps_render(truth, &render, SVBRDF_MAP_FORMAT_RGBA32F, pixels, sizeof pixels, 0);
    if (status != SVBRDF_OK) {
        return status;
    }
    svbrdf_image_init(&image, sizeof image);
    image.format = SVBRDF_PIXEL_RGBA_F32;
    image.transfer = SVBRDF_TRANSFER_LINEAR;
    image.width = image.height = SIDE;
    image.planes[0].data = pixels;
    image.planes[0].row_stride = 16 * SIDE;
    image.planes[0].bytes = sizeof pixels;
    return svbrdf_session_add_rectified_photo(session, &image, NULL, mm, mm, NULL);
}

int main(void)
{
    static const float places[3][3] = {
        {0.0f, 0.0f, 150.0f}, {60.0f, 0.0f, 140.0f}, {-50.0f, 50.0f, 140.0f}};
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_maps *truth = NULL, *maps = NULL;
    svbrdf_map_view found, known;
    double sum = 0.0;
    int i;
    svbrdf_session_options_init(&options, sizeof options);
    options.scene = SVBRDF_SCENE_RECTIFIED;
    if (known_maps(&truth) != SVBRDF_OK || svbrdf_session_create(&options, &session) != SVBRDF_OK) {
        return failed("session");
    }
    for (i = 0; i < 3; i++) {
        if (add(session, truth, places[i]) != SVBRDF_OK) {
            return failed("photo");
        }
    }
    svbrdf_map_view_init(&found, sizeof found);
    svbrdf_map_view_init(&known, sizeof known);
    if (svbrdf_session_wait(session, -1) != SVBRDF_OK ||
        svbrdf_session_snapshot_maps(session, &maps) != SVBRDF_OK ||
        svbrdf_maps_view(maps, SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_FORMAT_F32, &found) != SVBRDF_OK ||
        svbrdf_maps_view(truth, SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_FORMAT_F32, &known) != SVBRDF_OK) {
        return failed("maps");
    }
    for (i = 0; i < 3 * TEXELS; i++) {
        double off = (double)((const float *)found.data)[i] - (double)((const float *)known.data)[i];
        sum += off * off;
    }
    printf("diffuse albedo off by %.4f\n", sqrt(sum / (3 * TEXELS)));
    svbrdf_maps_destroy(maps);
    svbrdf_maps_destroy(truth);
    svbrdf_session_destroy(session);
    return 0;
}

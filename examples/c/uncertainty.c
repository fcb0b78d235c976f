/* Adds photos until the roughness is known well enough.
 *
 *   uncertainty CAPTURE DEVIATION [PHOTOS] */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "svbrdf.h"

static int failed(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, svbrdf_last_error_message());
    return 1;
}

/* The standard deviation of the roughness as a whole; negative on a fault. */
static float deviation(const svbrdf_session *session, float enough)
{
    svbrdf_maps *maps = NULL;
    svbrdf_uncertainty known;
    svbrdf_map_view texels;
    size_t i, n, unknown = 0;
    svbrdf_uncertainty_init(&known, sizeof known);
    svbrdf_map_view_init(&texels, sizeof texels);
    if (svbrdf_session_snapshot_with_uncertainty(session, &maps) != SVBRDF_OK ||
        svbrdf_maps_uncertainty(maps, &known) != SVBRDF_OK ||
        svbrdf_maps_deviations(maps, SVBRDF_MAP_ROUGHNESS, &texels) != SVBRDF_OK) {
        svbrdf_maps_destroy(maps);
        return -1.0f;
    }
    n = (size_t)texels.width * texels.height;
    for (i = 0; i < n; i++) {
        unknown += ((const float *)texels.data)[i] > enough;
    }
    printf("roughness within %.3f, %.0f %% of the texels not within %.3f; normals within %.3f\n",
           (double)known.roughness, 100.0 * (double)unknown / (double)n, (double)enough,
           (double)known.normal);
    svbrdf_maps_destroy(maps);
    return known.roughness;
}

int main(int argc, char **argv)
{
    svbrdf_session_options options;
    svbrdf_capture *capture = NULL;
    svbrdf_session *session = NULL;
    uint32_t photos = 0, i;
    float enough, known = HUGE_VALF;
    if (argc < 3) {
        fprintf(stderr, "usage: uncertainty CAPTURE DEVIATION [PHOTOS]\n");
        return 2;
    }
    enough = (float)atof(argv[2]);
    if (svbrdf_capture_open(argv[1], &capture) != SVBRDF_OK ||
        svbrdf_capture_photos(capture, &photos) != SVBRDF_OK) {
        return failed(argv[1]);
    }
    if (argc > 3 && (uint32_t)atoi(argv[3]) < photos) {
        photos = (uint32_t)atoi(argv[3]);
    }
    svbrdf_session_options_init(&options, sizeof options);
    options.capture = capture;
    if (svbrdf_session_create(&options, &session) != SVBRDF_OK) {
        return failed("session");
    }
    for (i = 0; i < photos && known > enough; i++) {
        svbrdf_status status = svbrdf_session_add_capture_photo(session, capture, i, NULL);
        if (status == SVBRDF_REJECTED) {
            continue;
        }
        /* Deviations are meaningful once the fit has settled. */
        if (status != SVBRDF_OK || svbrdf_session_wait(session, -1) != SVBRDF_OK) {
            return failed("photo");
        }
        known = deviation(session, enough);
        if (known < 0.0f) {
            return failed("maps");
        }
    }
    printf("%u photos, roughness within %.3f\n", i, (double)known);
    svbrdf_session_destroy(session);
    svbrdf_capture_destroy(capture);
    return 0;
}

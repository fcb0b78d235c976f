/* The loop of a camera app: add a photo, show the maps and the next view.
 *
 *   live_loop CAPTURE [PHOTOS]
 *
 * The photos of a folder with capture.json stand for the camera. Only the end waits for the fit.
 * docs/live-loop.md has the same with a preview. */
#include <stdio.h>
#include <stdlib.h>

#include "svbrdf.h"

static int failed(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, svbrdf_last_error_message());
    return 1;
}

static int live(svbrdf_session *session, const svbrdf_capture *capture, uint32_t photos)
{
    svbrdf_photo_report report;
    svbrdf_next_view next;
    svbrdf_maps *maps = NULL;
    uint32_t i, used = 0;
    svbrdf_photo_report_init(&report, sizeof report);
    svbrdf_next_view_init(&next, sizeof next);
    for (i = 0; i < photos; i++) {
        svbrdf_status status = svbrdf_session_add_capture_photo(session, capture, i, &report);
        if (status == SVBRDF_REJECTED) {
            printf("try again: %s\n", report.advice);
            continue;
        }
        if (status != SVBRDF_OK) {
            return failed("photo");
        }
        used++;
        printf("photo %u is in the maps. %s\n", i + 1, report.advice);
        /* The fit continues; its maps are there at any time. */
        if (svbrdf_session_snapshot_maps(session, &maps) != SVBRDF_OK) {
            return failed("maps");
        }
        svbrdf_maps_destroy(maps);
        if (svbrdf_session_next_view(session, &next) == SVBRDF_OK && next.known) {
            printf("  next: %.0f degrees off the vertical, towards %.0f degrees\n",
                   (double)next.tilt_deg, (double)next.azimuth_deg);
        }
    }
    if (svbrdf_session_wait(session, -1) != SVBRDF_OK) {
        return failed("fit");
    }
    printf("%u photos used\n", used);
    return 0;
}

int main(int argc, char **argv)
{
    svbrdf_session_options options;
    svbrdf_capture *capture = NULL;
    svbrdf_session *session = NULL;
    uint32_t photos = 0;
    int status;
    if (argc < 2) {
        fprintf(stderr, "usage: live_loop CAPTURE [PHOTOS]\n");
        return 2;
    }
    if (svbrdf_capture_open(argv[1], &capture) != SVBRDF_OK ||
        svbrdf_capture_photos(capture, &photos) != SVBRDF_OK) {
        return failed(argv[1]);
    }
    if (argc > 2 && (uint32_t)atoi(argv[2]) < photos) {
        photos = (uint32_t)atoi(argv[2]);
    }
    svbrdf_session_options_init(&options, sizeof options);
    options.capture = capture;
    if (svbrdf_session_create(&options, &session) != SVBRDF_OK) {
        return failed("session");
    }
    svbrdf_session_announce(session, photos);
    status = live(session, capture, photos);
    svbrdf_session_destroy(session);
    svbrdf_capture_destroy(capture);
    return status;
}

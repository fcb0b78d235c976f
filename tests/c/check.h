/* Helpers of the C client. */
#ifndef SVBRDF_TEST_CHECK_H
#define SVBRDF_TEST_CHECK_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "svbrdf.h"

#define CHECK(condition)                                                                         \
    do {                                                                                         \
        if (!(condition)) {                                                                      \
            fprintf(stderr, "%s:%d: %s does not hold\n", __FILE__, __LINE__, #condition);        \
            exit(1);                                                                             \
        }                                                                                        \
    } while (0)

#define EXPECT(call, expected)                                                                   \
    do {                                                                                         \
        svbrdf_status status_ = (call);                                                          \
        if (status_ != (expected)) {                                                             \
            fprintf(stderr, "%s:%d: %s: %s (%s)\n", __FILE__, __LINE__, #call,                   \
                    svbrdf_status_name(status_), svbrdf_last_error_message());                   \
            exit(1);                                                                             \
        }                                                                                        \
        CHECK((status_ == SVBRDF_OK) == (svbrdf_last_error_message()[0] == '\0'));               \
    } while (0)

/* Waits for another thread, at most ten minutes. */
#define EVENTUALLY(condition)                                                                    \
    do {                                                                                         \
        int left_ = 600000;                                                                      \
        while (!(condition) && left_-- > 0) {                                                    \
            usleep(1000);                                                                        \
        }                                                                                        \
        CHECK(left_ > 0);                                                                        \
    } while (0)

#define OK(call) EXPECT(call, SVBRDF_OK)

enum { SIDE = 256 };

/* Whether to skip work with the networks, which takes minutes under valgrind. */
int quick(void);
/* A plain picture, SIDE x SIDE, 8 bits. */
void gray_image(svbrdf_image *image, unsigned char *rgb, int level);
/* Options of a session of rectified photos with one thread. */
void rectified_options(svbrdf_session_options *options);
/* Pushes a gray rectified photo. */
svbrdf_status push_gray(svbrdf_session *session, int level);
/* Writes the current maps into a folder, with the expected status. */
void export_maps(const svbrdf_session *session, const char *path, svbrdf_status expected);

typedef struct {
    unsigned char *rgb;
    unsigned width, height;
} picture;

/* A photo of the bundled capture, to be freed. */
picture read_ppm(const char *folder, const char *name);
/* It as 8-bit sRGB. */
void rgb8(svbrdf_image *image, const picture *p);
/* Options with board, camera and flash of the bundled capture. */
void board_options(svbrdf_session_options *options, svbrdf_board *board, svbrdf_camera *camera);

void test_board(const char *folder);
void test_layouts(const char *folder);
void test_maps(const char *folder);
void test_lobes(const char *folder);
void test_bad_arguments(const char *folder);
void test_lifecycle(const char *folder);
void test_threads(const char *folder);
void test_state(const char *folder);
void test_capture(const char *folder);
void test_faults(const char *folder);
void test_feedback(const char *folder);
void test_races(const char *folder);
void test_looked_at(const char *folder);
void test_progress(const char *folder);
void test_inputs(const char *folder);
void test_outputs(const char *folder);
void test_flow(const char *folder);

#endif

/* Methods of Native.kt about a session. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "boundary.h"

/* Lengths of the arrays that Native.kt hands over. */
enum { OPTION_INTS = 6, OPTION_FLOATS = 5, BOARD = 13, CAMERA = 11, SIGMA = 9 };
enum { VIEW = 6, PAPER = 9, POSE = 13 };

/* An Int that came as a number; negative ones become too large for the library. */
static uint32_t whole(jdouble value)
{
    return (uint32_t)(int64_t)value;
}

int read_board(JNIEnv *env, jdoubleArray array, jbyteArray dictionary, jbyte **held,
               svbrdf_board *board)
{
    jdouble v[BOARD];
    *held = NULL;
    if (read_doubles(env, array, BOARD, v)) {
        return 1;
    }
    svbrdf_board_init(board, sizeof *board);
    board->kind = whole(v[0]);
    board->rows = whole(v[1]);
    board->cols = whole(v[2]);
    board->hole_row_start = whole(v[3]);
    board->hole_col_start = whole(v[4]);
    board->hole_row_end = whole(v[5]);
    board->hole_col_end = whole(v[6]);
    board->top_left_white = whole(v[7]);
    board->square_mm = v[8];
    board->white_albedo = v[9];
    board->black_albedo = v[10];
    board->marker_mm = v[11];
    board->patches = whole(v[12]);
    if (dictionary != NULL) {
        board->dictionary = read_text(env, dictionary, held);
        return board->dictionary == NULL;
    }
    return 0;
}

static int read_camera(JNIEnv *env, jdoubleArray array, svbrdf_camera *camera)
{
    jdouble v[CAMERA];
    if (read_doubles(env, array, CAMERA, v)) {
        return 1;
    }
    svbrdf_camera_init(camera, sizeof *camera);
    camera->width = whole(v[0]);
    camera->height = whole(v[1]);
    camera->fx = v[2];
    camera->fy = v[3];
    camera->cx = v[4];
    camera->cy = v[5];
    memcpy(camera->distortion, v + 6, sizeof camera->distortion);
    return 0;
}

static jlong session_create(JNIEnv *env, jclass class, jintArray ints, jfloatArray reals,
                            jdoubleArray board_array, jbyteArray dictionary,
                            jdoubleArray camera_array, jdoubleArray flash_array, jdouble elevation,
                            jlong memory_limit, jbyteArray state, jobject owner, jlong models,
                            jlong id)
{
    jint i[OPTION_INTS];
    jfloat f[OPTION_FLOATS];
    svbrdf_session_options options;
    svbrdf_board board;
    svbrdf_camera camera;
    jdouble flash[3];
    jbyte *held = NULL, *held_path;
    const char *path;
    svbrdf_session *session = NULL;

    (void)class, (void)owner;
    if (read_ints(env, ints, OPTION_INTS, i) || read_floats(env, reals, OPTION_FLOATS, f)) {
        return 0;
    }
    svbrdf_session_options_init(&options, sizeof options);
    options.scene = (svbrdf_scene)i[0];
    options.resolution = (uint32_t)i[1];
    options.method = (svbrdf_method)i[2];
    options.refine = (uint32_t)i[3];
    options.threads = (uint32_t)i[4];
    options.falloff = (svbrdf_falloff)i[5];
    memcpy(options.sample_mm, f, sizeof options.sample_mm);
    memcpy(options.light_power, f + 2, sizeof options.light_power);
    options.elevation_mm = elevation;
    options.memory_limit_bytes = (uint64_t)memory_limit;
    options.models = HANDLE(svbrdf_models, models);
    if (id != 0) {
        options.on_progress = call_progress;
        options.on_maps = call_maps;
        options.on_log = call_log;
        options.user_data = (void *)(intptr_t)id;
    }
    if (camera_array != NULL) {
        if (read_camera(env, camera_array, &camera)) {
            return 0;
        }
        options.camera = &camera;
    }
    if (flash_array != NULL) {
        if (read_doubles(env, flash_array, 3, flash)) {
            return 0;
        }
        options.flash_offset_mm = flash;
    }
    if (board_array != NULL) {
        if (read_board(env, board_array, dictionary, &held, &board)) {
            return 0;
        }
        options.board = &board;
    }
    if (state == NULL) {
        throw_status(env, svbrdf_session_create(&options, &session));
    } else if ((path = read_text(env, state, &held_path)) != NULL) {
        throw_status(env, svbrdf_session_load_state_from(&options, path, &session));
        release_text(env, state, held_path);
    }
    if (held != NULL) {
        release_text(env, dictionary, held);
    }
    return (jlong)(uintptr_t)session;
}

static void session_destroy(JNIEnv *env, jclass class, jlong handle)
{
    (void)env, (void)class;
    svbrdf_session_destroy(HANDLE(svbrdf_session, handle));
}

static jboolean session_wait(JNIEnv *env, jclass class, jobject owner, jlong handle, jlong limit)
{
    const svbrdf_status status = svbrdf_session_wait(HANDLE(svbrdf_session, handle), limit);
    (void)class, (void)owner;
    if (status == SVBRDF_TIMEOUT) {
        return JNI_FALSE;
    }
    throw_status(env, status);
    return JNI_TRUE;
}

static void session_announce(JNIEnv *env, jclass class, jobject owner, jlong handle, jint photos)
{
    (void)class, (void)owner;
    throw_status(env, svbrdf_session_announce(HANDLE(svbrdf_session, handle), (uint32_t)photos));
}

static void session_progress(JNIEnv *env, jclass class, jobject owner, jlong handle,
                             jdoubleArray out)
{
    svbrdf_progress progress;
    jdouble values[PROGRESS];
    (void)class, (void)owner;
    svbrdf_progress_init(&progress, sizeof progress);
    if (!throw_status(env, svbrdf_session_progress(HANDLE(svbrdf_session, handle), &progress))) {
        fill_progress(&progress, values);
        (*env)->SetDoubleArrayRegion(env, out, 0, PROGRESS, values);
    }
}

static void session_light(JNIEnv *env, jclass class, jobject owner, jlong handle, jdoubleArray out)
{
    jdouble values[4];
    float ambient = 0;
    (void)class, (void)owner;
    if (!throw_status(env, svbrdf_session_light(HANDLE(svbrdf_session, handle), values, &ambient))) {
        values[3] = (jdouble)ambient;
        (*env)->SetDoubleArrayRegion(env, out, 0, 4, values);
    }
}

static void session_next_view(JNIEnv *env, jclass class, jobject owner, jlong handle,
                              jdoubleArray out)
{
    svbrdf_next_view view;
    jdouble values[VIEW];
    int i;
    (void)class, (void)owner;
    svbrdf_next_view_init(&view, sizeof view);
    if (!throw_status(env, svbrdf_session_next_view(HANDLE(svbrdf_session, handle), &view))) {
        values[0] = view.known;
        values[1] = (jdouble)view.tilt_deg;
        values[2] = (jdouble)view.azimuth_deg;
        for (i = 0; i < 3; ++i) {
            values[3 + i] = (jdouble)view.direction[i];
        }
        (*env)->SetDoubleArrayRegion(env, out, 0, VIEW, values);
    }
}

static void session_camera(JNIEnv *env, jclass class, jobject owner, jlong handle,
                           jdoubleArray out)
{
    svbrdf_camera camera;
    jdouble v[CAMERA + SIGMA];
    (void)class, (void)owner;
    svbrdf_camera_init(&camera, sizeof camera);
    if (!throw_status(env, svbrdf_session_camera(HANDLE(svbrdf_session, handle), &camera, v + CAMERA))) {
        v[0] = camera.width;
        v[1] = camera.height;
        v[2] = camera.fx;
        v[3] = camera.fy;
        v[4] = camera.cx;
        v[5] = camera.cy;
        memcpy(v + 6, camera.distortion, sizeof camera.distortion);
        (*env)->SetDoubleArrayRegion(env, out, 0, CAMERA + SIGMA, v);
    }
}

static void session_paper(JNIEnv *env, jclass class, jobject owner, jlong handle, jdoubleArray out)
{
    svbrdf_paper paper;
    jdouble v[PAPER];
    (void)class, (void)owner;
    svbrdf_paper_init(&paper, sizeof paper);
    if (!throw_status(env, svbrdf_session_paper(HANDLE(svbrdf_session, handle), &paper))) {
        v[0] = paper.known;
        v[1] = paper.aspect;
        v[2] = paper.aspect_sigma;
        memcpy(v + 3, paper.bow_mm, sizeof paper.bow_mm);
        memcpy(v + 5, paper.bow_sigma_mm, sizeof paper.bow_sigma_mm);
        v[7] = paper.elevation_mm;
        v[8] = paper.elevation_sigma_mm;
        (*env)->SetDoubleArrayRegion(env, out, 0, PAPER, v);
    }
}

static void session_pose(JNIEnv *env, jclass class, jobject owner, jlong handle, jint index,
                         jdoubleArray out)
{
    jdouble v[POSE];
    (void)class, (void)owner;
    if (!throw_status(env, svbrdf_session_pose(HANDLE(svbrdf_session, handle), (uint32_t)index, v, v + 9,
                                        v + 12))) {
        (*env)->SetDoubleArrayRegion(env, out, 0, POSE, v);
    }
}

static void session_remove(JNIEnv *env, jclass class, jobject owner, jlong handle, jint index)
{
    (void)class, (void)owner;
    throw_status(env, svbrdf_session_remove_photo(HANDLE(svbrdf_session, handle), (uint32_t)index));
}

static void session_photo_fit(JNIEnv *env, jclass class, jobject owner, jlong handle, jint index,
                              jdoubleArray out)
{
    svbrdf_photo_fit fit;
    jdouble v[3];
    (void)class, (void)owner;
    svbrdf_photo_fit_init(&fit, sizeof fit);
    if (!throw_status(env, svbrdf_session_photo_fit(HANDLE(svbrdf_session, handle),
                                                    (uint32_t)index, &fit))) {
        v[0] = (jdouble)fit.residual;
        v[1] = (jdouble)fit.weight;
        v[2] = fit.outlier;
        (*env)->SetDoubleArrayRegion(env, out, 0, 3, v);
    }
}

/* Lines that grow: number of the photo, code, sentence, each with a NUL at its end. */
typedef struct {
    char *text;
    size_t bytes;
    int failed;
} lines;

static void add_text(lines *to, const char *text)
{
    const size_t bytes = strlen(text) + 1;
    char *grown = to->failed ? NULL : realloc(to->text, to->bytes + bytes);
    if (grown == NULL) {
        to->failed = 1;
        return;
    }
    memcpy(grown + to->bytes, text, bytes);
    to->text = grown;
    to->bytes += bytes;
}

static void add_hint(void *user, uint32_t index, const char *code, const char *text)
{
    char number[16];
    snprintf(number, sizeof number, "%u", (unsigned)index);
    add_text(user, number);
    add_text(user, code);
    add_text(user, text);
}

static jbyteArray session_hints(JNIEnv *env, jclass class, jobject owner, jlong handle)
{
    lines all = {NULL, 0, 0};
    jbyteArray out = NULL;
    (void)class, (void)owner;
    if (!throw_status(env, svbrdf_session_hints(HANDLE(svbrdf_session, handle), add_hint, &all))) {
        if (all.failed) {
            throw_bad(env, "hints: out of memory");
        } else {
            out = to_array(env, all.text, all.bytes);
        }
    }
    free(all.text);
    return out;
}

/* Maps that were taken; 0: none yet. */
static jlong taken(JNIEnv *env, svbrdf_status status, svbrdf_maps *maps)
{
    if (status != SVBRDF_NO_MAPS) {
        throw_status(env, status);
    }
    return (jlong)(uintptr_t)maps;
}

static jlong session_snapshot(JNIEnv *env, jclass class, jobject owner, jlong handle)
{
    svbrdf_maps *maps = NULL;
    const svbrdf_status status =
        svbrdf_session_snapshot_maps(HANDLE(svbrdf_session, handle), &maps);
    (void)class, (void)owner;
    return taken(env, status, maps);
}

static jlong session_snapshot_reduced(JNIEnv *env, jclass class, jobject owner, jlong handle,
                                      jint level)
{
    svbrdf_maps *maps = NULL, *small = NULL;
    svbrdf_status status = svbrdf_session_snapshot_maps(HANDLE(svbrdf_session, handle), &maps);
    jlong reduced;
    (void)class, (void)owner;
    if (status == SVBRDF_OK) {
        status = svbrdf_maps_reduced(maps, (uint32_t)level, &small);
    }
    /* Before the next call of the library, which would take the message of a fault away. */
    reduced = taken(env, status, small);
    svbrdf_maps_destroy(maps);
    return reduced;
}

static jlong session_snapshot_with_uncertainty(JNIEnv *env, jclass class, jobject owner, jlong handle)
{
    svbrdf_maps *maps = NULL;
    const svbrdf_status status =
        svbrdf_session_snapshot_with_uncertainty(HANDLE(svbrdf_session, handle), &maps);
    (void)class, (void)owner;
    return taken(env, status, maps);
}

#define SESSION_CALL(name)                                                                       \
    static void session_##name(JNIEnv *env, jclass class, jobject owner, jlong handle)           \
    {                                                                                            \
        (void)class, (void)owner;                                                                \
        throw_status(env, svbrdf_session_##name(HANDLE(svbrdf_session, handle)));                       \
    }
SESSION_CALL(pause)
SESSION_CALL(resume)
SESSION_CALL(cancel)

static void session_set_budget(JNIEnv *env, jclass class, jobject owner, jlong handle,
                               jfloat seconds, jint max_steps, jboolean stop_when_invisible)
{
    svbrdf_budget budget;
    (void)class, (void)owner;
    svbrdf_budget_init(&budget, sizeof budget);
    budget.seconds = seconds;
    budget.max_steps = (uint32_t)max_steps;
    budget.stop_when_invisible = stop_when_invisible == JNI_TRUE ? 1 : 0;
    throw_status(env, svbrdf_session_set_budget(HANDLE(svbrdf_session, handle), &budget));
}

static void session_save(JNIEnv *env, jclass class, jobject owner, jlong handle, jbyteArray path)
{
    jbyte *held;
    const char *text = read_text(env, path, &held);
    (void)class, (void)owner;
    if (text != NULL) {
        throw_status(env, svbrdf_session_save_state_to(HANDLE(svbrdf_session, handle), text));
        release_text(env, path, held);
    }
}

const JNINativeMethod session_methods[] = {
    METHOD("sessionCreate", "([I[F[D[B[D[DDJ[B" OWNER "JJ)J", session_create),
    METHOD("sessionDestroy", "(J)V", session_destroy),
    METHOD("sessionWait", "(" OWNER "JJ)Z", session_wait),
    METHOD("sessionAnnounce", "(" OWNER "JI)V", session_announce),
    METHOD("sessionProgress", "(" OWNER "J[D)V", session_progress),
    METHOD("sessionLight", "(" OWNER "J[D)V", session_light),
    METHOD("sessionNextView", "(" OWNER "J[D)V", session_next_view),
    METHOD("sessionCamera", "(" OWNER "J[D)V", session_camera),
    METHOD("sessionPaper", "(" OWNER "J[D)V", session_paper),
    METHOD("sessionPose", "(" OWNER "JI[D)V", session_pose),
    METHOD("sessionRemovePhoto", "(" OWNER "JI)V", session_remove),
    METHOD("sessionPhotoFit", "(" OWNER "JI[D)V", session_photo_fit),
    METHOD("sessionHints", "(" OWNER "J)[B", session_hints),
    METHOD("sessionSnapshot", "(" OWNER "J)J", session_snapshot),
    METHOD("sessionSnapshotReduced", "(" OWNER "JI)J", session_snapshot_reduced),
    METHOD("sessionSnapshotWithUncertainty", "(" OWNER "J)J", session_snapshot_with_uncertainty),
    METHOD("sessionPause", "(" OWNER "J)V", session_pause),
    METHOD("sessionResume", "(" OWNER "J)V", session_resume),
    METHOD("sessionCancel", "(" OWNER "J)V", session_cancel),
    METHOD("sessionSetBudget", "(" OWNER "JFIZ)V", session_set_budget),
    METHOD("sessionSave", "(" OWNER "J[B)V", session_save),
};
const jint session_method_count = COUNT(session_methods);

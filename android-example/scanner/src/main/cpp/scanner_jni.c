/*
 * The functions of Native.kt over svbrdf.h.
 *
 * Handles cross as numbers: the library gives none out twice and answers stale ones with a status,
 * so nothing here can touch freed memory. `owner` arguments only keep the object that owns the
 * handle from being collected during the call. Text crosses as UTF-8 bytes, because JNI's own
 * string functions take and give another encoding. Failures are thrown as Native.failure() says.
 */
#include <jni.h>
#include <pthread.h>
#include <stdint.h>
#include <string.h>

#include "svbrdf.h"

static JavaVM *vm;
static jclass native_class;
static jmethodID failure, on_progress, on_maps, on_log;
static pthread_key_t attached;

/* Lengths of the arrays that Native.kt hands over. */
enum { IMAGE_INTS = 7, PLANE_LONGS = 4, LEVELS = 18, REPORT = 24, PROGRESS = 8 };
enum { OPTION_INTS = 6, OPTION_FLOATS = 5, BOARD = 13, CAMERA = 11, SIGMA = 9 };
enum { VIEW = 6, PAPER = 9, POSE = 13 };

static jbyteArray to_bytes(JNIEnv *env, const char *text)
{
    const jsize length = (jsize)strlen(text);
    const jbyteArray bytes = (*env)->NewByteArray(env, length);
    if (bytes != NULL) {
        (*env)->SetByteArrayRegion(env, bytes, 0, length, (const jbyte *)text);
    }
    return bytes;
}

static void raise_text(JNIEnv *env, svbrdf_status status, const char *text)
{
    jthrowable thrown;
    const jbyteArray bytes = to_bytes(env, text);
    if (bytes == NULL) {
        return; /* Out of memory is thrown already. */
    }
    thrown = (*env)->CallStaticObjectMethod(env, native_class, failure, (jint)status, bytes);
    if (!(*env)->ExceptionCheck(env)) {
        (*env)->Throw(env, thrown);
    }
}

/* Throws what this thread's latest call has met; 0 when it was done. */
static int raise(JNIEnv *env, svbrdf_status status)
{
    if (status == SVBRDF_OK) {
        return 0;
    }
    raise_text(env, status, svbrdf_last_error_message());
    return 1;
}

static int bad(JNIEnv *env, const char *text)
{
    raise_text(env, SVBRDF_INVALID_ARGUMENT, text);
    return 1;
}

/* Reading arrays: 1 and an exception when there are fewer elements than expected. */
#define READER(name, array_type, element, get)                                                   \
    static int name(JNIEnv *env, array_type array, jsize expected, element *out)                 \
    {                                                                                            \
        if (array == NULL || (*env)->GetArrayLength(env, array) < expected) {                    \
            return bad(env, "an array is missing or too short");                                 \
        }                                                                                        \
        (*env)->get(env, array, 0, expected, out);                                               \
        return 0;                                                                                \
    }
READER(read_ints, jintArray, jint, GetIntArrayRegion)
READER(read_longs, jlongArray, jlong, GetLongArrayRegion)
READER(read_floats, jfloatArray, jfloat, GetFloatArrayRegion)
READER(read_doubles, jdoubleArray, jdouble, GetDoubleArrayRegion)

/* UTF-8 with a NUL at its end, which Native.kt appends. Release with release_text(). */
static const char *read_text(JNIEnv *env, jbyteArray text, jbyte **held)
{
    const jsize length = text == NULL ? 0 : (*env)->GetArrayLength(env, text);
    *held = length == 0 ? NULL : (*env)->GetByteArrayElements(env, text, NULL);
    if (*held == NULL || memchr(*held, 0, (size_t)length) != *held + length - 1) {
        if (*held != NULL) {
            (*env)->ReleaseByteArrayElements(env, text, *held, JNI_ABORT);
        }
        if (!(*env)->ExceptionCheck(env)) {
            bad(env, "text is missing or has a NUL inside");
        }
        return NULL;
    }
    return (const char *)*held;
}

static void release_text(JNIEnv *env, jbyteArray text, jbyte *held)
{
    (*env)->ReleaseByteArrayElements(env, text, held, JNI_ABORT);
}

/* Memory of a direct buffer from `position` on; NULL and an exception when it is not there. */
static void *memory(JNIEnv *env, jobject buffer, jlong position, jlong bytes)
{
    jlong capacity;
    char *address = buffer == NULL ? NULL : (*env)->GetDirectBufferAddress(env, buffer);
    if (address == NULL) {
        bad(env, "a buffer is missing or not direct");
        return NULL;
    }
    capacity = (*env)->GetDirectBufferCapacity(env, buffer);
    if (position < 0 || bytes < 0 || position > capacity || bytes > capacity - position) {
        bad(env, "a buffer is smaller than stated");
        return NULL;
    }
    return address + position;
}

#define HANDLE(type, handle) ((type *)(uintptr_t)(handle))

/* Callbacks. The library's threads are attached when they first call and detached at their end. */

static void detach(void *unused)
{
    (void)unused;
    (*vm)->DetachCurrentThread(vm);
}

static JNIEnv *environment(void)
{
    void *env = NULL;
    JavaVMAttachArgs args;
    if ((*vm)->GetEnv(vm, &env, JNI_VERSION_1_6) == JNI_OK) {
        return env;
    }
    args.version = JNI_VERSION_1_6;
    args.name = "svbrdf";
    args.group = NULL;
    /* A cast that fits Android's and the desktop's jni.h. */
    if ((*vm)->AttachCurrentThreadAsDaemon(vm, (void *)&env, &args) != JNI_OK) {
        return NULL;
    }
    pthread_setspecific(attached, vm);
    return env;
}

/* What callbacks throw, Native.kt has dealt with; this is for what it may throw itself. */
static void dismiss(JNIEnv *env)
{
    if ((*env)->ExceptionCheck(env)) {
        (*env)->ExceptionDescribe(env);
        (*env)->ExceptionClear(env);
    }
}

static void fill_progress(const svbrdf_progress *progress, jdouble out[PROGRESS])
{
    out[0] = progress->state;
    out[1] = progress->frames;
    out[2] = progress->settled;
    out[3] = (jdouble)progress->fraction;
    out[4] = (jdouble)progress->loss_before;
    out[5] = (jdouble)progress->loss;
    out[6] = (jdouble)progress->seconds_left;
    out[7] = (jdouble)progress->maps_revision;
}

static void call_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress)
{
    jdouble values[PROGRESS];
    jdoubleArray array;
    JNIEnv *env = environment();
    (void)session;
    if (env == NULL) {
        return;
    }
    array = (*env)->NewDoubleArray(env, PROGRESS);
    if (array != NULL) {
        fill_progress(progress, values);
        (*env)->SetDoubleArrayRegion(env, array, 0, PROGRESS, values);
        (*env)->CallStaticVoidMethod(env, native_class, on_progress, (jlong)(intptr_t)user, array);
    }
    dismiss(env);
    (*env)->DeleteLocalRef(env, array);
}

static void call_maps(void *user, svbrdf_session *session)
{
    JNIEnv *env = environment();
    (void)session;
    if (env != NULL) {
        (*env)->CallStaticVoidMethod(env, native_class, on_maps, (jlong)(intptr_t)user);
        dismiss(env);
    }
}

static void call_log(void *user, svbrdf_log_level level, const char *message)
{
    jbyteArray text;
    JNIEnv *env = environment();
    if (env == NULL) {
        return;
    }
    text = to_bytes(env, message);
    if (text != NULL) {
        (*env)->CallStaticVoidMethod(env, native_class, on_log, (jlong)(intptr_t)user,
                                     (jint)level, text);
    }
    dismiss(env);
    (*env)->DeleteLocalRef(env, text);
}

/* Library. */

static jbyteArray version(JNIEnv *env, jclass class)
{
    (void)class;
    return to_bytes(env, svbrdf_version());
}

static jlong features(JNIEnv *env, jclass class)
{
    (void)env, (void)class;
    return (jlong)svbrdf_features();
}

/* Session. */

/* An Int that came as a number; negative ones become too large for the library. */
static uint32_t whole(jdouble value)
{
    return (uint32_t)(int64_t)value;
}

static int read_board(JNIEnv *env, jdoubleArray array, svbrdf_board *board)
{
    jdouble v[BOARD];
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

static jlong session_create(JNIEnv *env, jclass class, jintArray ints, jlong seed,
                            jfloatArray reals, jdoubleArray board_array, jbyteArray dictionary,
                            jdoubleArray camera_array, jdoubleArray flash_array,
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
    options.seed = (uint64_t)seed;
    memcpy(options.sample_mm, f, sizeof options.sample_mm);
    memcpy(options.light_power, f + 2, sizeof options.light_power);
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
        if (read_board(env, board_array, &board)) {
            return 0;
        }
        options.board = &board;
        if (dictionary != NULL) {
            board.dictionary = read_text(env, dictionary, &held);
            if (board.dictionary == NULL) {
                return 0;
            }
        }
    }
    if (state == NULL) {
        raise(env, svbrdf_session_create(&options, &session));
    } else if ((path = read_text(env, state, &held_path)) != NULL) {
        raise(env, svbrdf_session_load_state_from(&options, path, &session));
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

static int read_image(JNIEnv *env, jintArray ints, jobjectArray planes, jlongArray layout,
                      jfloatArray levels, svbrdf_image *image)
{
    jint i[IMAGE_INTS];
    jlong l[3 * PLANE_LONGS];
    jfloat f[LEVELS];
    jsize count, p;

    if (planes == NULL || read_ints(env, ints, IMAGE_INTS, i) ||
        read_floats(env, levels, LEVELS, f)) {
        return 1;
    }
    count = (*env)->GetArrayLength(env, planes);
    if (count > 3) {
        return bad(env, "at most three planes expected");
    }
    if (read_longs(env, layout, count * PLANE_LONGS, l)) {
        return 1;
    }
    svbrdf_image_init(image, sizeof *image);
    image->format = (svbrdf_pixel_format)i[0];
    image->width = (uint32_t)i[1];
    image->height = (uint32_t)i[2];
    image->transfer = (svbrdf_transfer)i[3];
    image->rotation = (uint32_t)i[4];
    image->yuv_matrix = (svbrdf_yuv_matrix)i[5];
    image->bayer_pattern = (svbrdf_bayer_pattern)i[6];
    image->saturation = f[0];
    memcpy(image->black_level, f + 1, sizeof image->black_level);
    image->white_level = f[5];
    memcpy(image->white_balance, f + 6, sizeof image->white_balance);
    memcpy(image->color_matrix, f + 9, sizeof image->color_matrix);
    for (p = 0; p < count; ++p) {
        const jlong *plane = l + p * PLANE_LONGS;
        const jobject buffer = (*env)->GetObjectArrayElement(env, planes, p);
        image->planes[p].data = memory(env, buffer, plane[0], plane[1]);
        (*env)->DeleteLocalRef(env, buffer);
        if (image->planes[p].data == NULL) {
            return 1;
        }
        image->planes[p].bytes = (size_t)plane[1];
        image->planes[p].row_stride = (size_t)plane[2];
        image->planes[p].pixel_stride = (size_t)plane[3];
    }
    return 0;
}

/* What to tell the user; empty where there is nothing to tell. */
static jbyteArray session_push(JNIEnv *env, jclass class, jobject owner, jlong handle,
                               jintArray ints, jobjectArray planes, jlongArray layout,
                               jfloatArray levels, jfloat exposure, jint flash, jlong timestamp,
                               jfloatArray camera_mm, jfloatArray light_mm, jintArray dark_ints,
                               jobjectArray dark_planes, jlongArray dark_layout,
                               jfloatArray dark_levels, jfloat dark_exposure, jfloat focal_35mm,
                               jdoubleArray out)
{
    svbrdf_session *session = HANDLE(svbrdf_session, handle);
    svbrdf_image image, dark;
    svbrdf_frame_info info;
    svbrdf_frame_report report;
    svbrdf_status status;
    jfloat camera[3], light[3];
    jdouble values[REPORT];

    (void)class, (void)owner;
    if (read_image(env, ints, planes, layout, levels, &image)) {
        return NULL;
    }
    svbrdf_frame_info_init(&info, sizeof info);
    info.exposure = exposure;
    info.flash = (svbrdf_flash)flash;
    info.timestamp_ns = timestamp;
    info.focal_35mm = focal_35mm;
    if (dark_ints != NULL) {
        if (read_image(env, dark_ints, dark_planes, dark_layout, dark_levels, &dark)) {
            return NULL;
        }
        info.ambient = &dark;
        info.ambient_exposure = dark_exposure;
    }
    svbrdf_frame_report_init(&report, sizeof report);
    if (camera_mm != NULL || light_mm != NULL) {
        if (read_floats(env, camera_mm, 3, camera) || read_floats(env, light_mm, 3, light)) {
            return NULL;
        }
        status = svbrdf_session_push_rectified(session, &image, &info, camera, light, &report);
    } else {
        status = svbrdf_session_push_frame(session, &image, &info, &report);
    }
    if (status != SVBRDF_OK && status != SVBRDF_REJECTED) {
        raise(env, status);
        return NULL;
    }
    values[0] = report.accepted;
    values[1] = report.rejection;
    values[2] = report.index;
    values[3] = report.has_pose;
    memcpy(values + 4, report.rotation, sizeof report.rotation);
    memcpy(values + 13, report.translation_mm, sizeof report.translation_mm);
    values[16] = report.reprojection_rms_px;
    values[17] = report.maps_seconds;
    values[18] = report.hints;
    values[19] = report.same_view_as;
    values[20] = (jdouble)report.over_white;
    values[21] = (jdouble)report.measured;
    values[22] = (jdouble)report.limit;
    values[23] = (jdouble)report.blur_direction_deg;
    (*env)->SetDoubleArrayRegion(env, out, 0, REPORT, values);
    return (*env)->ExceptionCheck(env) ? NULL : to_bytes(env, report.advice);
}

static jboolean session_wait(JNIEnv *env, jclass class, jobject owner, jlong handle, jlong limit)
{
    const svbrdf_status status = svbrdf_session_wait(HANDLE(svbrdf_session, handle), limit);
    (void)class, (void)owner;
    if (status == SVBRDF_TIMEOUT) {
        return JNI_FALSE;
    }
    raise(env, status);
    return JNI_TRUE;
}

static void session_progress(JNIEnv *env, jclass class, jobject owner, jlong handle,
                             jdoubleArray out)
{
    svbrdf_progress progress;
    jdouble values[PROGRESS];
    (void)class, (void)owner;
    svbrdf_progress_init(&progress, sizeof progress);
    if (!raise(env, svbrdf_session_progress(HANDLE(svbrdf_session, handle), &progress))) {
        fill_progress(&progress, values);
        (*env)->SetDoubleArrayRegion(env, out, 0, PROGRESS, values);
    }
}

static void session_light(JNIEnv *env, jclass class, jobject owner, jlong handle, jdoubleArray out)
{
    jdouble values[4];
    float ambient = 0;
    (void)class, (void)owner;
    if (!raise(env, svbrdf_session_light(HANDLE(svbrdf_session, handle), values, &ambient))) {
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
    if (!raise(env, svbrdf_session_next_view(HANDLE(svbrdf_session, handle), &view))) {
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
    if (!raise(env, svbrdf_session_camera(HANDLE(svbrdf_session, handle), &camera, v + CAMERA))) {
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
    if (!raise(env, svbrdf_session_paper(HANDLE(svbrdf_session, handle), &paper))) {
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
    if (!raise(env, svbrdf_session_pose(HANDLE(svbrdf_session, handle), (uint32_t)index, v, v + 9,
                                        v + 12))) {
        (*env)->SetDoubleArrayRegion(env, out, 0, POSE, v);
    }
}

/* 0: no maps yet. */
static jlong session_snapshot(JNIEnv *env, jclass class, jobject owner, jlong handle)
{
    svbrdf_maps *maps = NULL;
    const svbrdf_status status =
        svbrdf_session_snapshot_maps(HANDLE(svbrdf_session, handle), &maps);
    (void)class, (void)owner;
    if (status != SVBRDF_NO_MAPS) {
        raise(env, status);
    }
    return (jlong)(uintptr_t)maps;
}

#define SESSION_CALL(name)                                                                       \
    static void session_##name(JNIEnv *env, jclass class, jobject owner, jlong handle)           \
    {                                                                                            \
        (void)class, (void)owner;                                                                \
        raise(env, svbrdf_session_##name(HANDLE(svbrdf_session, handle)));                       \
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
    raise(env, svbrdf_session_set_budget(HANDLE(svbrdf_session, handle), &budget));
}

static void session_save(JNIEnv *env, jclass class, jobject owner, jlong handle, jbyteArray path)
{
    jbyte *held;
    const char *text = read_text(env, path, &held);
    (void)class, (void)owner;
    if (text != NULL) {
        raise(env, svbrdf_session_save_state_to(HANDLE(svbrdf_session, handle), text));
        release_text(env, path, held);
    }
}

/* Maps. */

static void maps_size(JNIEnv *env, jclass class, jobject owner, jlong handle, jdoubleArray out)
{
    uint32_t width = 0, height = 0;
    float mm[2];
    jdouble values[4];
    (void)class, (void)owner;
    if (!raise(env, svbrdf_maps_size(HANDLE(svbrdf_maps, handle), &width, &height, mm))) {
        values[0] = width;
        values[1] = height;
        values[2] = (jdouble)mm[0];
        values[3] = (jdouble)mm[1];
        (*env)->SetDoubleArrayRegion(env, out, 0, 4, values);
    }
}

static void maps_copy(JNIEnv *env, jclass class, jobject owner, jlong handle, jint map, jint format,
                      jobject buffer, jlong bytes)
{
    void *data = memory(env, buffer, 0, bytes);
    (void)class, (void)owner;
    if (data != NULL) {
        raise(env, svbrdf_maps_copy(HANDLE(svbrdf_maps, handle), (svbrdf_map)map,
                                    (svbrdf_map_format)format, data, (size_t)bytes, 0));
    }
}

static void maps_export(JNIEnv *env, jclass class, jobject owner, jlong handle, jbyteArray path)
{
    jbyte *held;
    const char *text = read_text(env, path, &held);
    (void)class, (void)owner;
    if (text != NULL) {
        raise(env, svbrdf_maps_export(HANDLE(svbrdf_maps, handle), text));
        release_text(env, path, held);
    }
}

/* Exports into a folder; formats are names with commas between them. */
static void maps_export_formats(JNIEnv *env, jclass class, jobject owner, jlong handle,
                                jbyteArray path, jbyteArray formats, jboolean tile,
                                jboolean metallic)
{
    jbyte *held, *names_held;
    const char *text = read_text(env, path, &held), *names;
    (void)class, (void)owner;
    if (text == NULL) {
        return;
    }
    names = read_text(env, formats, &names_held);
    if (names != NULL) {
        svbrdf_export_options options;
        svbrdf_export_options_init(&options, sizeof options);
        options.formats = names;
        options.tile = tile ? 1 : 0;
        options.metallic = metallic ? 1 : 0;
        raise(env, svbrdf_maps_export_formats(HANDLE(svbrdf_maps, handle), &options, text));
        release_text(env, formats, names_held);
    }
    release_text(env, path, held);
}

/* The file of that name of a package; NULL and an exception when there is none. */
static jbyteArray file_of(JNIEnv *env, const svbrdf_package *package, const char *wanted)
{
    const char *name = NULL;
    const void *data = NULL;
    size_t bytes = 0;
    jbyteArray out;
    uint32_t i;
    for (i = 0; svbrdf_package_file(package, i, &name, &data, &bytes) == SVBRDF_OK; i++) {
        if (strcmp(name, wanted) == 0) {
            if (bytes > INT32_MAX) {
                break;
            }
            out = (*env)->NewByteArray(env, (jsize)bytes);
            if (out != NULL) {
                (*env)->SetByteArrayRegion(env, out, 0, (jsize)bytes, data);
            }
            return out;
        }
    }
    bad(env, "no such file in the export");
    return NULL;
}

/* One file of an export, in memory. */
static jbyteArray maps_file(JNIEnv *env, jclass class, jobject owner, jlong handle,
                            jbyteArray format, jbyteArray name)
{
    jbyte *held, *name_held;
    const char *text = read_text(env, format, &held), *wanted;
    jbyteArray out = NULL;
    (void)class, (void)owner;
    if (text == NULL) {
        return NULL;
    }
    wanted = read_text(env, name, &name_held);
    if (wanted != NULL) {
        svbrdf_export_options options;
        svbrdf_package *package = NULL;
        svbrdf_export_options_init(&options, sizeof options);
        options.formats = text;
        if (!raise(env, svbrdf_maps_export_package(HANDLE(svbrdf_maps, handle), &options,
                                                   &package))) {
            out = file_of(env, package, wanted);
            svbrdf_package_destroy(package);
        }
        release_text(env, name, name_held);
    }
    release_text(env, format, held);
    return out;
}

static void maps_destroy(JNIEnv *env, jclass class, jlong handle)
{
    (void)env, (void)class;
    svbrdf_maps_destroy(HANDLE(svbrdf_maps, handle));
}

/* Models. */

static jlong models_from_memory(JNIEnv *env, jclass class, jobject decoder, jobject encoder,
                                jobject photo, jobject completion)
{
    const jobject buffers[4] = {decoder, encoder, photo, completion};
    const void *data[4];
    size_t bytes[4];
    svbrdf_models *models = NULL;
    int i;
    (void)class;
    for (i = 0; i < 4; ++i) {
        data[i] = memory(env, buffers[i], 0, 0);
        if (data[i] == NULL) {
            return 0;
        }
        bytes[i] = (size_t)(*env)->GetDirectBufferCapacity(env, buffers[i]);
    }
    raise(env, svbrdf_models_from_memory(data[0], bytes[0], data[1], bytes[1], data[2], bytes[2],
                                         data[3], bytes[3], &models));
    return (jlong)(uintptr_t)models;
}

static jlong models_from_folder(JNIEnv *env, jclass class, jbyteArray path)
{
    svbrdf_models *models = NULL;
    jbyte *held;
    const char *text = read_text(env, path, &held);
    (void)class;
    if (text != NULL) {
        raise(env, svbrdf_models_from_folder(text, &models));
        release_text(env, path, held);
    }
    return (jlong)(uintptr_t)models;
}

static void models_destroy(JNIEnv *env, jclass class, jlong handle)
{
    (void)env, (void)class;
    svbrdf_models_destroy(HANDLE(svbrdf_models, handle));
}

#define OWNER "Ljava/lang/Object;"
#define BUFFER "Ljava/nio/ByteBuffer;"
#define METHOD(name, signature, function) {(char *)name, (char *)signature, (void *)function}

static const JNINativeMethod methods[] = {
    METHOD("version", "()[B", version),
    METHOD("features", "()J", features),
    METHOD("sessionCreate", "([IJ[F[D[B[D[DJ[B" OWNER "JJ)J", session_create),
    METHOD("sessionDestroy", "(J)V", session_destroy),
    METHOD("sessionPush", "(" OWNER "J[I[" BUFFER "[J[FFIJ[F[F[I[" BUFFER "[J[FFF[D)[B",
           session_push),
    METHOD("sessionWait", "(" OWNER "JJ)Z", session_wait),
    METHOD("sessionProgress", "(" OWNER "J[D)V", session_progress),
    METHOD("sessionLight", "(" OWNER "J[D)V", session_light),
    METHOD("sessionNextView", "(" OWNER "J[D)V", session_next_view),
    METHOD("sessionCamera", "(" OWNER "J[D)V", session_camera),
    METHOD("sessionPaper", "(" OWNER "J[D)V", session_paper),
    METHOD("sessionPose", "(" OWNER "JI[D)V", session_pose),
    METHOD("sessionSnapshot", "(" OWNER "J)J", session_snapshot),
    METHOD("sessionPause", "(" OWNER "J)V", session_pause),
    METHOD("sessionResume", "(" OWNER "J)V", session_resume),
    METHOD("sessionCancel", "(" OWNER "J)V", session_cancel),
    METHOD("sessionSetBudget", "(" OWNER "JFIZ)V", session_set_budget),
    METHOD("sessionSave", "(" OWNER "J[B)V", session_save),
    METHOD("mapsSize", "(" OWNER "J[D)V", maps_size),
    METHOD("mapsCopy", "(" OWNER "JII" BUFFER "J)V", maps_copy),
    METHOD("mapsExport", "(" OWNER "J[B)V", maps_export),
    METHOD("mapsExportFormats", "(" OWNER "J[B[BZZ)V", maps_export_formats),
    METHOD("mapsFile", "(" OWNER "J[B[B)[B", maps_file),
    METHOD("mapsDestroy", "(J)V", maps_destroy),
    METHOD("modelsFromMemory", "(" BUFFER BUFFER BUFFER BUFFER ")J", models_from_memory),
    METHOD("modelsFromFolder", "([B)J", models_from_folder),
    METHOD("modelsDestroy", "(J)V", models_destroy),
};

JNIEXPORT jint JNICALL JNI_OnLoad(JavaVM *java, void *reserved)
{
    void *pointer = NULL;
    JNIEnv *env;
    jclass found;

    (void)reserved;
    vm = java;
    if ((*vm)->GetEnv(vm, &pointer, JNI_VERSION_1_6) != JNI_OK) {
        return JNI_ERR;
    }
    env = pointer;
    /* Structs of another major version mean something else. */
    if (svbrdf_version_number() >> 16 != SVBRDF_VERSION_MAJOR) {
        return JNI_ERR;
    }
    found = (*env)->FindClass(env, "org/svbrdf/scanner/Native");
    if (found == NULL) {
        return JNI_ERR;
    }
    native_class = (*env)->NewGlobalRef(env, found);
    (*env)->DeleteLocalRef(env, found);
    if (native_class == NULL) {
        return JNI_ERR;
    }
    failure = (*env)->GetStaticMethodID(env, native_class, "failure", "(I[B)Ljava/lang/Throwable;");
    if (failure == NULL) {
        return JNI_ERR;
    }
    on_progress = (*env)->GetStaticMethodID(env, native_class, "onProgress", "(J[D)V");
    if (on_progress == NULL) {
        return JNI_ERR;
    }
    on_maps = (*env)->GetStaticMethodID(env, native_class, "onMaps", "(J)V");
    if (on_maps == NULL) {
        return JNI_ERR;
    }
    on_log = (*env)->GetStaticMethodID(env, native_class, "onLog", "(JI[B)V");
    if (on_log == NULL) {
        return JNI_ERR;
    }
    if (pthread_key_create(&attached, detach) != 0) {
        return JNI_ERR;
    }
    if ((*env)->RegisterNatives(env, native_class, methods,
                                (jint)(sizeof methods / sizeof methods[0])) != JNI_OK) {
        return JNI_ERR;
    }
    return JNI_VERSION_1_6;
}

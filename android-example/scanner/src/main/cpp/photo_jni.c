/* The methods of Native.kt that hand a photo over. */
#include <string.h>

#include "boundary.h"

/* Lengths of the arrays that Native.kt hands over. */
enum {
    IMAGE_INTS = 8,
    PLANE_LONGS = 4,
    LEVELS = 18,
    PROBE = 44,
    CORNERS = 1024,
    FILE_INFO = 9,
    GUIDANCE = 11,
    GUIDE_OPTIONS = 8
};

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
        return throw_bad(env, "at most three planes expected");
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
    image->primaries = (svbrdf_primaries)i[7];
    image->saturation = f[0];
    memcpy(image->black_level, f + 1, sizeof image->black_level);
    image->white_level = f[5];
    memcpy(image->white_balance, f + 6, sizeof image->white_balance);
    memcpy(image->color_matrix, f + 9, sizeof image->color_matrix);
    for (p = 0; p < count; ++p) {
        const jlong *plane = l + p * PLANE_LONGS;
        const jobject buffer = (*env)->GetObjectArrayElement(env, planes, p);
        image->planes[p].data = direct_memory(env, buffer, plane[0], plane[1]);
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

void fill_report(const svbrdf_photo_report *report, jdouble out[REPORT])
{
    out[0] = report->accepted;
    out[1] = report->rejection;
    out[2] = report->index;
    out[3] = report->has_pose;
    memcpy(out + 4, report->rotation, sizeof report->rotation);
    memcpy(out + 13, report->translation_mm, sizeof report->translation_mm);
    out[16] = report->reprojection_rms_px;
    out[17] = report->maps_seconds;
    out[18] = report->hints;
    out[19] = report->same_view_as;
    out[20] = (jdouble)report->over_white;
    out[21] = (jdouble)report->measured;
    out[22] = (jdouble)report->limit;
    out[23] = (jdouble)report->blur_direction_deg;
    out[24] = report->measure;
}

/* An image and how it was taken. */
static int read_lit(JNIEnv *env, jintArray ints, jobjectArray planes, jlongArray layout,
                    jfloatArray levels, jfloat exposure, jint flash, jfloat focal_35mm,
                    svbrdf_image *image, svbrdf_photo_info *info)
{
    if (read_image(env, ints, planes, layout, levels, image)) {
        return 1;
    }
    svbrdf_photo_info_init(info, sizeof *info);
    info->exposure = exposure;
    info->flash = (svbrdf_flash)flash;
    info->focal_35mm = focal_35mm;
    return 0;
}

/* A photo and its metadata; `dark` has the one without flash, if there is one. */
static int read_photo(JNIEnv *env, jintArray ints, jobjectArray planes, jlongArray layout,
                      jfloatArray levels, jfloat exposure, jint flash, jlong timestamp,
                      jfloat focal_35mm, jintArray dark_ints, jobjectArray dark_planes,
                      jlongArray dark_layout, jfloatArray dark_levels, jfloat dark_exposure,
                      svbrdf_image *image, svbrdf_image *dark, svbrdf_photo_info *info)
{
    if (read_lit(env, ints, planes, layout, levels, exposure, flash, focal_35mm, image, info)) {
        return 1;
    }
    info->timestamp_ns = timestamp;
    if (dark_ints != NULL) {
        if (read_image(env, dark_ints, dark_planes, dark_layout, dark_levels, dark)) {
            return 1;
        }
        info->ambient = dark;
        info->ambient_exposure = dark_exposure;
    }
    return 0;
}

/* Advice for the user; may be empty. */
static jbyteArray session_add_photo(JNIEnv *env, jclass class, jobject owner, jlong handle,
                               jintArray ints, jobjectArray planes, jlongArray layout,
                               jfloatArray levels, jfloat exposure, jint flash, jlong timestamp,
                               jfloatArray camera_mm, jfloatArray light_mm, jintArray dark_ints,
                               jobjectArray dark_planes, jlongArray dark_layout,
                               jfloatArray dark_levels, jfloat dark_exposure, jfloat focal_35mm,
                               jdoubleArray out)
{
    svbrdf_session *session = HANDLE(svbrdf_session, handle);
    svbrdf_image image, dark;
    svbrdf_photo_info info;
    svbrdf_photo_report report;
    svbrdf_status status;
    jfloat camera[3], light[3];
    jdouble values[REPORT];

    (void)class, (void)owner;
    if (read_photo(env, ints, planes, layout, levels, exposure, flash, timestamp, focal_35mm,
                   dark_ints, dark_planes, dark_layout, dark_levels, dark_exposure, &image, &dark,
                   &info)) {
        return NULL;
    }
    svbrdf_photo_report_init(&report, sizeof report);
    if (camera_mm != NULL || light_mm != NULL) {
        if (read_floats(env, camera_mm, 3, camera) || read_floats(env, light_mm, 3, light)) {
            return NULL;
        }
        status = svbrdf_session_add_rectified_photo(session, &image, &info, camera, light, &report);
    } else {
        status = svbrdf_session_add_photo(session, &image, &info, &report);
    }
    if (status != SVBRDF_OK && status != SVBRDF_REJECTED) {
        throw_status(env, status);
        return NULL;
    }
    fill_report(&report, values);
    (*env)->SetDoubleArrayRegion(env, out, 0, REPORT, values);
    return (*env)->ExceptionCheck(env) ? NULL : to_bytes(env, report.advice);
}

/* The metadata of a file in the order of PhotoFile.kt; 1 and an exception on failure. */
static int give_info(JNIEnv *env, const svbrdf_file_info *info, jdoubleArray out,
                     jobjectArray names)
{
    const char *texts[] = {info->make, info->model, info->lens, info->taken};
    jdouble values[FILE_INFO];
    jsize i;

    values[0] = info->width;
    values[1] = info->height;
    values[2] = info->upright_deg;
    values[3] = info->is_linear;
    values[4] = (jdouble)info->exposure;
    values[5] = (jdouble)info->focal_mm;
    values[6] = (jdouble)info->focal_35mm;
    values[7] = (jdouble)info->digital_zoom;
    values[8] = info->remarks;
    (*env)->SetDoubleArrayRegion(env, out, 0, FILE_INFO, values);
    for (i = 0; i < COUNT(texts) && !(*env)->ExceptionCheck(env); ++i) {
        const jbyteArray text = to_bytes(env, texts[i]);
        if (text != NULL) {
            (*env)->SetObjectArrayElement(env, names, i, text);
            (*env)->DeleteLocalRef(env, text);
        }
    }
    return (*env)->ExceptionCheck(env) != 0;
}

/* As session_add_photo() with a file. */
static jbyteArray session_add_photo_file(JNIEnv *env, jclass class, jobject owner, jlong handle,
                                       jobject file, jlong position, jlong bytes, jfloat exposure,
                                       jint transfer, jint rotation, jint flash, jlong timestamp,
                                       jlong max_pixels, jlong max_bytes, jdoubleArray info_out,
                                       jobjectArray names, jdoubleArray out)
{
    svbrdf_file_options options;
    svbrdf_file_info info;
    svbrdf_photo_report report;
    svbrdf_status status;
    jdouble values[REPORT];
    const void *content = direct_memory(env, file, position, bytes);

    (void)class, (void)owner;
    if (content == NULL) {
        return NULL;
    }
    svbrdf_file_options_init(&options, sizeof options);
    svbrdf_file_info_init(&info, sizeof info);
    svbrdf_photo_report_init(&report, sizeof report);
    options.exposure = exposure;
    options.transfer = (svbrdf_transfer)transfer;
    options.rotation = (uint32_t)rotation;
    options.flash = (svbrdf_flash)flash;
    options.timestamp_ns = timestamp;
    options.max_pixels = (uint64_t)max_pixels;
    options.max_bytes = (uint64_t)max_bytes;
    status = svbrdf_session_add_photo_file(HANDLE(svbrdf_session, handle), content, (size_t)bytes,
                                         &options, &info, &report);
    if (status != SVBRDF_OK && status != SVBRDF_REJECTED) {
        throw_status(env, status);
        return NULL;
    }
    fill_report(&report, values);
    (*env)->SetDoubleArrayRegion(env, out, 0, REPORT, values);
    if ((*env)->ExceptionCheck(env) || give_info(env, &info, info_out, names)) {
        return NULL;
    }
    return to_bytes(env, report.advice);
}

static void file_look_at(JNIEnv *env, jclass class, jobject file, jlong position, jlong bytes,
                         jdoubleArray info_out, jobjectArray names)
{
    svbrdf_file_info info;
    const void *content = direct_memory(env, file, position, bytes);

    (void)class;
    if (content == NULL) {
        return;
    }
    svbrdf_file_info_init(&info, sizeof info);
    if (!throw_status(env, svbrdf_file_look_at(content, (size_t)bytes, &info))) {
        give_info(env, &info, info_out, names);
    }
}

/* Native.onOutcome() is told of `id`, unless an exception is thrown. */
static void session_add_photo_async(JNIEnv *env, jclass class, jobject owner, jlong handle,
                               jintArray ints, jobjectArray planes, jlongArray layout,
                               jfloatArray levels, jfloat exposure, jint flash, jlong timestamp,
                               jintArray dark_ints, jobjectArray dark_planes,
                               jlongArray dark_layout, jfloatArray dark_levels,
                               jfloat dark_exposure, jfloat focal_35mm, jlong id)
{
    svbrdf_image image, dark;
    svbrdf_photo_info info;

    (void)class, (void)owner;
    if (!read_photo(env, ints, planes, layout, levels, exposure, flash, timestamp, focal_35mm,
                    dark_ints, dark_planes, dark_layout, dark_levels, dark_exposure, &image, &dark,
                    &info)) {
        throw_status(env, svbrdf_session_add_photo_async(HANDLE(svbrdf_session, handle), &image,
                                                          &info, call_outcome,
                                                          (void *)(intptr_t)id));
    }
}

/* Numbers from `at` on. */
static void widen(const float *from, int count, jdouble *at)
{
    int i;
    for (i = 0; i < count; ++i) {
        at[i] = (jdouble)from[i];
    }
}

static void fill_probe(const svbrdf_probe *probe, jdouble out[PROBE])
{
    out[0] = probe->acceptable;
    out[1] = probe->rejection;
    out[2] = probe->hints;
    out[3] = probe->same_view_as;
    out[4] = probe->corners_found;
    out[5] = probe->corners_in_view;
    out[6] = probe->corners_expected;
    out[7] = probe->has_pose;
    memcpy(out + 8, probe->rotation, sizeof probe->rotation);
    memcpy(out + 17, probe->translation_mm, sizeof probe->translation_mm);
    out[20] = probe->reprojection_rms_px;
    out[21] = (jdouble)probe->distance_mm;
    out[22] = (jdouble)probe->tilt_deg;
    out[23] = (jdouble)probe->azimuth_deg;
    out[24] = (jdouble)probe->off_next_deg;
    out[25] = (jdouble)probe->sample_seen;
    out[26] = (jdouble)probe->sample_clipped;
    widen(probe->sample_px, 8, out + 27);
    out[35] = (jdouble)probe->px_per_mm;
    out[36] = (jdouble)probe->blur_px;
    out[37] = (jdouble)probe->blur_direction_deg;
    out[38] = (jdouble)probe->white_level;
    out[39] = (jdouble)probe->white_clipped;
    out[40] = (jdouble)probe->over_white;
    out[41] = (jdouble)probe->measured;
    out[42] = (jdouble)probe->limit;
    out[43] = probe->measure;
}

/* Advice for the user; may be empty. */
static jbyteArray session_probe(JNIEnv *env, jclass class, jobject owner, jlong handle,
                                jintArray ints, jobjectArray planes, jlongArray layout,
                                jfloatArray levels, jfloat exposure, jint flash, jfloat focal_35mm,
                                jfloatArray corners, jdoubleArray out)
{
    svbrdf_image image;
    svbrdf_photo_info info;
    svbrdf_probe probe;
    jdouble values[PROBE];
    float px[2 * CORNERS];
    uint32_t found;

    (void)class, (void)owner;
    if (read_lit(env, ints, planes, layout, levels, exposure, flash, focal_35mm, &image, &info)) {
        return NULL;
    }
    svbrdf_probe_init(&probe, sizeof probe);
    probe.corners_px = px;
    probe.corners_capacity = CORNERS;
    if (throw_status(env, svbrdf_session_probe(HANDLE(svbrdf_session, handle), &image, &info,
                                               &probe))) {
        return NULL;
    }
    fill_probe(&probe, values);
    found = probe.corners_found < CORNERS ? probe.corners_found : CORNERS;
    (*env)->SetFloatArrayRegion(env, corners, 0, (jsize)(2 * found), px);
    if ((*env)->ExceptionCheck(env)) {
        return NULL;
    }
    (*env)->SetDoubleArrayRegion(env, out, 0, PROBE, values);
    return (*env)->ExceptionCheck(env) ? NULL : to_bytes(env, probe.advice);
}

static void fill_guidance(const svbrdf_guidance *guidance, jdouble out[GUIDANCE])
{
    out[0] = guidance->action;
    out[1] = guidance->photos;
    out[2] = guidance->has_target;
    out[3] = (jdouble)guidance->target_tilt_deg;
    out[4] = (jdouble)guidance->target_azimuth_deg;
    widen(guidance->offset_mm, 3, out + 5);
    out[8] = (jdouble)guidance->degrees;
    out[9] = (jdouble)guidance->gain;
    out[10] = (jdouble)guidance->best_gain;
}

/* Two texts; NULL and an exception where there is no memory. */
static jobjectArray texts(JNIEnv *env, const char *first, const char *second)
{
    const char *both[2];
    const jclass bytes = (*env)->FindClass(env, "[B");
    const jobjectArray array = bytes == NULL ? NULL : (*env)->NewObjectArray(env, 2, bytes, NULL);
    int i;
    both[0] = first;
    both[1] = second;
    for (i = 0; array != NULL && i < 2; ++i) {
        const jbyteArray text = to_bytes(env, both[i]);
        if (text == NULL) {
            return NULL;
        }
        (*env)->SetObjectArrayElement(env, array, i, text);
        (*env)->DeleteLocalRef(env, text);
    }
    return array;
}

/* The probe and the guidance as objects. */
static jobjectArray session_guide(JNIEnv *env, jclass class, jobject owner, jlong handle,
                                  jintArray ints, jobjectArray planes, jlongArray layout,
                                  jfloatArray levels, jfloat exposure, jint flash,
                                  jfloat focal_35mm, jlong timestamp, jfloatArray corners,
                                  jdoubleArray out)
{
    svbrdf_image image;
    svbrdf_photo_info info;
    svbrdf_probe probe;
    svbrdf_guidance guidance;
    jdouble values[PROBE + GUIDANCE];
    float px[2 * CORNERS];
    uint32_t found;

    (void)class, (void)owner;
    if (read_lit(env, ints, planes, layout, levels, exposure, flash, focal_35mm, &image, &info)) {
        return NULL;
    }
    info.timestamp_ns = timestamp;
    svbrdf_probe_init(&probe, sizeof probe);
    probe.corners_px = px;
    probe.corners_capacity = CORNERS;
    svbrdf_guidance_init(&guidance, sizeof guidance);
    if (throw_status(env, svbrdf_session_guide(HANDLE(svbrdf_session, handle), &image, &info,
                                               &probe, &guidance))) {
        return NULL;
    }
    fill_probe(&probe, values);
    fill_guidance(&guidance, values + PROBE);
    found = probe.corners_found < CORNERS ? probe.corners_found : CORNERS;
    (*env)->SetFloatArrayRegion(env, corners, 0, (jsize)(2 * found), px);
    if ((*env)->ExceptionCheck(env)) {
        return NULL;
    }
    (*env)->SetDoubleArrayRegion(env, out, 0, PROBE + GUIDANCE, values);
    return (*env)->ExceptionCheck(env) ? NULL : texts(env, probe.advice, guidance.message);
}

static void session_guide_begin(JNIEnv *env, jclass class, jobject owner, jlong handle,
                                jfloatArray given)
{
    svbrdf_guide_options options;
    jfloat f[GUIDE_OPTIONS];

    (void)class, (void)owner;
    if (read_floats(env, given, GUIDE_OPTIONS, f)) {
        return;
    }
    svbrdf_guide_options_init(&options, sizeof options);
    options.worth = f[0];
    options.steady = f[1];
    options.steady_seconds = f[2];
    options.enough = f[3];
    options.least = (uint32_t)f[4];
    options.most = (uint32_t)f[5];
    options.first_tilt_deg = f[6];
    options.shot_seconds = f[7];
    throw_status(env, svbrdf_session_guide_begin(HANDLE(svbrdf_session, handle), &options));
}

const JNINativeMethod photo_methods[] = {
    METHOD("fileLookAt", "(" BUFFER "JJ[D[[B)V", file_look_at),
    METHOD("sessionGuide", "(" OWNER "J[I[" BUFFER "[J[FFIFJ[F[D)[[B", session_guide),
    METHOD("sessionGuideBegin", "(" OWNER "J[F)V", session_guide_begin),
    METHOD("sessionProbe", "(" OWNER "J[I[" BUFFER "[J[FFIF[F[D)[B", session_probe),
    METHOD("sessionAddPhoto", "(" OWNER "J[I[" BUFFER "[J[FFIJ[F[F[I[" BUFFER "[J[FFF[D)[B",
           session_add_photo),
    METHOD("sessionAddPhotoFile", "(" OWNER "J" BUFFER "JJFIIIJJJ[D[[B[D)[B", session_add_photo_file),
    METHOD("sessionAddPhotoAsync", "(" OWNER "J[I[" BUFFER "[J[FFIJ[I[" BUFFER "[J[FFFJ)V",
           session_add_photo_async),
};
const jint photo_method_count = COUNT(photo_methods);

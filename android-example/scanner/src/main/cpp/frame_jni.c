/* The method of Native.kt that hands a photo over. */
#include <string.h>

#include "boundary.h"

/* Lengths of the arrays that Native.kt hands over. */
enum { IMAGE_INTS = 7, PLANE_LONGS = 4, LEVELS = 18, REPORT = 24 };

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
        throw_status(env, status);
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

const JNINativeMethod frame_methods[] = {
    METHOD("sessionPush", "(" OWNER "J[I[" BUFFER "[J[FFIJ[F[F[I[" BUFFER "[J[FFF[D)[B",
           session_push),
};
const jint frame_method_count = COUNT(frame_methods);

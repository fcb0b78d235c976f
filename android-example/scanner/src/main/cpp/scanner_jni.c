/* The functions of Native.kt over svbrdf.h: registers them when the library is loaded. */
#include "boundary.h"

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

static void set_log(JNIEnv *env, jclass class, jboolean on)
{
    (void)class;
    throw_status(env, svbrdf_set_log_callback(on == JNI_TRUE ? call_library_log : NULL, NULL));
}

static void set_thread_hook(JNIEnv *env, jclass class, jboolean on)
{
    (void)class;
    throw_status(env, svbrdf_set_thread_hook(on == JNI_TRUE ? call_thread_start : NULL, NULL));
}

static jbyteArray board_print(JNIEnv *env, jclass class, jdoubleArray numbers,
                              jbyteArray dictionary, jint page, jint format)
{
    svbrdf_board board;
    svbrdf_buffer *buffer = NULL;
    const void *data = NULL;
    size_t bytes = 0;
    jbyte *held;
    jbyteArray out = NULL;
    (void)class;
    if (read_board(env, numbers, dictionary, &held, &board)) {
        return NULL;
    }
    if (!throw_status(env, svbrdf_board_print(&board, (svbrdf_page)page,
                                              (svbrdf_sheet_format)format, &buffer)) &&
        !throw_status(env, svbrdf_buffer_view(buffer, &data, &bytes))) {
        out = to_array(env, data, bytes);
    }
    svbrdf_buffer_destroy(buffer);
    if (held != NULL) {
        release_text(env, dictionary, held);
    }
    return out;
}

static const JNINativeMethod library_methods[] = {
    METHOD("version", "()[B", version),
    METHOD("features", "()J", features),
    METHOD("setLog", "(Z)V", set_log),
    METHOD("setThreadHook", "(Z)V", set_thread_hook),
    METHOD("boardPrint", "([D[BII)[B", board_print),
};

JNIEXPORT jint JNICALL JNI_OnLoad(JavaVM *java, void *reserved)
{
    void *pointer = NULL;
    JNIEnv *env;

    (void)reserved;
    if ((*java)->GetEnv(java, &pointer, JNI_VERSION_1_6) != JNI_OK) {
        return JNI_ERR;
    }
    env = pointer;
    /* Structs of another major version mean something else. */
    if (svbrdf_version_number() >> 16 != SVBRDF_VERSION_MAJOR) {
        return JNI_ERR;
    }
    if (boundary_load(env) || callbacks_load(java, env)) {
        return JNI_ERR;
    }
#define REGISTER(methods, count) ((*env)->RegisterNatives(env, native_class, methods, count))
    if (REGISTER(library_methods, COUNT(library_methods)) != JNI_OK ||
        REGISTER(session_methods, session_method_count) != JNI_OK ||
        REGISTER(photo_methods, photo_method_count) != JNI_OK ||
        REGISTER(maps_methods, maps_method_count) != JNI_OK) {
        return JNI_ERR;
    }
    return JNI_VERSION_1_6;
}

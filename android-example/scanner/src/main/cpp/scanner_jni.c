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

static const JNINativeMethod library_methods[] = {
    METHOD("version", "()[B", version),
    METHOD("features", "()J", features),
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
        REGISTER(frame_methods, frame_method_count) != JNI_OK ||
        REGISTER(maps_methods, maps_method_count) != JNI_OK) {
        return JNI_ERR;
    }
    return JNI_VERSION_1_6;
}

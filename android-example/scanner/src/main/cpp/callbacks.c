/* Callbacks. The library's threads are attached when they first call and detached at their end. */
#include <pthread.h>

#include "boundary.h"

static JavaVM *vm;
static jmethodID on_progress, on_maps, on_log, on_library_log, on_thread_start, on_pushed;
static pthread_key_t attached;

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

/* Native.kt handles exceptions of callbacks; this handles its own. */
static void dismiss(JNIEnv *env)
{
    if ((*env)->ExceptionCheck(env)) {
        (*env)->ExceptionDescribe(env);
        (*env)->ExceptionClear(env);
    }
}

void fill_progress(const svbrdf_progress *progress, jdouble out[PROGRESS])
{
    out[0] = progress->state;
    out[1] = progress->photos;
    out[2] = progress->settled;
    out[3] = (jdouble)progress->fraction;
    out[4] = (jdouble)progress->loss_before;
    out[5] = (jdouble)progress->loss;
    out[6] = (jdouble)progress->seconds_left;
    out[7] = (jdouble)progress->maps_revision;
    out[8] = progress->phase;
}

void call_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress)
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

void call_maps(void *user, svbrdf_session *session)
{
    JNIEnv *env = environment();
    (void)session;
    if (env != NULL) {
        (*env)->CallStaticVoidMethod(env, native_class, on_maps, (jlong)(intptr_t)user);
        dismiss(env);
    }
}

void call_log(void *user, svbrdf_log_level level, const char *message)
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

void call_library_log(void *user, svbrdf_log_level level, const char *message)
{
    jbyteArray text;
    JNIEnv *env = environment();
    (void)user;
    if (env == NULL) {
        return;
    }
    text = to_bytes(env, message);
    if (text != NULL) {
        (*env)->CallStaticVoidMethod(env, native_class, on_library_log, (jint)level, text);
    }
    dismiss(env);
    (*env)->DeleteLocalRef(env, text);
}

void call_thread_start(void *user, svbrdf_thread thread)
{
    JNIEnv *env = environment();
    (void)user;
    if (env != NULL) {
        (*env)->CallStaticVoidMethod(env, native_class, on_thread_start, (jint)thread);
        dismiss(env);
    }
}

void call_outcome(void *user, svbrdf_session *session, svbrdf_status status,
                 const svbrdf_photo_report *report)
{
    const int used = status == SVBRDF_OK || status == SVBRDF_REJECTED;
    const char *words = used ? report->advice : svbrdf_last_error_message();
    jdouble values[REPORT];
    jdoubleArray array;
    jbyteArray text;
    JNIEnv *env = environment();
    (void)session;
    if (env == NULL) {
        return;
    }
    array = (*env)->NewDoubleArray(env, REPORT);
    text = array == NULL ? NULL : to_bytes(env, words);
    if (text != NULL) {
        fill_report(report, values);
        (*env)->SetDoubleArrayRegion(env, array, 0, REPORT, values);
        (*env)->CallStaticVoidMethod(env, native_class, on_pushed, (jlong)(intptr_t)user,
                                     (jint)status, array, text);
    }
    dismiss(env);
    (*env)->DeleteLocalRef(env, text);
    (*env)->DeleteLocalRef(env, array);
}

int callbacks_load(JavaVM *java, JNIEnv *env)
{
    static const struct {
        jmethodID *method;
        const char *name, *signature;
    } methods[] = {
        {&on_progress, "onProgress", "(J[D)V"},
        {&on_maps, "onMaps", "(J)V"},
        {&on_log, "onLog", "(JI[B)V"},
        {&on_library_log, "onLibraryLog", "(I[B)V"},
        {&on_thread_start, "onThreadStart", "(I)V"},
        {&on_pushed, "onOutcome", "(JI[D[B)V"},
    };
    size_t i;
    vm = java;
    for (i = 0; i < sizeof methods / sizeof methods[0]; ++i) {
        *methods[i].method = (*env)->GetStaticMethodID(env, native_class, methods[i].name,
                                                       methods[i].signature);
        if (*methods[i].method == NULL) {
            return 1;
        }
    }
    return pthread_key_create(&attached, detach) != 0;
}

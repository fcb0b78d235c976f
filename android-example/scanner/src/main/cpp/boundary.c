/* Text, arrays and faults across the boundary. */
#include <string.h>

#include "boundary.h"

jclass native_class;
static jmethodID failure;

jbyteArray to_bytes(JNIEnv *env, const char *text)
{
    const jsize length = (jsize)strlen(text);
    const jbyteArray bytes = (*env)->NewByteArray(env, length);
    if (bytes != NULL) {
        (*env)->SetByteArrayRegion(env, bytes, 0, length, (const jbyte *)text);
    }
    return bytes;
}

jbyteArray to_array(JNIEnv *env, const void *data, size_t bytes)
{
    jbyteArray out;
    if (bytes > INT32_MAX) {
        throw_bad(env, "more bytes than an array may have");
        return NULL;
    }
    out = (*env)->NewByteArray(env, (jsize)bytes);
    if (out != NULL) {
        (*env)->SetByteArrayRegion(env, out, 0, (jsize)bytes, data);
    }
    return out;
}

static void throw_text(JNIEnv *env, svbrdf_status status, const char *text)
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

int throw_status(JNIEnv *env, svbrdf_status status)
{
    if (status == SVBRDF_OK) {
        return 0;
    }
    throw_text(env, status, svbrdf_last_error_message());
    return 1;
}

int throw_bad(JNIEnv *env, const char *text)
{
    throw_text(env, SVBRDF_INVALID_ARGUMENT, text);
    return 1;
}

#define READER(name, array_type, element, get)                                                   \
    int name(JNIEnv *env, array_type array, jsize expected, element *out)                        \
    {                                                                                            \
        if (array == NULL || (*env)->GetArrayLength(env, array) < expected) {                    \
            return throw_bad(env, "an array is missing or too short");                                 \
        }                                                                                        \
        (*env)->get(env, array, 0, expected, out);                                               \
        return 0;                                                                                \
    }
READER(read_ints, jintArray, jint, GetIntArrayRegion)
READER(read_longs, jlongArray, jlong, GetLongArrayRegion)
READER(read_floats, jfloatArray, jfloat, GetFloatArrayRegion)
READER(read_doubles, jdoubleArray, jdouble, GetDoubleArrayRegion)

const char *read_text(JNIEnv *env, jbyteArray text, jbyte **held)
{
    const jsize length = text == NULL ? 0 : (*env)->GetArrayLength(env, text);
    *held = length == 0 ? NULL : (*env)->GetByteArrayElements(env, text, NULL);
    if (*held == NULL || memchr(*held, 0, (size_t)length) != *held + length - 1) {
        if (*held != NULL) {
            (*env)->ReleaseByteArrayElements(env, text, *held, JNI_ABORT);
        }
        if (!(*env)->ExceptionCheck(env)) {
            throw_bad(env, "text is missing or has a NUL inside");
        }
        return NULL;
    }
    return (const char *)*held;
}

void release_text(JNIEnv *env, jbyteArray text, jbyte *held)
{
    (*env)->ReleaseByteArrayElements(env, text, held, JNI_ABORT);
}

void *direct_memory(JNIEnv *env, jobject buffer, jlong position, jlong bytes)
{
    jlong capacity;
    char *address = buffer == NULL ? NULL : (*env)->GetDirectBufferAddress(env, buffer);
    if (address == NULL) {
        throw_bad(env, "a buffer is missing or not direct");
        return NULL;
    }
    capacity = (*env)->GetDirectBufferCapacity(env, buffer);
    if (position < 0 || bytes < 0 || position > capacity || bytes > capacity - position) {
        throw_bad(env, "a buffer is smaller than stated");
        return NULL;
    }
    return address + position;
}

int boundary_load(JNIEnv *env)
{
    const jclass found = (*env)->FindClass(env, "org/svbrdf/scanner/Native");
    if (found == NULL) {
        return 1;
    }
    native_class = (*env)->NewGlobalRef(env, found);
    (*env)->DeleteLocalRef(env, found);
    if (native_class == NULL) {
        return 1;
    }
    failure = (*env)->GetStaticMethodID(env, native_class, "failure", "(I[B)Ljava/lang/Throwable;");
    return failure == NULL;
}

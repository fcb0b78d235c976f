/*
 * Helpers of the files of this library: text, arrays and faults across the boundary, callbacks.
 *
 * Handles cross as numbers: the library gives none out twice and answers stale ones with a status,
 * so nothing here can touch freed memory. `owner` arguments only keep the object that owns the
 * handle from being collected during the call. Text crosses as UTF-8 bytes, because JNI's own
 * string functions take and give another encoding. Failures are thrown as Native.failure() says.
 */
#ifndef SVBRDF_BOUNDARY_H
#define SVBRDF_BOUNDARY_H

#include <jni.h>
#include <stdint.h>
#include <string.h>

#include "svbrdf.h"

/* The class that the methods belong to; NULL until boundary_load() has found it. */
extern jclass native_class;

/* Finds the class and its factory of exceptions; 0, or 1 where they are missing. */
int boundary_load(JNIEnv *env);

/* Finds the methods that callbacks call; 0, or 1 where they are missing. */
int callbacks_load(JavaVM *java, JNIEnv *env);

jbyteArray to_bytes(JNIEnv *env, const char *text);
/* NULL and an exception where they are too many. */
jbyteArray to_array(JNIEnv *env, const void *data, size_t bytes);

/* Throws the fault of this thread's latest call; returns 0 if it succeeded. */
int throw_status(JNIEnv *env, svbrdf_status status);

/* Throws SVBRDF_INVALID_ARGUMENT; returns 1. */
int throw_bad(JNIEnv *env, const char *text);

/* Reading arrays: 1 and an exception when there are fewer elements than expected. */
int read_ints(JNIEnv *env, jintArray array, jsize expected, jint *out);
int read_longs(JNIEnv *env, jlongArray array, jsize expected, jlong *out);
int read_floats(JNIEnv *env, jfloatArray array, jsize expected, jfloat *out);
int read_doubles(JNIEnv *env, jdoubleArray array, jsize expected, jdouble *out);

/* UTF-8 with a NUL at its end, which Native.kt appends. Release with release_text(). */
const char *read_text(JNIEnv *env, jbyteArray text, jbyte **held);
void release_text(JNIEnv *env, jbyteArray text, jbyte *held);

/* Memory of a direct buffer from `position` on; NULL and an exception when it is not there. */
void *direct_memory(JNIEnv *env, jobject buffer, jlong position, jlong bytes);

/* Callbacks; `user` is the id by which Native.kt knows the session. */
enum { PROGRESS = 9 };
void fill_progress(const svbrdf_progress *progress, jdouble out[PROGRESS]);
void call_progress(void *user, svbrdf_session *session, const svbrdf_progress *progress);
void call_maps(void *user, svbrdf_session *session);
void call_log(void *user, svbrdf_log_level level, const char *message);
/* Of the library as a whole. */
void call_library_log(void *user, svbrdf_log_level level, const char *message);
void call_thread_start(void *user, svbrdf_thread thread);
/* A photo that was added without waiting; `user` is its id. */
enum { REPORT = 25 };
void fill_report(const svbrdf_photo_report *report, jdouble out[REPORT]);
void call_outcome(void *user, svbrdf_session *session, svbrdf_status status,
                 const svbrdf_photo_report *report);

/* A board as Native.kt hands it over: 1 and an exception when something is missing. Its dictionary, if
 * it has one, is to be released with release_text(). */
int read_board(JNIEnv *env, jdoubleArray array, jbyteArray dictionary, jbyte **held,
               svbrdf_board *board);

/* Methods by the file that has them, and how many. */
extern const JNINativeMethod session_methods[], photo_methods[], maps_methods[];
extern const jint session_method_count, photo_method_count, maps_method_count;

#define HANDLE(type, handle) ((type *)(uintptr_t)(handle))
#define OWNER "Ljava/lang/Object;"
#define BUFFER "Ljava/nio/ByteBuffer;"
#define METHOD(name, signature, function) {(char *)name, (char *)signature, (void *)function}
#define COUNT(methods) ((jint)(sizeof methods / sizeof methods[0]))

#endif

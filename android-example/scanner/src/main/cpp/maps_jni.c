/* Methods of Native.kt about maps and models. */
#include "boundary.h"

static void maps_size(JNIEnv *env, jclass class, jobject owner, jlong handle, jdoubleArray out)
{
    uint32_t width = 0, height = 0;
    float mm[2];
    jdouble values[4];
    (void)class, (void)owner;
    if (!throw_status(env, svbrdf_maps_size(HANDLE(svbrdf_maps, handle), &width, &height, mm))) {
        values[0] = width;
        values[1] = height;
        values[2] = (jdouble)mm[0];
        values[3] = (jdouble)mm[1];
        (*env)->SetDoubleArrayRegion(env, out, 0, 4, values);
    }
}

static jint maps_lobes(JNIEnv *env, jclass class, jobject owner, jlong handle)
{
    svbrdf_lobes lobes = 0;
    (void)class, (void)owner;
    throw_status(env, svbrdf_maps_lobes(HANDLE(svbrdf_maps, handle), &lobes));
    return (jint)lobes;
}

/* Maps of arrays in the order of MapValues.all(). */
static jlong maps_from_memory(JNIEnv *env, jclass class, jint width, jint height, jfloat width_mm,
                              jfloat height_mm, jobjectArray arrays)
{
    enum { MAPS = 8 };
    static const jlong channels[MAPS] = {3, 3, 3, 1, 3, 3, 3, 1};
    jfloatArray array[MAPS] = {NULL};
    jfloat *data[MAPS] = {NULL};
    svbrdf_maps_input input;
    svbrdf_maps *maps = NULL;
    int i, bad = 0;
    (void)class;
    for (i = 0; i < MAPS && !bad; i++) {
        array[i] = (*env)->GetObjectArrayElement(env, arrays, i);
        if (array[i] == NULL) {
            continue;
        }
        if ((*env)->GetArrayLength(env, array[i]) != channels[i] * width * height) {
            bad = throw_bad(env, "MapValues: width x height texels expected in every map");
        } else {
            data[i] = (*env)->GetFloatArrayElements(env, array[i], NULL);
            bad = data[i] == NULL;
        }
    }
    if (!bad) {
        svbrdf_maps_input_init(&input, sizeof input);
        input.width = (uint32_t)width;
        input.height = (uint32_t)height;
        input.sample_mm[0] = width_mm;
        input.sample_mm[1] = height_mm;
        input.normal = data[0];
        input.diffuse = data[1];
        input.specular = data[2];
        input.roughness = data[3];
        input.anisotropy = data[4];
        input.coat = data[5];
        input.sheen = data[6];
        input.sheen_roughness = data[7];
        throw_status(env, svbrdf_maps_from_memory(&input, &maps));
    }
    for (i = 0; i < MAPS; i++) {
        if (data[i] != NULL) {
            (*env)->ReleaseFloatArrayElements(env, array[i], data[i], JNI_ABORT);
        }
    }
    return (jlong)(uintptr_t)maps;
}

static void maps_copy(JNIEnv *env, jclass class, jobject owner, jlong handle, jint map, jint format,
                      jobject buffer, jlong bytes)
{
    void *data = direct_memory(env, buffer, 0, bytes);
    (void)class, (void)owner;
    if (data != NULL) {
        throw_status(env, svbrdf_maps_copy(HANDLE(svbrdf_maps, handle), (svbrdf_map)map,
                                    (svbrdf_map_format)format, data, (size_t)bytes, 0));
    }
}

static jlong maps_reduced(JNIEnv *env, jclass class, jobject owner, jlong handle, jint level)
{
    svbrdf_maps *small = NULL;
    (void)class, (void)owner;
    throw_status(env, svbrdf_maps_reduced(HANDLE(svbrdf_maps, handle), (uint32_t)level, &small));
    return (jlong)(uintptr_t)small;
}

/* Positions of camera and light, power, surround: three numbers each. */
static void maps_render(JNIEnv *env, jclass class, jobject owner, jlong handle, jfloatArray lighting,
                        jint falloff, jint format, jobject buffer, jlong bytes)
{
    enum { LIGHTING = 12 };
    svbrdf_render_options options;
    jfloat v[LIGHTING];
    void *data = direct_memory(env, buffer, 0, bytes);
    (void)class, (void)owner;
    if (data == NULL || read_floats(env, lighting, LIGHTING, v)) {
        return;
    }
    svbrdf_render_options_init(&options, sizeof options);
    memcpy(options.camera_mm, v, sizeof options.camera_mm);
    memcpy(options.light_mm, v + 3, sizeof options.light_mm);
    memcpy(options.light_power, v + 6, sizeof options.light_power);
    memcpy(options.ambient, v + 9, sizeof options.ambient);
    options.falloff = (svbrdf_falloff)falloff;
    throw_status(env, svbrdf_maps_render(HANDLE(svbrdf_maps, handle), &options,
                                         (svbrdf_map_format)format, data, (size_t)bytes, 0));
}

static void maps_uncertainty(JNIEnv *env, jclass class, jobject owner, jlong handle,
                            jdoubleArray out)
{
    svbrdf_uncertainty found;
    jdouble v[4];
    (void)class, (void)owner;
    svbrdf_uncertainty_init(&found, sizeof found);
    if (!throw_status(env, svbrdf_maps_uncertainty(HANDLE(svbrdf_maps, handle), &found))) {
        v[0] = (jdouble)found.normal;
        v[1] = (jdouble)found.diffuse;
        v[2] = (jdouble)found.specular;
        v[3] = (jdouble)found.roughness;
        (*env)->SetDoubleArrayRegion(env, out, 0, 4, v);
    }
}

static void maps_deviations(JNIEnv *env, jclass class, jobject owner, jlong handle, jint map,
                            jfloatArray out)
{
    svbrdf_map_view view;
    (void)class, (void)owner;
    svbrdf_map_view_init(&view, sizeof view);
    if (!throw_status(env, svbrdf_maps_deviations(HANDLE(svbrdf_maps, handle), (svbrdf_map)map,
                                                  &view))) {
        (*env)->SetFloatArrayRegion(env, out, 0, (jsize)(view.bytes / sizeof(jfloat)), view.data);
    }
}

static void maps_export(JNIEnv *env, jclass class, jobject owner, jlong handle, jbyteArray path)
{
    jbyte *held;
    const char *text = read_text(env, path, &held);
    (void)class, (void)owner;
    if (text != NULL) {
        throw_status(env, svbrdf_maps_export(HANDLE(svbrdf_maps, handle), NULL, text));
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
        throw_status(env, svbrdf_maps_export(HANDLE(svbrdf_maps, handle), &options, text));
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
    uint32_t i;
    for (i = 0; svbrdf_package_file(package, i, &name, &data, &bytes) == SVBRDF_OK; i++) {
        if (strcmp(name, wanted) == 0) {
            return to_array(env, data, bytes);
        }
    }
    throw_bad(env, "no such file in the export");
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
        if (!throw_status(env, svbrdf_maps_export_package(HANDLE(svbrdf_maps, handle), &options,
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
        data[i] = direct_memory(env, buffers[i], 0, 0);
        if (data[i] == NULL) {
            return 0;
        }
        bytes[i] = (size_t)(*env)->GetDirectBufferCapacity(env, buffers[i]);
    }
    throw_status(env, svbrdf_models_from_memory(data[0], bytes[0], data[1], bytes[1], data[2], bytes[2],
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
        throw_status(env, svbrdf_models_from_folder(text, &models));
        release_text(env, path, held);
    }
    return (jlong)(uintptr_t)models;
}

static void models_destroy(JNIEnv *env, jclass class, jlong handle)
{
    (void)env, (void)class;
    svbrdf_models_destroy(HANDLE(svbrdf_models, handle));
}

const JNINativeMethod maps_methods[] = {
    METHOD("mapsSize", "(" OWNER "J[D)V", maps_size),
    METHOD("mapsLobes", "(" OWNER "J)I", maps_lobes),
    METHOD("mapsFromMemory", "(IIFF[[F)J", maps_from_memory),
    METHOD("mapsCopy", "(" OWNER "JII" BUFFER "J)V", maps_copy),
    METHOD("mapsReduced", "(" OWNER "JI)J", maps_reduced),
    METHOD("mapsRender", "(" OWNER "J[FII" BUFFER "J)V", maps_render),
    METHOD("mapsUncertainty", "(" OWNER "J[D)V", maps_uncertainty),
    METHOD("mapsDeviations", "(" OWNER "JI[F)V", maps_deviations),
    METHOD("mapsExport", "(" OWNER "J[B)V", maps_export),
    METHOD("mapsExportFormats", "(" OWNER "J[B[BZZ)V", maps_export_formats),
    METHOD("mapsFile", "(" OWNER "J[B[B)[B", maps_file),
    METHOD("mapsDestroy", "(J)V", maps_destroy),
    METHOD("modelsFromMemory", "(" BUFFER BUFFER BUFFER BUFFER ")J", models_from_memory),
    METHOD("modelsFromFolder", "([B)J", models_from_folder),
    METHOD("modelsDestroy", "(J)V", models_destroy),
};
const jint maps_method_count = COUNT(maps_methods);

/* Loads the library, fits a photograph on several threads, unloads it, and lets the threads end afterwards: they run
 * destructors of the library's thread-local values, whose code has to be there. */
#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include "svbrdf.h"

enum { THREADS = 3 };

static void *library;
static sem_t called, unloaded;

static void *look_up(const char *name)
{
    void *found = dlsym(library, name);
    if (found == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        exit(1);
    }
    return found;
}

/* POSIX has functions fit into void *, C does not: through memory. */
#define GET(function)                                            \
    void *function##_at = look_up(#function);                    \
    __typeof__(&function) call_##function;                       \
    __builtin_memcpy(&call_##function, &function##_at, sizeof(void *))

#define CHECK(condition)                                                      \
    do {                                                                      \
        if (!(condition)) {                                                   \
            fprintf(stderr, "line %d: %s\n", __LINE__, #condition);          \
            exit(1);                                                          \
        }                                                                     \
    } while (0)

static void fit(const char *folder)
{
    GET(svbrdf_session_options_init);
    GET(svbrdf_session_create);
    GET(svbrdf_capture_open);
    GET(svbrdf_capture_destroy);
    GET(svbrdf_session_add_capture_photo);
    GET(svbrdf_budget_init);
    GET(svbrdf_session_set_budget);
    GET(svbrdf_session_wait);
    GET(svbrdf_session_destroy);
    svbrdf_session_options options;
    svbrdf_budget budget;
    svbrdf_capture *capture = NULL;
    svbrdf_session *session = NULL;
    CHECK(call_svbrdf_capture_open(folder, &capture) == SVBRDF_OK);
    CHECK(call_svbrdf_session_options_init(&options, sizeof options) == SVBRDF_OK);
    options.capture = capture;
    CHECK(call_svbrdf_session_create(&options, &session) == SVBRDF_OK);
    CHECK(call_svbrdf_budget_init(&budget, sizeof budget) == SVBRDF_OK);
    budget.max_steps = 2;
    CHECK(call_svbrdf_session_set_budget(session, &budget) == SVBRDF_OK);
    CHECK(call_svbrdf_session_add_capture_photo(session, capture, 0, NULL) == SVBRDF_OK);
    CHECK(call_svbrdf_session_wait(session, -1) == SVBRDF_OK);
    CHECK(call_svbrdf_session_destroy(session) == SVBRDF_OK);
    CHECK(call_svbrdf_capture_destroy(capture) == SVBRDF_OK);
}

static void *worker(void *folder)
{
    fit(folder);
    sem_post(&called);
    sem_wait(&unloaded);
    return NULL;
}

int main(int argc, char **argv)
{
    pthread_t threads[THREADS];
    int i;
    CHECK(argc == 3);
    library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    CHECK(library != NULL);
    sem_init(&called, 0, 0);
    sem_init(&unloaded, 0, 0);
    for (i = 0; i < THREADS; i++) {
        CHECK(pthread_create(&threads[i], NULL, worker, argv[2]) == 0);
    }
    for (i = 0; i < THREADS; i++) {
        sem_wait(&called);
    }
    CHECK(dlclose(library) == 0);
    for (i = 0; i < THREADS; i++) {
        sem_post(&unloaded);
    }
    for (i = 0; i < THREADS; i++) {
        CHECK(pthread_join(threads[i], NULL) == 0);
    }
    /* Now no thread holds it any more. glibc unloads what the threads held with the next dlclose(). */
    library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    CHECK(library != NULL && dlclose(library) == 0);
    library = dlopen(argv[1], RTLD_NOW | RTLD_NOLOAD);
    CHECK(library != NULL);
    fit(argv[2]);
    return 0;
}

/* Faults outside of the library: full disks, damaged models, sessions ended in mid-fit. */
#include "check.h"

#include <dirent.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

static unsigned char *read_all(const char *path, size_t *bytes)
{
    unsigned char *data;
    long end;
    FILE *file = fopen(path, "rb");
    CHECK(file != NULL && fseek(file, 0, SEEK_END) == 0);
    end = ftell(file);
    CHECK(end >= 0 && fseek(file, 0, SEEK_SET) == 0);
    *bytes = (size_t)end;
    data = malloc(*bytes + 1);
    CHECK(data != NULL && fread(data, 1, *bytes, file) == *bytes);
    fclose(file);
    return data;
}

static int files_in(const char *folder)
{
    int count = 0;
    struct dirent *entry;
    DIR *dir = opendir(folder);
    CHECK(dir != NULL);
    while ((entry = readdir(dir)) != NULL) {
        count += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
    }
    closedir(dir);
    return count;
}

/* Writes of more than so many bytes fail, as on a full disk. */
static void limit_files(rlim_t bytes)
{
    struct rlimit limit;
    CHECK(getrlimit(RLIMIT_FSIZE, &limit) == 0);
    limit.rlim_cur = bytes;
    CHECK(setrlimit(RLIMIT_FSIZE, &limit) == 0);
}

static void full_disk(const char *folder)
{
    char maps[4000], state[4096], normal[4096];
    unsigned char *before, *after;
    size_t bytes = 0, again = 0;
    int files;
    struct rlimit usual;
    svbrdf_session_options options;
    svbrdf_session *session = NULL;

    CHECK(snprintf(maps, sizeof maps, "%s/full", folder) < (int)sizeof maps);
    CHECK(snprintf(state, sizeof state, "%s/state", maps) < (int)sizeof state);
    CHECK(snprintf(normal, sizeof normal, "%s/normal.png", maps) < (int)sizeof normal);
    CHECK(getrlimit(RLIMIT_FSIZE, &usual) == 0);
    CHECK(signal(SIGXFSZ, SIG_IGN) != SIG_ERR);
    rectified_options(&options);
    OK(svbrdf_session_create(&options, &session));
    OK(svbrdf_session_pause(session));
    OK(push_gray(session, 100));
    export_maps(session, maps, SVBRDF_OK);
    OK(svbrdf_session_save_state_to(session, state));
    before = read_all(state, &bytes);
    files = files_in(maps);

    limit_files(1000);
    export_maps(session, maps, SVBRDF_IO);
    EXPECT(svbrdf_session_save_state_to(session, state), SVBRDF_IO);
    limit_files(usual.rlim_cur);

    /* The earlier files are still there, and no others. */
    CHECK(files_in(maps) == files);
    after = read_all(state, &again);
    CHECK(again == bytes && memcmp(before, after, bytes) == 0);
    free(before);
    free(after);
    before = read_all(normal, &bytes);
    CHECK(bytes > 1000 && memcmp(before, "\x89PNG", 4) == 0);
    free(before);
    /* The session has lost nothing. */
    export_maps(session, maps, SVBRDF_OK);
    OK(svbrdf_session_save_state_to(session, state));
    OK(svbrdf_session_destroy(session));
}

static void damaged_models(const char *folder)
{
    static const char *const names[4] = {"decoder.bin", "encoder.onnx", "photo.onnx",
                                          "completion.onnx"};
    unsigned char *data[4];
    size_t bytes[4], i, k;
    svbrdf_models *models = NULL;
    char path[4096];
    for (i = 0; i < 4; i++) {
        CHECK(snprintf(path, sizeof path, "%s/models/%s", folder, names[i]) < (int)sizeof path);
        data[i] = read_all(path, &bytes[i]);
    }
    for (i = 0; i < 4; i++) {
        const size_t cuts[] = {0, 1, 7, 8, 11, 12, 100, bytes[i] / 3, bytes[i] - 1};
        for (k = 0; k < sizeof cuts / sizeof cuts[0]; k++) {
            size_t cut[4];
            memcpy(cut, bytes, sizeof cut);
            cut[i] = cuts[k];
            EXPECT(svbrdf_models_from_memory(data[0], cut[0], data[1], cut[1], data[2], cut[2],
                                             data[3], cut[3], &models),
                   SVBRDF_BAD_MODEL);
        }
    }
    /* Files in each other's place. */
    EXPECT(svbrdf_models_from_memory(data[1], bytes[1], data[0], bytes[0], data[2], bytes[2],
                                     data[3], bytes[3], &models),
           SVBRDF_BAD_MODEL);
    /* Another version of the decoder's format. */
    data[0][7] = '9';
    EXPECT(svbrdf_models_from_memory(data[0], bytes[0], data[1], bytes[1], data[2], bytes[2],
                                     data[3], bytes[3], &models),
           SVBRDF_BAD_MODEL);
    CHECK(models == NULL);
    for (i = 0; i < 4; i++) {
        free(data[i]);
    }
}

static void *destroy_soon(void *session)
{
    usleep(100000);
    OK(svbrdf_session_destroy(session));
    return NULL;
}

/* Ended by one thread while another waits for the fit, saves, and changes the budget. */
static void ended_in_mid_fit(void)
{
    int round;
    for (round = 0; round < 4; round++) {
        svbrdf_session_options options;
        svbrdf_session *session = NULL;
        svbrdf_status status;
        pthread_t thread;
        rectified_options(&options);
        OK(svbrdf_session_create(&options, &session));
        if (round == 0) {
            OK(svbrdf_session_pause(session)); /* else it might settle before */
        }
        OK(push_gray(session, 100));
        CHECK(pthread_create(&thread, NULL, destroy_soon, session) == 0);
        if (round == 0) {
            status = svbrdf_session_wait(session, -1);
            CHECK(status == SVBRDF_CANCELLED || status == SVBRDF_INVALID_HANDLE);
        }
        do {
            svbrdf_buffer *buffer = NULL;
            svbrdf_budget budget;
            OK(svbrdf_budget_init(&budget, sizeof budget));
            budget.max_steps = 1000;
            (void)svbrdf_session_set_budget(session, &budget);
            status = svbrdf_session_save_state(session, &buffer);
            CHECK(status == SVBRDF_OK || status == SVBRDF_CANCELLED ||
                  status == SVBRDF_INVALID_HANDLE);
            OK(svbrdf_buffer_destroy(buffer));
        } while (status == SVBRDF_OK);
        CHECK(pthread_join(thread, NULL) == 0);
        EXPECT(svbrdf_session_wait(session, 0), SVBRDF_INVALID_HANDLE);
    }
}

void test_faults(const char *folder)
{
    full_disk(folder);
    damaged_models(folder);
    ended_in_mid_fit();
}

#include <stdio.h>
#include <svbrdf.h>

/* Begins and ends a session: the networks are read where they are inside. */
int main(void)
{
    svbrdf_session_options options;
    svbrdf_session *session = NULL;
    svbrdf_status expected = SVBRDF_OK;
    printf("svbrdf %s\n", svbrdf_version());
    if (!(svbrdf_features() & SVBRDF_FEATURE_EMBEDDED_MODELS)) {
        expected = SVBRDF_UNSUPPORTED;
    }
    svbrdf_session_options_init(&options, sizeof options);
    options.sample_mm[0] = options.sample_mm[1] = 100.0f;
    if (svbrdf_session_create(&options, &session) != expected) {
        fprintf(stderr, "%s\n", svbrdf_last_error_message());
        return 1;
    }
    svbrdf_session_destroy(session);
    return 0;
}

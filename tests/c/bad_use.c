// bad_use MODEL: what no caller should do, each with the status that it ends in.

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <granular_id.h>

static int n_wrong;

static void expect(gid_status wanted, gid_status status, const char *call) {
    if (status != wanted) {
        fprintf(stderr, "%s: wanted %d, got %d\n", call, wanted, status);
        ++n_wrong;
    }
}
#define EXPECT(wanted, call) expect(wanted, call, #call)

static gid_stream shared;

static void *push_often(void *rows) {
    for (int k = 0; k < 20000; ++k) {
        const gid_status status = gid_stream_push(shared, rows, 6);
        if (status != GID_BUSY && status != GID_FULL) { EXPECT(GID_OK, status); }
        if (status == GID_FULL) { gid_stream_reset(shared); }
    }
    return NULL;
}

int main(int argc, char **argv) {
    gid_model model, damaged;
    gid_stream stream, freed;
    gid_decision decision;
    gid_spec spec = gid_spec_default();
    double rows[12] = {0}, features[4];
    size_t n_features;
    char text[8];
    if (argc != 2) { return 2; }

    EXPECT(GID_NULL, gid_model_load(NULL, &model));
    EXPECT(GID_NULL, gid_model_load(argv[1], NULL));
    EXPECT(GID_FILE, gid_model_load("there is no such file", &model));
    EXPECT(GID_MODEL, gid_model_load(argv[0], &model));
    EXPECT(GID_OK, gid_model_load(argv[1], &model));

    FILE *file = fopen(argv[1], "rb");
    unsigned char *bytes = malloc(1 << 20);
    const size_t n_bytes = file && bytes ? fread(bytes, 1, 1 << 20, file) : 0;
    for (size_t k = 0; k < n_bytes; k += n_bytes / 50) {
        bytes[k] ^= 0x10;
        EXPECT(GID_MODEL, gid_model_load_bytes(bytes, n_bytes, &damaged));
        bytes[k] ^= 0x10;
        EXPECT(GID_MODEL, gid_model_load_bytes(bytes, k, &damaged));
    }
    free(bytes);
    if (file) { fclose(file); }

    EXPECT(GID_OK, gid_stream_new(model, &stream));
    EXPECT(GID_NULL, gid_stream_push(stream, NULL, 6));
    EXPECT(GID_NULL, gid_stream_push(stream, (const double *)((const char *)rows + 1), 6));
    EXPECT(GID_SIZE, gid_stream_push(stream, rows, 5));
    EXPECT(GID_SIZE, gid_stream_push(stream, rows, (size_t)-1));
    EXPECT(GID_NULL, gid_stream_decide(stream, NULL));
    EXPECT(GID_SIZE, gid_stream_losses(stream, rows, 1));
    EXPECT(GID_OK, gid_stream_decide(stream, &decision));
    if (gid_model_label(model, 1000000) != NULL || gid_last_error(text, sizeof text) < 8 || strlen(text) != 7) { ++n_wrong; }

    EXPECT(GID_NULL, gid_n_features(NULL, 6, &n_features));
    EXPECT(GID_SIZE, gid_extract(&spec, rows, 12, features, 4));
    spec.cutoff_hz = -1;
    EXPECT(GID_VALUE, gid_n_features(&spec, 6, &n_features));
    spec.n_axes = 0;
    EXPECT(GID_SIZE, gid_n_features(&spec, 6, &n_features));

    EXPECT(GID_OK, gid_stream_new(model, &freed));
    EXPECT(GID_OK, gid_stream_free(freed));
    EXPECT(GID_HANDLE, gid_stream_push(freed, rows, 6));
    EXPECT(GID_HANDLE, gid_stream_free(freed));
    memset(&freed, 0xff, sizeof freed);
    EXPECT(GID_HANDLE, gid_stream_decide(freed, &decision));
    EXPECT(GID_OK, gid_model_free(model));
    EXPECT(GID_HANDLE, gid_model_free(model));
    EXPECT(GID_HANDLE, gid_stream_new(model, &freed));

    pthread_t other;
    shared = stream;
    if (pthread_create(&other, NULL, push_often, rows) != 0) { return 2; }
    push_often(rows);
    pthread_join(other, NULL);
    EXPECT(GID_OK, gid_stream_free(stream));
    return n_wrong != 0;
}

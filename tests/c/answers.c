// answers MODEL RECORDINGS: a line for each recording of a file of doubles: label, unknown, candidates, then the bits of loss,
// margin and every mean loss, then the probability.

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <granular_id.h>

static void print_bits(double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    printf(" %016" PRIx64, bits);
}

static int fail(void) {
    char text[1024];
    gid_last_error(text, sizeof text);
    fprintf(stderr, "%s\n", text);
    return 1;
}

int main(int argc, char **argv) {
    gid_model model;
    gid_stream stream;
    gid_model_info info;
    gid_decision decision;
    double losses[1024];
    if (argc != 3 || gid_model_load(argv[1], &model) || gid_model_get_info(model, &info) || gid_stream_new(model, &stream)) {
        return fail();
    }
    FILE *file = fopen(argv[2], "rb");
    const size_t n = info.n_samples * info.n_axes;
    double *rows = malloc(n * sizeof *rows);
    for (size_t block = 1; file && rows && fread(rows, sizeof *rows, n, file) == n; ++block) {
        for (size_t k = 0; k < n; k += block * info.n_axes) {
            const size_t left = n - k, most = block * info.n_axes;
            if (gid_stream_push(stream, rows + k, left < most ? left : most)) { return fail(); }
        }
        if (gid_stream_decide(stream, &decision) || gid_stream_losses(stream, losses, info.n_classes)) { return fail(); }
        printf("%s %d ", gid_model_label(model, decision.label), decision.unknown);
        for (size_t k = 0; k < info.n_classes; ++k) { putchar('0' + (decision.candidates[k / 8] >> (k % 8) & 1)); }
        print_bits(decision.loss);
        print_bits(decision.margin);
        for (size_t k = 0; k < info.n_classes; ++k) { print_bits(losses[k]); }
        printf(" %.17g\n", decision.probability);
        if (gid_stream_reset(stream)) { return fail(); }
    }
    free(rows);
    if (file) { fclose(file); }
    return gid_stream_free(stream) || gid_model_free(model);
}

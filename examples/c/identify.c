// Names the material of a recording with C alone: CSV on standard input, a line with the answer on standard output.
//
//     cc identify.c -o identify $(pkg-config --cflags --libs granular_id)
//     ./identify kitchen.safetensors < push.csv
//
// The first line of the CSV names columns; those with the names of the model's axes (fx ... tz, in its units: N and N m) are
// used, in any order. A line is a row; there must be a window of them at the rate of the model, the rest before the push
// included.

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <granular_id.h>

enum { MOST_AXES = 256, LINE_BYTES = 65536 };

static size_t n_lines; // read so far

static int fail(const char *what) {
    fprintf(stderr, "identify: ");
    if (n_lines > 0) { fprintf(stderr, "line %zu: ", n_lines); }
    fprintf(stderr, "%s\n", what);
    return 1;
}

static int fail_with_last_error(void) {
    char text[1024];
    gid_last_error(text, sizeof text);
    return fail(text);
}

// Cuts a line at its commas: returns the cell, without blanks around it, and goes on to the next; null after the last.
static char *next_cell(char **rest) {
    char *cell = *rest, *end;
    if (cell == NULL) { return NULL; }
    end = cell + strcspn(cell, ",\r\n");
    *rest = *end == ',' ? end + 1 : NULL;
    *end = '\0';
    while (isspace((unsigned char)*cell)) { ++cell; }
    while (end > cell && isspace((unsigned char)end[-1])) { *--end = '\0'; }
    return cell;
}

// Which column each axis of the model is in: zero if one has none, or two.
static int find_columns(gid_model model, size_t n_axes, char *header, size_t *columns) {
    size_t column = 0, n_found = 0;
    int found[MOST_AXES] = {0};
    for (char *name; (name = next_cell(&header)) != NULL; ++column) {
        for (size_t axis = 0; axis < n_axes; ++axis) {
            if (strcmp(name, gid_model_axis(model, axis)) == 0) {
                if (found[axis]) { return 0; }
                found[axis] = 1;
                columns[axis] = column;
                ++n_found;
            }
        }
    }
    return n_found == n_axes;
}

static int read_row(char *line, size_t n_axes, const size_t *columns, double *row) {
    size_t column = 0, found = 0;
    for (char *cell; (cell = next_cell(&line)) != NULL; ++column) {
        for (size_t axis = 0; axis < n_axes; ++axis) {
            if (columns[axis] == column) {
                char *end;
                row[axis] = strtod(cell, &end);
                found += end != cell && *end == '\0';
            }
        }
    }
    return found == n_axes;
}

static void print_answer(gid_model model, size_t n_classes, const gid_decision *decision) {
    printf("%s%s, margin %.4f", decision->unknown == 1 ? "like no known material, nearest " : "",
           gid_model_label(model, decision->label), decision->margin);
    if (decision->probability >= 0) { printf(", probability %.3f", decision->probability); }
    const char *between = "; may be ";
    for (size_t k = 0; k < n_classes; ++k) {
        if (decision->candidates[k / 8] >> (k % 8) & 1) {
            printf("%s%s", between, gid_model_label(model, k));
            between = " or ";
        }
    }
    putchar('\n');
}

int main(int argc, char **argv) {
    static char line[LINE_BYTES];
    gid_model model;
    gid_stream stream;
    gid_model_info info;
    gid_decision decision;
    size_t columns[MOST_AXES];
    double row[MOST_AXES];

    if (argc != 2) { return fail("usage: identify MODEL.safetensors < PUSH.csv"); }
    if (gid_model_load(argv[1], &model) || gid_model_get_info(model, &info) || gid_stream_new(model, &stream)) {
        return fail_with_last_error();
    }
    if (info.synthetic) { puts("SYNTHETIC: simulated recordings trained this model"); }
    if (!fgets(line, sizeof line, stdin) || !find_columns(model, info.n_axes, line, columns)) {
        return fail("the first line must name one column for each axis of the model");
    }
    for (n_lines = 1; fgets(line, sizeof line, stdin);) {
        ++n_lines;
        if (!read_row(line, info.n_axes, columns, row)) { return fail("a line does not hold a number for each axis"); }
        switch (gid_stream_push(stream, row, info.n_axes)) {
        case GID_OK: break;
        case GID_FULL: return fail("there are more rows than a window of the model has");
        default: return fail_with_last_error();
        }
    }
    if (gid_stream_decide(stream, &decision)) { return fail_with_last_error(); }
    if (!decision.is_final) { return fail("there are fewer rows than a window of the model has"); }
    print_answer(model, info.n_classes, &decision);
    gid_stream_free(stream);
    gid_model_free(model);
    return 0;
}

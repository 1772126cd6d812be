// granular_id: names the granular material under a robot's tool from force-torque signals.
// SPDX-License-Identifier: MIT OR Apache-2.0
//
// A model is loaded from a file. A stream takes rows, one value per axis, and decides:
//
//     if (gid_model_load("kitchen.safetensors", &model) || gid_model_get_info(model, &info) ||
//         gid_stream_new(model, &stream) || info.n_axes != 6) { ... gid_last_error ... }
//     gid_stream_push(stream, lead, n_lead * 6); // at the onset: the newest rows of rest, info.lead_s * info.rate_hz of them
//     gid_stream_push(stream, row, 6);           // then each 2 ms a row, until there are info.n_samples
//     gid_stream_decide(stream, &decision);      // an index: gid_model_label(model, k) before the loop or behind it
//
// Pointers lead to as many values as the length beside them says; arrays of one call do not overlap. Null, misaligned
// pointers, lengths that do not fit and handles that were freed are refused. What no check can see: a pointer to freed
// memory, or a length that is larger than the array.
//
// Threads: every function may be called from every thread. One stream is for one thread at a time: while a call on it runs,
// another thread's ends at once with GID_BUSY and changes nothing. Different streams do not wait for each other, and a
// model serves any number of them. gid_last_error is of the calling thread. Strings of a model end with gid_model_free: no
// other thread may still read them. After fork, a child must not use what another thread was using, nor any model if one was
// being loaded or freed.
//
// Real-time: gid_stream_push, _decide, _losses and _reset, and gid_last_error, allocate nothing and take no lock, also when they
// fail; all others belong before the loop or behind it. Before the loop, lock the memory (mlockall), push a window of zeros,
// decide and reset: pages are mapped then. If the library came by dlopen, call gid_last_error once in the thread of the loop: the
// memory of its sentences is allocated then.
//
// Floating point: labels, losses, margins and candidates have the bits of the Python package in the default environment of IEEE
// 754; a probability may differ in its last digits. A program that rounds otherwise, or flushes subnormal numbers to zero (gcc
// -ffast-math when it links), gets others.
//
// This file is generated from rust/c: do not edit it.

#ifndef GRANULAR_ID_H
#define GRANULAR_ID_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// The most streams at a time in a process.
#define GID_MAX_STREAMS 256

// Bytes of the candidates of a decision: a bit for each class, of which a model has at most 1024.
#define GID_CANDIDATE_BYTES 128

// How a call ended. Other values than 0 and 1 are errors: nothing has changed, nothing was written (but by `gid_extract`),
// and `gid_last_error` has a sentence about it.
typedef enum {
    // Done.
    GID_OK = 0,
    // No error: the window was complete before the last of the rows, which were not taken.
    GID_FULL = 1,
    // A pointer is null, or not aligned for its type.
    GID_NULL = 2,
    // A length that does not fit the others, or an index beyond the end.
    GID_SIZE = 3,
    // A value that nothing can be done with: NaN, infinity, too large, outside its range.
    GID_VALUE = 4,
    // A handle that was freed, or never made.
    GID_HANDLE = 5,
    // Another thread is in a call on this stream.
    GID_BUSY = 6,
    // A file that cannot be read.
    GID_FILE = 7,
    // Bytes that are no model: damaged, cut off, of another version, or something else.
    GID_MODEL = 8,
    // No memory, or `GID_MAX_STREAMS` streams are there.
    GID_MEMORY = 9,
    // A bug in this library. Free the handles of the call.
    GID_PANIC = 10,
} gid_status;

// What to compute from a recording. Make it by `gid_spec_default`, then change what differs; bytes are true unless 0.
typedef struct {
    // Values of a row.
    size_t n_axes;
    // Rows in a second.
    double rate_hz;
    // Cut-off of the Butterworth high-pass before the histogram.
    double cutoff_hz;
    // Order of the high-pass, 1 to 32.
    size_t order;
    // Bins of each histogram.
    size_t n_bins;
    // Low and high end of the histograms in N and N m: one pair for all axes, or one for each.
    const double *bin_ranges;
    // Pairs in `bin_ranges`.
    size_t n_bin_ranges;
    // Count values outside the range in the first and last bin; else not at all.
    uint8_t clip;
    // Densities that integrate to one instead of counts.
    uint8_t density;
    // Begin the filter as if the first row had lasted for ever; else at rest.
    uint8_t steady;
    // Include the samples.
    uint8_t raw;
    // Include the histograms.
    uint8_t hfmh;
} gid_spec;

// A model that was loaded. Number 0 is never one.
typedef struct {
    // Its number.
    uint64_t id;
} gid_model;

// What recordings a model is for, and what it names.
typedef struct {
    // Labels: K.
    size_t n_classes;
    // Values of a row.
    size_t n_axes;
    // Rows of a window.
    size_t n_samples;
    // Rows in a second.
    double rate_hz;
    // Seconds of rest before the onset with which each recording of the training begins; NaN where they do not say, or
    // differ. A window begins with the rows of this rest.
    double lead_s;
    // Whether simulated recordings trained it: its answers say nothing about real materials.
    bool synthetic;
} gid_model_info;

// A stream of rows through a model. Number 0 is never one.
typedef struct {
    // Its number.
    uint64_t id;
} gid_stream;

// What a model says of the rows so far.
typedef struct {
    // Index, as of `gid_model_label`, of the class with the smallest mean loss; the first of equal ones.
    size_t label;
    // Its mean loss: the value by which classes are ranked.
    double loss;
    // By how much the second mean loss is larger.
    double margin;
    // Probability of the label; NaN before the window is complete, and of a model without probabilities.
    double probability;
    // Rows of the window so far.
    size_t n_seen;
    // The classes that it may be: of class k bit `k % 8` of byte `k / 8`. None before the window is complete, and of a model
    // without such a rule.
    uint8_t candidates[GID_CANDIDATE_BYTES];
    // 1 if it is like no class: the label is then the nearest of the wrong ones. 0 if not, -1 before the window is complete,
    // and of a model without such a rule.
    int8_t unknown;
    // Whether the window is complete.
    bool is_final;
    // Whether the margin meets the model's rule for early answers.
    bool is_sure;
} gid_decision;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The version of this library, "0.1.0".
const char *gid_version(void);

// Copies the sentence about the last error of this thread, UTF-8, at most `n` bytes with the final zero; empty before the first
// error. Returns its length without the zero: where that is `n` or more, it was cut. `text` may be null if `n` is 0.
size_t gid_last_error(char *text, size_t n);

// The paper's features: six axes at 500 Hz, samples and histograms above 23 Hz.
gid_spec gid_spec_default(void);

// How many features `gid_extract` writes for a recording of `n` values.
gid_status gid_n_features(const gid_spec *spec, size_t n, size_t *n_features);

// Features of a recording of `n` values, row by row, into `features`, which has room for `n_features`: samples axis by axis,
// then the histograms. On an error they hold unspecified numbers. Not for a real-time loop: it designs the filter, and
// allocates.
gid_status gid_extract(const gid_spec *spec, const double *rows, size_t n, double *features, size_t n_features);

// Reads a model from a file of at most 32 MiB, as `Identifier.save` writes it. `path` is a zero-terminated string: UTF-8 on
// Windows, any bytes elsewhere.
gid_status gid_model_load(const char *path, gid_model *model);

// Reads a model from the `n` bytes of a file, at most 32 MiB.
gid_status gid_model_load_bytes(const uint8_t *bytes, size_t n, gid_model *model);

// Frees a model and its strings. Streams made with it go on.
gid_status gid_model_free(gid_model model);

// What recordings a model is for, and how many labels it has.
gid_status gid_model_get_info(gid_model model, gid_model_info *info);

// Label `k`, UTF-8, until the model is freed. Null on an error. Not for a real-time loop: it takes a lock.
const char *gid_model_label(gid_model model, size_t k);

// Name of axis `k`, likewise.
const char *gid_model_axis(gid_model model, size_t k);

// Unit of axis `k`, likewise; empty where the training did not know it.
const char *gid_model_unit(gid_model model, size_t k);

// Makes a stream before its first row, and all the memory that it will need.
gid_status gid_stream_new(gid_model model, gid_stream *stream);

// Frees a stream; not while another thread is in a call on it: that is `GID_BUSY`, and the stream stays.
gid_status gid_stream_free(gid_stream stream);

// Takes rows, `n` values in all, each row a value per axis in the units of the model, until the window is complete. `GID_FULL`
// if rows are left then: the last row of the window still gives `GID_OK`, so count rows to `n_samples`. Real-time: allocates
// nothing, takes no lock, and the work is bounded for each row.
//
// `n` must be a multiple of the model's `n_axes`: six values are two rows of a model of three axes. NaN, infinity and values too
// large to compute with are refused, and with them all rows of the call; the sentence counts rows from the first of the call.
gid_status gid_stream_push(gid_stream stream, const double *rows, size_t n);

// Decides from the rows so far, provisionally before the window is complete: before the first row the label says nothing about
// the push. Real-time: allocates nothing and takes no lock; the work is that of a label, with multi-band features that of all
// features.
gid_status gid_stream_decide(gid_stream stream, gid_decision *decision);

// The mean loss of each class into `losses`, which has room for `n` values, as many as there are classes. Real-time as
// `gid_stream_decide`.
gid_status gid_stream_losses(gid_stream stream, double *losses, size_t n);

// Back to the state before the first row. Real-time as `gid_stream_push`.
gid_status gid_stream_reset(gid_stream stream);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GRANULAR_ID_H */

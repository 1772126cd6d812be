// granular_id for C++17, over granular_id.h, whose rules for threads and real-time loops hold here, too.
// SPDX-License-Identifier: MIT OR Apache-2.0
//
//     const granular_id::Model model("kitchen.safetensors");    // throws granular_id::Error
//     granular_id::Stream stream(model);                        // throws granular_id::Error
//     granular_id::Decision decision;
//     // In the loop, where nothing throws; n_seen counts rows, from those of the rest before the onset on:
//     if (stream.push(row) == GID_OK && ++n_seen == model.info().n_samples) {
//         if (stream.decide(decision) == GID_OK) { act_on(decision.label); } // model.label takes a lock, last_error allocates
//         stream.reset();
//     }
#ifndef GRANULAR_ID_HPP
#define GRANULAR_ID_HPP

#if __cplusplus < 201703L && !(defined(_MSVC_LANG) && _MSVC_LANG >= 201703L)
#error "granular_id.hpp needs C++17: -std=c++17 or later"
#endif

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "granular_id.h"

namespace granular_id {

// The sentence about the last error of this thread.
inline std::string last_error() {
    std::string text(gid_last_error(nullptr, 0), '\0');
    gid_last_error(text.data(), text.size() + 1);
    return text;
}

// Why a call failed.
class Error : public std::runtime_error {
public:
    explicit Error(gid_status status) : std::runtime_error(last_error()), status_(status) {}
    [[nodiscard]] gid_status status() const noexcept { return status_; }

private:
    gid_status status_;
};

// Throws if a call failed: for calls outside a real-time loop.
inline void check(gid_status status) {
    if (status > GID_FULL) { throw Error(status); }
}

// A view of values that somebody else owns: of an array, or of whatever has data() and size().
template <class T> class View {
public:
    constexpr View(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
    template <std::size_t n> constexpr View(T (&values)[n]) noexcept : View(values, n) {}
    template <class Values, class = std::enable_if_t<std::is_convertible_v<
                                decltype(std::declval<Values &>().data()), T *>>>
    constexpr View(Values &&values) noexcept : View(values.data(), values.size()) {}
    [[nodiscard]] constexpr T *data() const noexcept { return data_; }
    [[nodiscard]] constexpr std::size_t size() const noexcept { return size_; }

private:
    T *data_;
    std::size_t size_;
};

// What a model says of the rows so far.
struct Decision : gid_decision {
    Decision() noexcept : gid_decision() {}
    // Whether it may be class k; of a complete window.
    [[nodiscard]] bool may_be(std::size_t k) const noexcept {
        return k < 8 * GID_CANDIDATE_BYTES && (candidates[k / 8] >> (k % 8) & 1) != 0;
    }
};

// A handle that frees itself. It can be moved, not copied.
template <class Handle, gid_status (*free_handle)(Handle)> class Owned {
public:
    Owned(Owned &&other) noexcept : handle_(std::exchange(other.handle_, Handle{})) {}
    Owned &operator=(Owned &&other) noexcept {
        Owned taken(std::move(other)); // frees what was here
        std::swap(handle_, taken.handle_);
        return *this;
    }
    Owned(const Owned &) = delete;
    Owned &operator=(const Owned &) = delete;
    // Of the C functions; zero once it was moved from.
    [[nodiscard]] Handle handle() const noexcept { return handle_; }

protected:
    Owned() noexcept = default;
    ~Owned() {
        if (handle_.id != 0) { free_handle(handle_); }
    }
    Handle handle_{};
};

// A trained model, shared by any number of streams and threads.
class Model : public Owned<gid_model, gid_model_free> {
public:
    // From a file.
    explicit Model(const std::string &path) : Model(path.c_str()) {}
    explicit Model(const char *path) {
        check(gid_model_load(path, &handle_));
        finish();
    }
    // From the bytes of a file.
    explicit Model(View<const std::uint8_t> bytes) {
        check(gid_model_load_bytes(bytes.data(), bytes.size(), &handle_));
        finish();
    }
    // Numbers of labels, of axes and of rows of a window; rate; rest before the onset; whether simulated recordings trained it.
    [[nodiscard]] const gid_model_info &info() const noexcept { return info_; }
    // Label k, name and unit of axis k, until the model ends; empty beyond the last.
    [[nodiscard]] std::string_view label(std::size_t k) const noexcept { return text(gid_model_label(handle_, k)); }
    [[nodiscard]] std::string_view axis(std::size_t k) const noexcept { return text(gid_model_axis(handle_, k)); }
    [[nodiscard]] std::string_view unit(std::size_t k) const noexcept { return text(gid_model_unit(handle_, k)); }

private:
    void finish() { check(gid_model_get_info(handle_, &info_)); }
    static std::string_view text(const char *found) noexcept { return found ? found : std::string_view(); }
    gid_model_info info_{};
};

// Rows in, decisions out, for one thread at a time. It goes on when its model has ended. Join the
// threads that call it before it ends: where one is in a call then, the stream is not freed, and stays one of GID_MAX_STREAMS.
class Stream : public Owned<gid_stream, gid_stream_free> {
public:
    explicit Stream(const Model &model) { check(gid_stream_new(model.handle(), &handle_)); }
    // Takes rows, a value per axis each, until the window is complete; GID_FULL if rows are left. Any multiple of n_axes fits.
    [[nodiscard]] gid_status push(View<const double> rows) noexcept {
        return gid_stream_push(handle_, rows.data(), rows.size());
    }
    // Decides from the rows so far.
    [[nodiscard]] gid_status decide(Decision &decision) noexcept { return gid_stream_decide(handle_, &decision); }
    // The mean loss of each class.
    [[nodiscard]] gid_status losses(View<double> losses) noexcept {
        return gid_stream_losses(handle_, losses.data(), losses.size());
    }
    // Back to the state before the first row.
    gid_status reset() noexcept { return gid_stream_reset(handle_); }
};

// Features of a recording, as gid_extract.
[[nodiscard]] inline gid_status extract(const gid_spec &spec, View<const double> rows, View<double> features) noexcept {
    return gid_extract(&spec, rows.data(), rows.size(), features.data(), features.size());
}

// How many features that are for a recording of n values; 0 on an error.
[[nodiscard]] inline std::size_t n_features(const gid_spec &spec, std::size_t n) noexcept {
    std::size_t found = 0;
    gid_n_features(&spec, n, &found);
    return found;
}

} // namespace granular_id

#endif

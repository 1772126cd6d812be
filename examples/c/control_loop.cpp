// A control loop that names the material while it pushes: a row from a fake sensor each 2 ms, a decision when the window is
// complete, and how near to the deadline that came. A window begins with rest, as the recordings of the training do: the loop
// holds the newest rows, and hands them over at the onset.
//
//     c++ -std=c++17 control_loop.cpp -o control_loop $(pkg-config --cflags --libs granular_id) -pthread
//     ./control_loop kitchen.safetensors [SECONDS [RATE_HZ]]      # as root: chrt -f 80 ./control_loop ...

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include <granular_id.hpp>

#if defined(__linux__)
#include <sys/mman.h>
#endif

using Clock = std::chrono::steady_clock;

namespace {

// Stands for the driver of a sensor and for the command to the arm: rests, then pushes with a rattle, over and over.
class FakeSensor {
public:
    FakeSensor(std::size_t n_rest, std::size_t n_push) : n_rest_(n_rest), n_cycle_(n_rest + n_push) {}
    // The next row; true while the tool moves.
    bool read(std::vector<double> &row) noexcept {
        const bool moves = n_ % n_cycle_ >= n_rest_;
        for (std::size_t axis = 0; axis < row.size(); ++axis) {
            state_ = 6364136223846793005U * state_ + 1442695040888963407U;
            const double noise = static_cast<double>(state_ >> 11) / 4503599627370496.0 - 1.0;
            const double slow = std::sin(1e-3 * static_cast<double>(n_) + static_cast<double>(axis));
            row[axis] = moves ? slow + 0.5 * noise : 0.01 * noise;
        }
        ++n_;
        return moves;
    }

private:
    std::size_t n_rest_, n_cycle_;
    std::uint64_t state_ = 1, n_ = 0;
};

// The newest rows, in memory that is there before the loop.
class Newest {
public:
    Newest(std::size_t n_rows, std::size_t n_axes) : values_(n_rows * n_axes) {}
    void add(const std::vector<double> &row) noexcept {
        for (std::size_t axis = 0; axis < row.size() && !values_.empty(); ++axis) {
            values_[next_] = row[axis];
            next_ = (next_ + 1) % values_.size();
        }
    }
    // All of them into a stream, the oldest first.
    [[nodiscard]] gid_status push_to(granular_id::Stream &stream) const noexcept {
        const gid_status status = stream.push({values_.data() + next_, values_.size() - next_});
        return status == GID_OK ? stream.push({values_.data(), next_}) : status;
    }

private:
    std::vector<double> values_;
    std::size_t next_ = 0;
};

// Times of calls, in memory that is there before the loop.
class Times {
public:
    explicit Times(std::size_t n) { all_.reserve(n); }
    void add(Clock::duration time) noexcept {
        if (all_.size() < all_.capacity()) { all_.push_back(std::chrono::duration<double, std::micro>(time).count()); }
    }
    void print(const char *what) {
        if (all_.empty()) { return; }
        std::sort(all_.begin(), all_.end());
        const auto last = static_cast<double>(all_.size() - 1);
        const auto at = [this, last](double share) { return all_[static_cast<std::size_t>(share * last)]; };
        std::printf("%s: %zu, median %.2f us, p99.9 %.2f us, worst %.2f us\n", what, all_.size(), at(0.5), at(0.999), at(1));
    }

private:
    std::vector<double> all_;
};

int fail(const std::string &what) {
    std::fprintf(stderr, "control_loop: %s\n", what.c_str());
    return EXIT_FAILURE;
}

} // namespace

int main(int argc, char **argv) try {
    if (argc < 2) {
        std::fprintf(stderr, "usage: control_loop MODEL.safetensors [SECONDS [RATE_HZ]]\n");
        return 2;
    }
    const granular_id::Model model(argv[1]);
    const gid_model_info info = model.info();
    granular_id::Stream stream(model);
    const double seconds = argc > 2 ? std::atof(argv[2]) : 10.0, rate_hz = argc > 3 ? std::atof(argv[3]) : info.rate_hz;
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz));
    const auto n_rows = static_cast<std::size_t>(seconds * rate_hz);
    // Where the model does not say: the rest with which your recordings begin.
    const double lead_s = std::isnan(info.lead_s) ? 0.25 : info.lead_s;
    const std::size_t n_lead = std::min(static_cast<std::size_t>(std::lround(lead_s * info.rate_hz)), info.n_samples - 1);
    Newest newest(n_lead, info.n_axes);
    FakeSensor sensor(n_lead + 50, info.n_samples - n_lead);
    Times onsets(n_rows / info.n_samples + 1), pushes(n_rows), decisions(n_rows / info.n_samples + 1);
    std::vector<double> row(info.n_axes);
    granular_id::Decision decision;
    std::size_t n_late = 0, n_seen = 0;
    bool has_moved = false;

    // Memory that is touched before the loop is not mapped within it.
#if defined(__linux__)
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) { std::perror("memory is not locked"); }
#endif
    for (std::size_t k = 0; k < info.n_samples; ++k) { granular_id::check(stream.push(row)); }
    granular_id::check(stream.decide(decision));
    stream.reset();
    decision = {};

    auto deadline = Clock::now();
    for (std::size_t k = 0; k < n_rows; ++k) {
        std::this_thread::sleep_until(deadline);
        deadline += period;
        const bool moves = sensor.read(row), starts = moves && !has_moved;
        has_moved = moves;
        const auto begin = Clock::now();
        gid_status status = GID_OK;
        if (starts) {
            status = newest.push_to(stream);
            n_seen = n_lead;
        }
        if (status == GID_OK && (starts || n_seen > 0)) {
            status = stream.push(row);
            ++n_seen;
        }
        // A controller would drop this push (reset) and go on.
        if (status != GID_OK) { return fail(granular_id::last_error()); }
        auto end = Clock::now();
        if (n_seen > 0) { (starts ? onsets : pushes).add(end - begin); }
        if (n_seen == info.n_samples) {
            if (stream.decide(decision) != GID_OK) { return fail(granular_id::last_error()); }
            stream.reset(); // here a controller would act on the decision, then wait for the next push
            n_seen = 0;
            const auto decided = Clock::now();
            decisions.add(decided - end);
            end = decided;
        }
        newest.add(row);
        n_late += end > deadline;
    }

    onsets.print("onsets");
    pushes.print("pushes");
    decisions.print("decisions");
    std::printf("deadlines missed: %zu of %zu\n", n_late, n_rows);
    if (!decision.is_final) {
        std::puts("no push was complete");
        return EXIT_SUCCESS;
    }
    const auto label = model.label(decision.label);
    const char *unknown = decision.unknown == 1 ? "unknown, nearest " : "";
    std::printf("last push: %s%.*s, margin %.6f\n", unknown, static_cast<int>(label.size()), label.data(), decision.margin);
    return EXIT_SUCCESS;
} catch (const granular_id::Error &error) {
    return fail(error.what());
}

// A control loop that names the material while it pushes: a row from a fake sensor each 2 ms, a decision when the window is
// complete, and how near to the deadline that came.
//
//     c++ -std=c++17 control_loop.cpp -o control_loop $(pkg-config --cflags --libs granular_id) -pthread
//     ./control_loop kitchen.safetensors [SECONDS [RATE_HZ]]      # as root: chrt -f 80 ./control_loop ...

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include <granular_id.hpp>

#if defined(__linux__)
#include <sys/mman.h>
#endif

using Clock = std::chrono::steady_clock;

namespace {

// Stands for the driver of a sensor: a slow push and a rattle on top of it.
class FakeSensor {
public:
    void read(std::vector<double> &row) noexcept {
        for (std::size_t axis = 0; axis < row.size(); ++axis) {
            state_ = 6364136223846793005U * state_ + 1442695040888963407U;
            const double noise = static_cast<double>(state_ >> 11) / 4503599627370496.0 - 1.0;
            row[axis] = std::sin(1e-3 * static_cast<double>(n_) + static_cast<double>(axis)) + 0.5 * noise;
        }
        ++n_;
    }

private:
    std::uint64_t state_ = 1, n_ = 0;
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
        const auto at = [this](double share) { return all_[static_cast<std::size_t>(share * (all_.size() - 1))]; };
        std::printf("%s: %zu, median %.2f us, p99.9 %.2f us, worst %.2f us\n", what, all_.size(), at(0.5), at(0.999), at(1));
    }

private:
    std::vector<double> all_;
};

} // namespace

int main(int argc, char **argv) try {
    if (argc < 2) {
        std::fprintf(stderr, "usage: control_loop MODEL.safetensors [SECONDS [RATE_HZ]]\n");
        return 2;
    }
    const granular_id::Model model(argv[1]);
    granular_id::Stream stream(model);
    const double seconds = argc > 2 ? std::atof(argv[2]) : 10.0, rate_hz = argc > 3 ? std::atof(argv[3]) : model.info().rate_hz;
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz));
    const auto n_rows = static_cast<std::size_t>(seconds * rate_hz);
    Times pushes(n_rows), decisions(n_rows / model.info().n_samples + 1);
    std::vector<double> row(model.info().n_axes);
    granular_id::Decision decision;
    std::size_t n_late = 0;

    // Memory that is touched before the loop is not mapped within it.
#if defined(__linux__)
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) { std::perror("memory is not locked"); }
#endif
    for (std::size_t k = 0; k < model.info().n_samples; ++k) { granular_id::check(stream.push(row)); }
    granular_id::check(stream.decide(decision));
    stream.reset();

    FakeSensor sensor;
    auto deadline = Clock::now();
    for (std::size_t k = 0; k < n_rows; ++k) {
        std::this_thread::sleep_until(deadline);
        deadline += period;
        sensor.read(row);
        auto begin = Clock::now();
        if (stream.push(row) != GID_OK) { return EXIT_FAILURE; }
        auto end = Clock::now();
        pushes.add(end - begin);
        if ((k + 1) % model.info().n_samples == 0) {
            begin = end;
            if (stream.decide(decision) != GID_OK) { return EXIT_FAILURE; }
            stream.reset(); // here a controller would act on the decision, then wait for the next push
            end = Clock::now();
            decisions.add(end - begin);
        }
        n_late += end > deadline;
    }

    pushes.print("pushes");
    decisions.print("decisions");
    std::printf("deadlines missed: %zu of %zu\n", n_late, n_rows);
    if (decision.is_final) {
        const auto label = model.label(decision.label);
        std::printf("last label: %.*s\n", static_cast<int>(label.size()), label.data());
    }
    return EXIT_SUCCESS;
} catch (const granular_id::Error &error) {
    std::fprintf(stderr, "control_loop: %s\n", error.what());
    return EXIT_FAILURE;
}

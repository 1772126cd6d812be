// As answers.c, by the C++ header.

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <vector>

#include <granular_id.hpp>

static void print_bits(double value) {
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    std::printf(" %016" PRIx64, bits);
}

static gid_status status_of_no_path() try {
    const granular_id::Model none(static_cast<const char *>(nullptr));
    return GID_OK;
} catch (const granular_id::Error &error) {
    return error.status();
}

int main(int, char **argv) try {
    if (status_of_no_path() != GID_NULL) { return 1; }
    std::ifstream stored(argv[1], std::ios::binary), recordings(argv[2], std::ios::binary);
    const std::vector<char> file{std::istreambuf_iterator<char>(stored), {}};
    const granular_id::Model model(granular_id::View(reinterpret_cast<const std::uint8_t *>(file.data()), file.size()));
    granular_id::Stream first(model), stream(model);
    const gid_stream replaced = stream.handle();
    stream = std::move(first);
    if (gid_stream_reset(replaced) != GID_HANDLE) { return 1; } // freed
    const auto &info = model.info();
    std::vector<double> rows(info.n_samples * info.n_axes), losses(info.n_classes);
    granular_id::Decision decision;
    const auto n_bytes = static_cast<std::streamsize>(rows.size() * sizeof(double));
    if (first.push(rows) != GID_HANDLE || granular_id::last_error() != "stream 0 was freed or never made") { return 1; }
    for (std::size_t block = 1; recordings.read(reinterpret_cast<char *>(rows.data()), n_bytes); ++block) {
        for (std::size_t k = 0; k < rows.size(); k += block * info.n_axes) {
            if (stream.push({rows.data() + k, std::min(block * info.n_axes, rows.size() - k)}) != GID_OK) { return 1; }
        }
        if (stream.decide(decision) != GID_OK || stream.losses(losses) != GID_OK) { return 1; }
        std::printf("%s %d ", std::string(model.label(decision.label)).c_str(), decision.unknown);
        for (std::size_t k = 0; k < info.n_classes; ++k) { std::putchar(decision.may_be(k) ? '1' : '0'); }
        print_bits(decision.loss);
        print_bits(decision.margin);
        for (const double loss : losses) { print_bits(loss); }
        std::printf(" %.17g\n", decision.probability);
        if (stream.reset() != GID_OK) { return 1; }
    }
    const gid_spec spec = gid_spec_default();
    std::vector<double> features(granular_id::n_features(spec, rows.size()));
    return granular_id::extract(spec, rows, features) == GID_OK && features[0] == rows[0] ? 0 : 1;
} catch (const granular_id::Error &error) {
    std::fprintf(stderr, "%d %s\n", error.status(), error.what());
    return 1;
}

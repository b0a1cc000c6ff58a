// SPDX-License-Identifier: Apache-2.0
/// @file  Measures kernels and steps on a GPU with events, and prints a JSON line for each case.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/backend/cuda/timing_events.cuh>
#include <gsh/core/span.hpp>

#include <cuda_runtime.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace gsh::bench {

/// What a case cannot avoid: bytes of global memory, multiplications and additions in fp32, and those in bf16, which
/// tensor cores compute. The largest of their times is the case's floor. Launches come on top, but are the
/// implementation's choice. Work{} is unknown: the case has no floor.
struct Work {
    double bytes = 0, flops = 0, bf16_flops = 0;
    [[nodiscard]] bool is_known() const { return bytes > 0 || flops > 0 || bf16_flops > 0; }
};

struct Arguments {
    std::string filter;             ///< cases whose name contains it
    std::string only;               ///< the one case of this name; empty: all
    bool list = false;              ///< prints the names only; needs no GPU
    bool kernels = false;           ///< also a line for each kernel of a case
    int runs = 200;                 ///< that are timed
    std::size_t gaussians = 170000; ///< of a person
    int size = 540;                 ///< of images, in pixels
    std::string ply, cameras;       ///< a load from files, for bench_device_raster
    std::string write;              ///< the folder that bench_device_raster writes such files to, instead of measuring
};

/// The device has halted while a case was measured. It then skips the work of all later runs, which look fast.
class Halted : public std::runtime_error {
public:
    explicit Halted(const std::string& name)
        : std::runtime_error(name + ": the device has halted, so times are too short: a run needs larger buffers than "
                                    "those before it, or has a number that is not finite") {}
};

/// The cases of a program.
class Bench {
public:
    Bench(int argc, char** argv) {
        const auto number = [](const char* text) {
            char* end = nullptr;
            const long value = std::strtol(text, &end, 10);
            if (end == text || *end != '\0' || value <= 0) usage();
            return value;
        };
        for (int i = 1; i < argc; ++i) {
            const std::string option = argv[i];
            const auto next = [&] { return i + 1 < argc ? argv[++i] : (usage(), ""); };
            if (option == "--list")
                arguments_.list = true;
            else if (option == "--kernels")
                arguments_.kernels = true;
            else if (option == "--case")
                arguments_.only = next();
            else if (option == "--filter")
                arguments_.filter = next();
            else if (option == "--runs")
                arguments_.runs = static_cast<int>(number(next()));
            else if (option == "--gaussians")
                arguments_.gaussians = static_cast<std::size_t>(number(next()));
            else if (option == "--size")
                arguments_.size = static_cast<int>(number(next()));
            else if (option == "--ply")
                arguments_.ply = next();
            else if (option == "--cameras")
                arguments_.cameras = next();
            else if (option == "--write")
                arguments_.write = next();
            else
                usage();
        }
    }

    [[nodiscard]] const Arguments& arguments() const { return arguments_; }
    [[nodiscard]] cuda::Device& device() {
        if (!device_) device_.emplace();
        return *device_;
    }

    /// Whether a case is to be measured. With --list its name is printed instead.
    [[nodiscard]] bool wants(const std::string& name) const {
        if (name.find(arguments_.filter) == std::string::npos) return false;
        if (!arguments_.only.empty() && name != arguments_.only) return false;
        if (arguments_.list) std::printf("%s\n", name.c_str());
        return !arguments_.list;
    }

    /// Measures run(k), k = 0, 1, …, as one graph each. `run` should use other inputs for other k, so that they are not
    /// in the cache from the run before; it has at most 20 of them, which take turns.
    ///
    /// Errors  Halted.
    template <class Run>
    void measure(const std::string& name, const Work& work, const Run& run) {
        cuda::StepGraph graph(device());
        // Directly: buffers grow to what each input needs. In a graph they cannot, and the device would halt. All k are
        // below twice the number of runs.
        for (int k = 0; k < std::min(most_inputs, 2 * arguments_.runs); ++k) run(k);
        measure_runs(
            name, work, [&](int k) { graph.run([&] { run(k); }); },
            [&](int repeats) { return graph.time_kernels(repeats); });
    }

    /// Measures runs that queue their graph themselves; their buffers have grown before. time_kernels(n) returns the
    /// times of the last run's kernels, medians of n repeats.
    ///
    /// Errors  Halted. Nothing has been printed then.
    template <class Run, class TimeKernels>
    void measure_runs(const std::string& name, const Work& work, const Run& run, const TimeKernels& time_kernels) {
        const int warm_up = std::min(20, arguments_.runs);
        for (int k = 0; k < warm_up; ++k) run(k);
        device().synchronize();

        // The host's time alone: the device is idle, so no queue is full.
        std::vector<double> host;
        for (int k = 0; k < std::min(50, arguments_.runs); ++k) {
            const auto start = std::chrono::steady_clock::now();
            run(warm_up + k);
            host.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
            device().synchronize();
        }

        // Runs follow each other without a wait, as in training.
        const cuda::TimingEvents events(static_cast<std::size_t>(arguments_.runs) + 1);
        device().record(events[0]);
        for (int k = 0; k < arguments_.runs; ++k) {
            run(k);
            device().record(events[static_cast<std::size_t>(k) + 1]);
        }
        device().synchronize();
        check_halted(name); // before anything settles, which clears it
        std::vector<double> times;
        for (std::size_t k = 0; k + 1 < events.size(); ++k) times.push_back(events.microseconds(k, k + 1));

        const Kernels kernels = measure_kernels(name, run, time_kernels);
        const double median = quantile(times, 0.5), floor = floor_of(work);
        std::string of_floor = "\"floor_us\": null, \"floor_percent\": null";
        if (work.is_known())
            of_floor = "\"floor_us\": " + decimal(floor, 2) +
                       ", \"floor_percent\": " + decimal(median > 0 ? 100 * floor / median : 0, 1);
        std::printf("{\"case\": \"%s\", \"us\": %.2f, \"p10\": %.2f, \"p90\": %.2f, \"runs\": %d, \"host_us\": %.2f, "
                    "\"launches\": %zu, %s, \"gpu\": \"%s\"}\n",
                    name.c_str(), median, quantile(times, 0.1), quantile(times, 0.9), arguments_.runs,
                    quantile(host, 0.5), kernels.list.size(), of_floor.c_str(), device().gpu().c_str());
        if (arguments_.kernels)
            for (const Kernel& kernel : kernels.list)
                std::printf("{\"case\": \"%s\", \"stage\": \"%s\", \"kernel\": \"%s\", \"us\": %.2f, \"p10\": %.2f, "
                            "\"p90\": %.2f, \"runs\": %zu, \"gpu\": \"%s\"}\n",
                            name.c_str(), kernel.stage.c_str(), kernel.name.c_str(), kernel.median, kernel.p10,
                            kernel.p90, kernels.runs, device().gpu().c_str());
        std::fflush(stdout);
    }

private:
    static constexpr int most_inputs = 20;

    void check_halted(const std::string& name) {
        if (has_halted(device())) throw Halted(name);
    }

    /// Microseconds of a kernel.
    struct Kernel {
        std::string stage, name;
        double median, p10, p90;
    };
    /// Over `runs` runs.
    struct Kernels {
        std::vector<Kernel> list;
        std::size_t runs = 0;
    };
    /// Each run is timed once, so that the medians are over all inputs. If not all runs have the same kernels, those of
    /// most runs are reported. Without --kernels, one run tells how many there are.
    template <class Run, class TimeKernels>
    Kernels measure_kernels(const std::string& name, const Run& run, const TimeKernels& time_kernels) {
        struct Sequence {
            std::vector<cuda::KernelTime> kernels;
            std::vector<std::vector<double>> times; // of each kernel
        };
        const auto is_same = [](const cuda::KernelTime& a, const cuda::KernelTime& b) {
            return a.kernel == b.kernel && a.stage == b.stage;
        };
        std::vector<Sequence> sequences;
        for (int k = 0; k < (arguments_.kernels ? arguments_.runs : 1); ++k) {
            run(k);
            check_halted(name);
            const std::vector<cuda::KernelTime> timed = time_kernels(1);
            check_halted(name);
            if (timed.empty()) return {};
            auto of = std::find_if(sequences.begin(), sequences.end(), [&](const Sequence& known) {
                return std::equal(known.kernels.begin(), known.kernels.end(), timed.begin(), timed.end(), is_same);
            });
            if (of == sequences.end()) {
                sequences.push_back({timed, std::vector<std::vector<double>>(timed.size())});
                of = sequences.end() - 1;
            }
            for (std::size_t i = 0; i < timed.size(); ++i) of->times[i].push_back(timed[i].microseconds);
        }
        const auto runs_of = [](const Sequence& sequence) { return sequence.times[0].size(); };
        const auto is_rarer = [&](const Sequence& a, const Sequence& b) { return runs_of(a) < runs_of(b); };
        Sequence& most = *std::max_element(sequences.begin(), sequences.end(), is_rarer);
        Kernels result{{}, runs_of(most)};
        for (std::size_t i = 0; i < most.kernels.size(); ++i)
            result.list.push_back({most.kernels[i].stage, most.kernels[i].kernel, quantile(most.times[i], 0.5),
                                   quantile(most.times[i], 0.1), quantile(most.times[i], 0.9)});
        return result;
    }

    [[noreturn]] static void usage() {
        std::fputs(
            "options: [--list] [--case NAME] [--filter TEXT] [--kernels] [--runs N] [--gaussians N] [--size PIXELS] "
            "[--ply FILE --cameras FILE] [--write FOLDER]\n",
            stderr);
        std::exit(2);
    }
    static double quantile(std::vector<double> values, double share) {
        if (values.empty()) return 0;
        std::sort(values.begin(), values.end());
        return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
    }
    static std::string decimal(double value, int digits) {
        char text[64];
        std::snprintf(text, sizeof text, "%.*f", digits, value);
        return text;
    }

    /// µs at this GPU's copy rate, which is measured once, and at its peak rates of multiply-adds. Without tensor cores
    /// for bf16, such work counts as fp32.
    double floor_of(const Work& work) {
        if (copy_rate_ == 0) measure_rates();
        return std::max({work.bytes / copy_rate_, work.flops / flop_rate_, work.bf16_flops / bf16_flop_rate_});
    }
    /// Operations of a multiprocessor in a cycle, by compute capability. Of cards that differ, the fastest counts, so
    /// that a floor is one. Sources: CUDA C++ Programming Guide, arithmetic instructions; white papers of each GPU.
    static double fp32_operations(int capability) { return 2 * (capability <= 80 ? 64 : 128); }
    static double bf16_operations(int capability) {
        if (capability < 80) return fp32_operations(capability);
        if (capability == 80) return 2048;
        if (capability == 90) return 4096;
        return capability >= 100 && capability < 120 ? 8192 : 1024;
    }
    void measure_rates() {
        const std::size_t count = std::min<std::size_t>(arguments_.gaussians * 400, std::size_t(1) << 26);
        cuda::Buffer<float> from(count), to(count);
        device().fill(Span<float>(from), 1.0f);
        const cuda::TimingEvents events(2);
        std::vector<double> times;
        for (int k = 0; k < std::min(20, arguments_.runs); ++k) {
            device().record(events[0]);
            cuda::check(cudaMemcpyAsync(to.data(), from.data(), count * sizeof(float), cudaMemcpyDeviceToDevice,
                                        device().stream()),
                        "bench");
            device().record(events[1]);
            device().synchronize();
            times.push_back(events.microseconds(0, 1));
        }
        copy_rate_ = 2 * sizeof(float) * static_cast<double>(count) / std::max(quantile(times, 0.5), 1e-3);
        int processors = 0, kilohertz = 0, major = 0, minor = 0;
        const int ordinal = device().ordinal();
        cuda::check(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, ordinal), "bench");
        cuda::check(cudaDeviceGetAttribute(&kilohertz, cudaDevAttrClockRate, ordinal), "bench");
        cuda::check(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, ordinal), "bench");
        cuda::check(cudaDeviceGetAttribute(&minor, cudaDevAttrComputeCapabilityMinor, ordinal), "bench");
        const int capability = 10 * major + minor;
        const double cycles = processors * kilohertz * 1e-3; // of all multiprocessors, per microsecond
        flop_rate_ = fp32_operations(capability) * cycles;
        bf16_flop_rate_ = bf16_operations(capability) * cycles;
        std::printf("{\"gpu\": \"%s\", \"copy_tb_s\": %.2f, \"fp32_tflop_s\": %.1f, \"bf16_tflop_s\": %.1f}\n",
                    device().gpu().c_str(), copy_rate_ * 1e-6, flop_rate_ * 1e-6, bf16_flop_rate_ * 1e-6);
    }

    Arguments arguments_;
    std::optional<cuda::Device> device_;
    double copy_rate_ = 0, flop_rate_ = 0, bf16_flop_rate_ = 0; // per microsecond
};

/// Runs a program's cases. Errors go to standard error, with exit code 2.
template <class Cases>
int run_cases(int argc, char** argv, const Cases& cases) {
    try {
        Bench bench(argc, argv);
        cases(bench);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s: %s\n", argv[0], error.what());
        return 2;
    }
}

/// Copies host data to the device.
template <class T>
[[nodiscard]] cuda::Buffer<T> uploaded(cuda::Device& device, const std::vector<T>& values) {
    cuda::Buffer<T> buffer(values.size());
    device.upload(Span<const T>(values), Span<T>(buffer));
    return buffer;
}

} // namespace gsh::bench

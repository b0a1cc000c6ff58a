// SPDX-License-Identifier: Apache-2.0
/// @file  Loss and PSNR of the last steps of training, kept in the backend's memory until they are read.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric_cache.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

/// What a step of training found, before its update.
struct StepValues {
    std::uint64_t step = 0; ///< 1 for the first
    double loss = 0;
    double psnr = 0;        ///< of the render against the photograph, decibels
};

namespace detail {

/// A number of a step's values, stored in the row of the step.
struct StoreStepValue {
    Span<const double> values; // [columns]
    Span<double> row;          // [columns]
    GSH_HD void operator()(std::size_t i) const { row[i] = values[i]; }
};

} // namespace detail

/// A ring of rows in the backend's memory. A step adds a row without a wait for the backend. Reading waits once for
/// all rows since the last read. Only the last `capacity` steps can be read.
template <Backend B>
class StepHistory {
public:
    static constexpr std::size_t capacity = 1024;

    explicit StepHistory(B& backend) : backend_(&backend) { rows_.resize(capacity * columns); }

    /// Adds the values of a step, in the backend's memory: [4] loss, L1, SSIM, mean squared error (PhotometricCache). A
    /// step that is taken again overwrites its row.
    void add(std::uint64_t step, Span<const double> values) {
        check_size("StepHistory::add", "values", values.size(), columns, "loss, L1, SSIM and mean squared error");
        backend_->for_each(columns,
                           detail::StoreStepValue{values, Span<double>(rows_).subspan(row(step) * columns, columns)});
    }

    /// The steps after the last one that was read, up to and including `last`, in order.
    [[nodiscard]] std::vector<StepValues> read(std::uint64_t last) {
        std::vector<StepValues> result;
        const std::uint64_t first = std::max(read_ + 1, last >= capacity ? last - capacity + 1 : 1);
        read_ = last;
        std::vector<double> host;
        for (std::uint64_t step = first; step <= last;) {
            const std::size_t count = std::min(static_cast<std::size_t>(last - step) + 1, capacity - row(step));
            host.resize(count * columns);
            backend_->download(Span<const double>(rows_).subspan(row(step) * columns, count * columns),
                               Span<double>(host));
            for (std::size_t k = 0; k < count; ++k, ++step) {
                const auto values = PhotometricValues::from(host.data() + k * columns);
                result.push_back({step, values.loss, psnr_of_mse(values.mse)});
            }
        }
        return result;
    }

    /// Steps up to `last` count as read.
    void skip(std::uint64_t last) { read_ = last; }

private:
    static constexpr std::size_t columns = PhotometricValues::count;
    [[nodiscard]] static std::size_t row(std::uint64_t step) { return static_cast<std::size_t>(step % capacity); }

    B* backend_;
    typename B::template Buffer<double> rows_; // [capacity, columns]
    std::uint64_t read_ = 0;                   // the last step that was read
};

} // namespace gsh

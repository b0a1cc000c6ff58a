// SPDX-License-Identifier: Apache-2.0
/// @file  Typed exceptions, and the checks that throw them.
#pragma once

#include <gsh/core/message.hpp>
#include <gsh/core/span.hpp>

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>

namespace gsh {

/// Base class of all exceptions that gsh throws.
class Error : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// A size, shape or count that does not match the other arguments.
class ShapeError : public Error {
public:
    using Error::Error;
};

/// A value outside its domain: NaN, a singular matrix, weights that do not sum to one.
class ValueError : public Error {
public:
    using Error::Error;
};

/// A Gaussian with a number that is not finite.
class GaussianError : public ValueError {
public:
    GaussianError(const std::string& message, std::size_t gaussian) : ValueError(message), gaussian_(gaussian) {}
    /// Its index in what was rendered.
    [[nodiscard]] std::size_t gaussian() const { return gaussian_; }

private:
    std::size_t gaussian_;
};

/// A file that is missing, truncated, of the wrong kind, or that cannot be written.
class IoError : public Error {
public:
    using Error::Error;
};

/// A device that failed or is not available.
class DeviceError : public Error {
public:
    using Error::Error;
};

/// Memory that the backend in use cannot access.
class MemoryError : public Error {
public:
    using Error::Error;
};

/// Throws ShapeError unless found == expected: "where: argument has 79 elements, expected 80; hint".
inline void check_size(std::string_view where, std::string_view argument, std::size_t found,
                       std::size_t expected, std::string_view hint = {}) {
    if (found == expected) return;
    std::string message(where);
    message.append(": ").append(argument).append(" has ").append(std::to_string(found));
    message.append(" elements, expected ").append(std::to_string(expected));
    if (!hint.empty()) message.append("; ").append(hint);
    throw ShapeError(message);
}

/// Throws ValueError with `where: what` unless the condition holds.
inline void check_value(bool condition, std::string_view where, std::string_view what) {
    if (condition) return;
    throw ValueError(std::string(where).append(": ").append(what));
}

/// Throws ValueError unless a motion of `count` frames has this one.
inline void check_frame(std::string_view where, std::size_t frame, std::size_t count) {
    if (frame < count) return;
    throw ValueError(std::string(where).append(": frame ").append(std::to_string(frame))
                         .append(" does not exist; the motion has ").append(std::to_string(count)).append(" frames"));
}

/// Throws ValueError naming the first element that is NaN or infinite.
template <class T>
void check_finite(std::string_view where, std::string_view argument, Span<const T> values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (std::isfinite(values[i])) continue;
        throw ValueError(std::string(where)
                             .append(": ")
                             .append(argument)
                             .append("[")
                             .append(std::to_string(i))
                             .append("] is ")
                             .append(detail::number_text(values[i]))
                             .append(", expected a finite number"));
    }
}

} // namespace gsh

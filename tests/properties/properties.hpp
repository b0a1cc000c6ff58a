// SPDX-License-Identifier: Apache-2.0
/// @file  Properties by rapidcheck: something that must hold for every value, checked for many of them.
///
/// A case picks its values by the functions below. When it fails, rapidcheck makes the picks smaller as long as it still
/// fails, so picks are written such that a smaller one is simpler: 0, a short list, a plain scene.
#pragma once

#include <doctest/doctest.h>
#include <rapidcheck.h>

#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace gsh::test {

/// rapidcheck's settings. RC_PARAMS changes them; scripts/test --full asks for 10,000 cases and another seed each time.
[[nodiscard]] inline const rc::detail::Configuration& property_settings() {
    static const rc::detail::Configuration settings = [] {
        rc::detail::Configuration defaults;
        defaults.testParams.seed = 1;
        defaults.testParams.maxSuccess = 40;
        const char* const given = std::getenv("RC_PARAMS");
        return rc::detail::configFromString(given ? given : "", defaults);
    }();
    return settings;
}

/// Checks a property. `holds` is one case: it picks values, and calls require. A failure is reported with the picks, made
/// small, and with the settings that repeat it.
inline void check_property(const std::function<void()>& holds) {
    struct Silent : rc::detail::TestListener {
        void onTestCaseFinished(const rc::detail::CaseDescription&) override {}
        void onShrinkTried(const rc::detail::CaseDescription&, bool) override {}
        void onTestFinished(const rc::detail::TestMetadata&, const rc::detail::TestResult&) override {}
    } listener;
    const rc::detail::TestParams& params = property_settings().testParams;
    const rc::detail::TestResult result =
        rc::detail::checkProperty(rc::detail::toProperty(holds), {}, params, listener, {});
    std::ostringstream text;
    if (result.is<rc::detail::FailureResult>()) { // the picks on one line
        const auto& failure = result.get<rc::detail::FailureResult>();
        text << "case " << failure.numSuccess + 1 << ": " << failure.description << "\nits picks, made small:";
        for (const auto& [type, pick] : failure.counterExample) text << ' ' << pick;
    } else {
        rc::detail::printResultMessage(result, text);
    }
    text << "\nto repeat it: RC_PARAMS=\"seed=" << params.seed << " max_success=" << params.maxSuccess << "\"";
    CHECK_MESSAGE(result.is<rc::detail::SuccessResult>(), text.str());
}

/// Ends the case as a failure unless `holds`. `what` is a function that returns the text.
template <class What>
void require(bool holds, const What& what) {
    if (!holds) RC_FAIL(std::string(what()));
}

/// A number as text, with all its digits.
[[nodiscard]] inline std::string digits(double number) {
    std::ostringstream text;
    text.precision(17);
    text << number;
    return text.str();
}

// -------------------------------------------------------------------------------------------------------------
// Picks

/// A whole number from 0 to count - 1. Its range does not grow from case to case, as rapidcheck's own ranges do.
[[nodiscard]] inline std::size_t below(std::size_t count) {
    return *rc::gen::resize(rc::kNominalSize, rc::gen::inRange<std::size_t>(0, count));
}

/// A length from 0 to `most`, small in the first cases.
[[nodiscard]] inline std::size_t up_to(std::size_t most) {
    return *rc::gen::inRange<std::size_t>(0, most + 1);
}

/// A number within `spread` of `simple`, in a thousand steps to either side.
[[nodiscard]] inline double around(double simple, double spread) {
    const auto pick = static_cast<double>(below(2001));
    const double steps = std::ceil(pick / 2) * (std::fmod(pick, 2) == 1 ? 1 : -1);
    return simple + spread * steps / 1000.3; // not on a grid of decimal numbers
}

/// One of a few; the first is the simplest.
template <class T>
[[nodiscard]] T one_of(std::initializer_list<T> values) {
    return std::data(values)[below(values.size())];
}

/// True in one of `parts` cases.
[[nodiscard]] inline bool rarely(std::size_t parts) {
    return below(parts) == parts - 1;
}

[[nodiscard]] inline vec3<double> around(const vec3<double>& simple, double spread) {
    const double x = around(simple.x, spread), y = around(simple.y, spread), z = around(simple.z, spread);
    return {x, y, z};
}

/// A quaternion of any length but zero.
[[nodiscard]] inline quat<double> any_quat() {
    const double w = around(1, 2), x = around(0, 2), y = around(0, 2), z = around(0, 2);
    const double length = one_of({1.0, 1e-3, 1e3});
    if (w * w + x * x + y * y + z * z < 1e-6) return {length, 0, 0, 0};
    return {w * length, x * length, y * length, z * length};
}

/// A rotation: often none, a quarter or half a turn, otherwise any.
[[nodiscard]] inline mat3<double> any_rotation() {
    switch (below(6)) {
    case 0:
        return mat3<double>(1.0);
    case 1:
        return rotation_from_quat(quat<double>{0, 1, 0, 0});
    case 2:
        return rotation_from_quat(quat<double>{1, 0, 1, 0});
    default:
        return rotation_from_quat(any_quat());
    }
}

/// A list of at most `most` values, each made by `make`; it is short in the first cases. A failing case loses values from
/// anywhere in the list.
template <class Make>
[[nodiscard]] auto list_of(int most, const Make& make) {
    using Value = decltype(make());
    return *rc::gen::scale(most / 100.0, rc::gen::container<std::vector<Value>>(rc::gen::exec(make)));
}

} // namespace gsh::test

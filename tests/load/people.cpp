// SPDX-License-Identifier: Apache-2.0
/// Many people in one training.
#include "load/load.hpp"

#include "support/small_cast.hpp"
#include "support/small_training.hpp"

#include <gsh/cpu.hpp>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace gsh::load {

void train_people(std::size_t people, std::size_t steps, Verdict& verdict) {
    const test::SmallScene scene;
    std::vector<Motion> motions;
    for (std::size_t p = 0; p < people; ++p) // in rows of eight; the first one is where the photographs show somebody
        motions.push_back(test::moved(scene.motion, {0.5 * static_cast<double>(p % 8), 0, -0.5 * std::floor(p / 8)}));
    const std::size_t before = resident();
    const auto begin = std::chrono::steady_clock::now();
    test::Cast<cpu::Threads> cast(scene, motions, scene.photos, [] { return cpu::Threads(2); }, test::quick_avatar());
    cast.steps(static_cast<int>(steps));
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    const Image<float> picture = cast.picture(scene.photos[0].camera, scene.photos[0].frame);
    bool finite = true;
    for (const float value : picture.data) finite = finite && std::isfinite(value);
    std::size_t changed = 0;
    for (std::size_t p = 0; p < people; ++p)
        for (const float value : cast.parameters(p)) finite = finite && std::isfinite(value);
    test::Cast<cpu::Threads> untouched(
        scene, motions, scene.photos, [] { return cpu::Threads(2); }, test::quick_avatar());
    for (std::size_t p = 0; p < people; ++p) changed += cast.parameters(p) != untouched.parameters(p);
    const double each = (static_cast<double>(resident()) - static_cast<double>(before)) / static_cast<double>(people);
    verdict.line(finite && changed > 0, std::to_string(people) + " people, " + std::to_string(steps) + " steps in " +
                                            std::to_string(seconds.count()) + " s: " + std::to_string(changed) +
                                            " have learned, all numbers are finite, " + megabytes(each) + " a person");
}

} // namespace gsh::load

// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/loss/motion_terms.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <utility>

using namespace gsh;

namespace {

const std::vector<double> uneven{0.0, 0.1, 0.25, 0.3, 0.42, 0.5, 0.6};

template <class Sequence, class Element>
struct Fixture {
    std::vector<FrameLink> links;
    std::vector<Element> initial, increments;
    std::size_t width;

    [[nodiscard]] Sequence sequence(SequenceWeights weights) const {
        return {links, initial, increments, width, weights};
    }
};

template <class Sequence, class Element>
void check_terms(Fixture<Sequence, Element>& f) {
    cpu::Serial backend;
    cpu::Buffer<double> scratch;
    for (const SequenceWeights weights :
         {SequenceWeights{1.5, 0, 0}, {0, 0.7, 0}, {0, 0, 2}, {0.3, 0.2, 0.1}, {0, 0, 0}}) {
        const auto loss = [&] { return sequence_value(backend, f.sequence(weights), scratch); };
        std::vector<Element> gradient(f.increments.size(), Element(0.0));
        const auto backward = [&] {
            for (std::size_t i = 0; i < f.links.size(); ++i)
                sequence_backward(backend, f.sequence(weights), i,
                                  Span<Element>(gradient).subspan(i * f.width, f.width));
        };
        backward();
        const bool constant = f.links.size() < 3 || weights.pull + weights.drift + weights.acceleration == 0;
        test::check_gradient(loss, test::scalars(f.increments), test::scalars(gradient), {.may_vanish = constant});
        auto twice = gradient;
        for (auto& g : twice) g += g;
        backward();
        CHECK(gradient == twice);
    }
}

} // namespace

TEST_CASE("frames are linked in time, at their distance, past those that are left out") {
    const std::vector<double> times{0.3, 0.0, 0.1, 0.2, 0.9}; // not in order; 0.9 is too far away to be linked
    auto links = link_frames(times);
    CHECK(links[1].before == -1);
    CHECK(links[1].after == 2);
    CHECK(links[1].to_after == doctest::Approx(1));
    CHECK(links[3].after == 0);
    CHECK(links[0].after == -1); // the next frame is six intervals away
    CHECK(links[4].before == -1);
    const std::vector<std::size_t> out{2};
    links = link_frames(times, out);
    CHECK(links[2].before == -1);
    CHECK(links[2].after == -1);
    CHECK(links[1].after == 3);
    CHECK(links[1].to_after == doctest::Approx(2));
    CHECK(links[3].before == 1);
    CHECK(link_frames(times, out, 1.5)[1].after == -1);
    CHECK(link_frames(times, {}, 10)[0].after == 4);
    CHECK(link_frames({}).empty());
    CHECK(link_frames(std::vector<double>{4}).size() == 1);
    CHECK_THROWS_AS((void)link_frames(std::vector<double>{0, 1, 0}), ValueError);
    CHECK_THROWS_AS((void)link_frames(times, std::vector<std::size_t>{5}), ValueError);
    CHECK_THROWS_AS((void)link_frames(std::vector<double>{0, NAN}), ValueError);
}

TEST_CASE("the terms' gradient, rotations and numbers, uneven times, frames left out") {
    test::Rng rng(5);
    std::vector<double> turned = uneven; // the first two frames are the last in time
    std::rotate(turned.begin(), turned.end() - 2, turned.end());
    for (const std::vector<double>& times : {uneven, turned})
        for (const std::vector<std::size_t>& out : {std::vector<std::size_t>{}, std::vector<std::size_t>{2, 5}}) {
            Fixture<RotationSequence<double>, vec3<double>> rotations{link_frames(times, out), rng.vecs(14),
                                                                      rng.vecs(14, -0.3, 0.3), 2};
            check_terms(rotations);
            Fixture<NumberSequence<double>, double> numbers{link_frames(times, out), rng.numbers(21), rng.numbers(21),
                                                            3};
            check_terms(numbers);
        }
}

TEST_CASE("sequences of no, one and two frames have gradients, too") {
    test::Rng rng(6);
    for (const std::size_t count : {0, 1, 2}) {
        const std::vector<double> times(uneven.begin(), uneven.begin() + static_cast<std::ptrdiff_t>(count));
        Fixture<RotationSequence<double>, vec3<double>> rotations{link_frames(times), rng.vecs(count), rng.vecs(count),
                                                                  1};
        check_terms(rotations);
        Fixture<NumberSequence<double>, double> numbers{link_frames(times), rng.numbers(count), rng.numbers(count), 1};
        check_terms(numbers);
    }
}

TEST_CASE("a steady turn and a steady walk have no acceleration, however unevenly they are filmed") {
    // More than half a turn in total, so axis-angle vectors may jump where rotations do not.
    const vec3<double> rate{2, -1, 4};
    std::vector<vec3<double>> turns;
    std::vector<double> places;
    for (const double t : uneven) {
        turns.push_back(axis_angle_from_rotation(rotation_from_axis_angle(vec3<double>(0.4, 2.9, 0)) *
                                                 rotation_from_axis_angle(rate * t)));
        places.push_back(3 - 5 * t);
    }
    const std::vector<vec3<double>> no_turn(turns.size(), vec3<double>(0.0));
    const std::vector<double> no_shift(places.size(), 0);
    cpu::Serial backend;
    cpu::Buffer<double> scratch;
    const auto links = link_frames(uneven, std::vector<std::size_t>{3});
    CHECK(sequence_value(backend, RotationSequence<double>{links, turns, no_turn, 1, {0, 0, 1}}, scratch) < 1e-24);
    CHECK(sequence_value(backend, NumberSequence<double>{links, places, no_shift, 1, {0, 0, 1}}, scratch) < 1e-24);
    turns[2] = turns[2] * 1.01;
    CHECK(sequence_value(backend, RotationSequence<double>{links, turns, no_turn, 1, {0, 0, 1}}, scratch) > 1e-5);
}

TEST_CASE("evenly filmed, the second difference is the plain one at any frame rate") {
    for (const double rate : {1.0, 30.0}) {
        const std::vector<double> times{0, 1 / rate, 2 / rate}, x{1, 4, 9}, zero(3, 0);
        cpu::Serial backend;
        cpu::Buffer<double> scratch;
        CHECK(sequence_value(backend, NumberSequence<double>{link_frames(times), x, zero, 1, {0, 0, 1}}, scratch) ==
              doctest::Approx(2));
    }
}

TEST_CASE("the pull alone adds its weight times the increments, as the terms of unlinked numbers do") {
    cpu::Serial backend;
    const std::vector<double> w{0.3, -2}, initial(2, 0.0);
    const std::vector<FrameLink> unlinked(1);
    std::vector<double> found(2, 1.0), expected = found;
    pull_backward(backend, 0.25, Span<const double>(w), Span<double>(found));
    sequence_backward(backend, NumberSequence<double>{unlinked, initial, w, 2, {0.25, 0, 0}}, 0,
                      Span<double>(expected));
    CHECK(found == expected);
    std::vector<double> three(3);
    CHECK_THROWS_AS(pull_backward(backend, 0.25, Span<const double>(w), Span<double>(three)), ShapeError);
}

TEST_CASE("a frame beyond the end and a gradient of another size are refused") {
    cpu::Serial backend;
    const auto links = link_frames(std::vector<double>{0, 1});
    const std::vector<double> x(2, 0);
    std::vector<double> gradient(1), wrong(2);
    const NumberSequence<double> sequence{links, x, x, 1, {1, 1, 1}};
    CHECK_THROWS_AS(sequence_backward(backend, sequence, 2, Span<double>(gradient)), ValueError);
    CHECK_THROWS_AS(sequence_backward(backend, sequence, 0, Span<double>(wrong)), ShapeError);
}

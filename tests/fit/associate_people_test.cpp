// SPDX-License-Identifier: Apache-2.0
/// @file  People are told apart in what a careless detector writes: no order, people who are missed, and phantoms.
#include <gsh/fit/associate_people.hpp>

#include "fit/filmed_person.hpp"
#include "support/contains.hpp"

#include <gsh/synthetic/actor_motion.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// What a detector wrote, and who it was: the person of each detection, or -1 of a phantom.
struct Filmed {
    std::vector<PhotoKeypoints> photos;
    std::vector<std::vector<int>> truth;
    std::vector<double> times;
};

/// A motion that walks from one place to another.
Motion walk(int frames, const vec3<double>& from, const vec3<double>& to, ActorMotion kind = ActorMotion::stride) {
    Motion motion = actor_motion(kind, frames);
    const vec3<double> way = to - from;
    const double heading = std::atan2(way.x, way.z);
    for (int t = 0; t < frames; ++t) {
        const auto f = static_cast<std::size_t>(t);
        motion.transl[f] += from + way * (static_cast<double>(t) / (frames - 1));
        motion.pose[55 * f] = vec3<double>(0, heading, 0);
    }
    return motion;
}

/// Who of two people in one image hides the other: the nearer one, where their trunks overlap.
bool hides(const Camera<double>& camera, const vec3<double>& nearer, const vec3<double>& farther) {
    const vec3<double> a = to_camera(camera, nearer), b = to_camera(camera, farther);
    if (a.z > b.z) return false;
    return std::abs(a.x / a.z - b.x / b.z) < 0.3 / b.z;
}

/// Films people with noise. Those who are hidden are missed; of the others a share `missed`; and each photograph has a
/// phantom with probability `phantoms`: the upper half of somebody at another place and in another size.
Filmed film(const std::vector<Motion>& people, const std::vector<Camera<double>>& cameras, double missed = 0,
            double phantoms = 0, double noise = 0.01, std::uint64_t seed = 7) {
    Filmed result;
    result.times = people[0].timestamps;
    std::vector<std::vector<PersonPhoto>> seen;
    for (std::size_t p = 0; p < people.size(); ++p)
        seen.push_back(test::seen(test::fitted_actor(), people[p], cameras, noise, seed + p));
    Rng rng(seed);
    for (std::size_t i = 0; i < seen[0].size(); ++i) {
        PhotoKeypoints photo{seen[0][i].camera, seen[0][i].frame, {}};
        std::vector<std::pair<double, std::pair<int, Detection>>> order;
        for (std::size_t p = 0; p < people.size(); ++p) {
            bool hidden = false;
            for (std::size_t q = 0; q < people.size(); ++q)
                hidden |= q != p &&
                          hides(cameras[photo.camera], people[q].transl[photo.frame], people[p].transl[photo.frame]);
            const bool lost = rng.uniform() < missed;
            if (!hidden && !lost) order.push_back({rng.uniform(), {static_cast<int>(p), seen[p][i].person}});
        }
        if (rng.uniform() < phantoms) {
            Detection phantom = seen[0][i].person;
            const vec2<double> move(rng.uniform(-200, 200), rng.uniform(-150, 150));
            const double scale = rng.uniform(0.2, 0.6);
            std::erase_if(phantom.points, [](const Keypoint& p) { return p.landmark > landmark_number("right_hip"); });
            for (Keypoint& point : phantom.points) point.pixel = point.pixel * scale + move, point.confidence = 0.6;
            order.push_back({rng.uniform(), {-1, phantom}});
        }
        std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
        auto& truth = result.truth.emplace_back();
        for (auto& [at, one] : order) truth.push_back(one.first), photo.people.push_back(std::move(one.second));
        result.photos.push_back(std::move(photo));
    }
    return result;
}

/// Shares of detections: of people, that got the right person, and that got another one; of phantoms, that got any.
struct Score {
    double right = 0, confused = 0, phantoms = 0;
};
/// People may be numbered otherwise: the best numbering counts.
Score score(const Filmed& filmed, const AssociatedPeople& found, std::size_t people) {
    std::vector<int> order(people);
    for (std::size_t p = 0; p < people; ++p) order[p] = static_cast<int>(p);
    Score best;
    do {
        double count = 0, right = 0, confused = 0, phantom = 0, phantoms = 0;
        for (std::size_t i = 0; i < filmed.truth.size(); ++i) {
            std::vector<int> times(people, 0);
            for (std::size_t k = 0; k < filmed.truth[i].size(); ++k) {
                const int is = filmed.truth[i][k], got = found.person_of[i][k];
                if (got >= static_cast<int>(people)) continue; // one too many
                if (got >= 0) ++times[static_cast<std::size_t>(got)];
                if (is < 0) {
                    phantoms += 1, phantom += got >= 0;
                    continue;
                }
                count += 1;
                if (got >= 0) (order[static_cast<std::size_t>(got)] == is ? right : confused) += 1;
            }
            for (const int n : times) CHECK(n <= 1);
        }
        const Score here{right / count, confused / count, phantom / std::max(1.0, phantoms)};
        if (here.right > best.right) best = here;
    } while (std::next_permutation(order.begin(), order.end()));
    return best;
}

std::vector<Camera<double>> front() {
    return {look_at<double>({0, 0.3, 4.5}, {0, -0.1, 0}, {0, 1, 0}, 0.6, 640, 480)};
}

/// Ann walks to the right in front of Bob, who walks to the left and is hidden in the middle.
std::vector<Motion> crossing(int frames) {
    return {walk(frames, {-1.2, 0, 0.4}, {1.2, 0, 0.4}), walk(frames, {1.2, 0, -0.4}, {-1.2, 0, -0.4})};
}

} // namespace

TEST_CASE("two people cross in one camera, one hides the other, and both keep their names") {
    for (const int frames : {24, 40, 80}) {
        const Filmed filmed = film(crossing(frames), front());
        const auto missing = std::count_if(filmed.truth.begin(), filmed.truth.end(),
                                           [](const std::vector<int>& people) { return people.size() < 2; });
        REQUIRE(missing >= 2); // Bob is hidden
        const AssociatedPeople found = associate_people(front(), filmed.photos, filmed.times, {.count = 2});
        const Score result = score(filmed, found, 2);
        CAPTURE(frames);
        CHECK(found.in_view == 2);
        CHECK(result.right > 0.97);
        CHECK(result.confused < 0.02);
        // From left to right in the first photograph with both, in whatever order the detector has them.
        for (std::size_t i = 0; i < 1; ++i)
            for (std::size_t k = 0; k < filmed.truth[i].size(); ++k) CHECK(found.person_of[i][k] == filmed.truth[i][k]);
    }
}

TEST_CASE("one camera: people are missed and phantoms appear") {
    for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
        const Filmed filmed = film(crossing(60), front(), 0.15, 0.4, 0.015, seed);
        const AssociatedPeople found = associate_people(front(), filmed.photos, filmed.times);
        const Score result = score(filmed, found, 2);
        CAPTURE(seed);
        CHECK(found.count == 2);
        CHECK(result.right > 0.95);
        CHECK(result.confused < 0.03);
        CHECK(result.phantoms < 0.1);
    }
}

TEST_CASE("four cameras: shuffled, a fifth missed, a third with phantoms; three people who cross") {
    const auto cameras = test::cameras_around(4, 5);
    for (const std::uint64_t seed : {1, 2, 3}) {
        std::vector<Motion> people = crossing(40);
        people.push_back(walk(40, {0.3, 0, -1.2}, {-0.3, 0, 1.2}));
        const Filmed filmed = film(people, cameras, 0.2, 0.35, 0.015, seed);
        const AssociatedPeople found = associate_people(cameras, filmed.photos, filmed.times);
        const Score result = score(filmed, found, 3);
        CAPTURE(seed);
        CHECK(found.count == 3);
        CHECK(result.right > 0.95);
        CHECK(result.confused < 0.01);
        CHECK(result.phantoms < 0.15);
        // The order of people and photographs does not matter.
        Filmed reversed = filmed;
        for (PhotoKeypoints& photo : reversed.photos) std::reverse(photo.people.begin(), photo.people.end());
        std::reverse(reversed.photos.begin(), reversed.photos.end());
        AssociatedPeople again = associate_people(cameras, reversed.photos, filmed.times);
        std::reverse(again.person_of.begin(), again.person_of.end());
        for (auto& of : again.person_of) std::reverse(of.begin(), of.end());
        CHECK(again.person_of == found.person_of);
    }
}

TEST_CASE("a single moment of four cameras is enough") {
    const auto cameras = test::cameras_around(4, 5);
    std::vector<Motion> people{walk(2, {-0.7, 0, 0}, {-0.7, 0, 0.1}), walk(2, {0.6, 0, 0.3}, {0.6, 0, 0.2})};
    Filmed filmed = film(people, cameras);
    std::vector<std::size_t> first;
    Filmed moment{.photos = {}, .truth = {}, .times = {0}};
    for (std::size_t i = 0; i < filmed.photos.size(); ++i)
        if (filmed.photos[i].frame == 0)
            moment.photos.push_back(filmed.photos[i]), moment.truth.push_back(filmed.truth[i]);
    const AssociatedPeople found = associate_people(cameras, moment.photos, moment.times);
    CHECK(found.count == 2);
    CHECK(score(moment, found, 2).right == 1);
}

TEST_CASE("a person who leaves and comes back is the same") {
    Motion ann = walk(60, {-0.6, 0, 0}, {-0.5, 0, 0}), bob = walk(60, {0.6, 0, 0}, {0.7, 0, 0});
    Filmed filmed = film({ann, bob}, front());
    for (std::size_t i = 0; i < filmed.photos.size(); ++i)
        if (filmed.photos[i].frame >= 20 && filmed.photos[i].frame < 45)
            for (std::size_t k = filmed.truth[i].size(); k-- > 0;)
                if (filmed.truth[i][k] == 1) {
                    filmed.truth[i].erase(filmed.truth[i].begin() + static_cast<std::ptrdiff_t>(k));
                    filmed.photos[i].people.erase(filmed.photos[i].people.begin() + static_cast<std::ptrdiff_t>(k));
                }
    const AssociatedPeople found = associate_people(front(), filmed.photos, filmed.times);
    CHECK(found.count == 2);
    CHECK(score(filmed, found, 2).right > 0.99);
}

TEST_CASE("one person: the one who is largest in the whole video, not the largest of each moment") {
    // Bob walks through the front of the picture, nearer to the camera than Ann, in a third of the frames.
    Motion ann = walk(60, {-0.3, 0, -0.5}, {0.3, 0, -0.5}), bob = walk(60, {-6, 0, 1.6}, {6, 0, 1.6});
    Filmed filmed = film({ann, bob}, front());
    for (std::size_t i = 0; i < filmed.photos.size(); ++i) // who is outside of the image is not found
        for (std::size_t k = filmed.truth[i].size(); k-- > 0;) {
            const double x = filmed.photos[i].people[k].points[0].pixel.x;
            if (x > 0 && x < 640) continue;
            filmed.truth[i].erase(filmed.truth[i].begin() + static_cast<std::ptrdiff_t>(k));
            filmed.photos[i].people.erase(filmed.photos[i].people.begin() + static_cast<std::ptrdiff_t>(k));
        }
    const AssociatedPeople found = associate_people(front(), filmed.photos, filmed.times, {.count = 1});
    double ann_right = 0, ann_count = 0, bob_taken = 0, bob_count = 0;
    for (std::size_t i = 0; i < filmed.truth.size(); ++i)
        for (std::size_t k = 0; k < filmed.truth[i].size(); ++k) {
            const bool taken = found.person_of[i][k] == 0;
            (filmed.truth[i][k] == 0 ? ann_count : bob_count) += 1;
            if (taken) (filmed.truth[i][k] == 0 ? ann_right : bob_taken) += 1;
        }
    REQUIRE(bob_count > 8);
    CHECK(ann_right > 0.97 * ann_count);
    CHECK(bob_taken == 0);
}

TEST_CASE("a single person's detections are all taken: of fast motion, few frames, and a camera of wrong calibration") {
    for (const int frames : {1, 3, 8, 30}) {
        auto cameras = test::cameras_around(3);
        const Filmed filmed = film({walk(30, {-1, 0, 0}, {1, 0, 0.5})}, cameras);
        std::vector<PhotoKeypoints> photos;
        std::vector<double> times;
        for (int t = 0; t < frames; ++t) times.push_back(filmed.times[static_cast<std::size_t>(t * (30 / frames))]);
        for (const PhotoKeypoints& photo : filmed.photos) {
            const auto at = std::find(times.begin(), times.end(), filmed.times[photo.frame]);
            if (at == times.end()) continue;
            photos.push_back(photo);
            photos.back().frame = static_cast<std::size_t>(at - times.begin());
        }
        for (const double shift : {0.0, 150.0}) { // pixels, of the last camera
            cameras[2].cx += shift;
            const AssociatedPeople found = associate_people(cameras, photos, times, {.count = 1});
            CAPTURE(frames);
            CAPTURE(shift);
            for (const auto& of : found.person_of) CHECK(of == std::vector<int>{0});
        }
    }
}

TEST_CASE("what cannot be told apart is refused") {
    const auto cameras = test::cameras_around(2);
    const Filmed filmed = film({walk(8, {-0.5, 0, 0}, {0, 0, 0})}, cameras);
    const auto refused = [&](auto change) {
        auto photos = filmed.photos;
        auto times = filmed.times;
        AssociationParams params;
        change(photos, times, params);
        try {
            (void)associate_people(cameras, photos, times, params);
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string("none");
    };
    const auto has = [](const std::string& message, const char* text) {
        CAPTURE(message);
        CHECK(message == test::contains(text));
    };
    has(refused([](auto& p, auto&, auto&) { p[1].camera = 2; }), "camera 2 and frame 1, expected one of 2 cameras");
    has(refused([](auto& p, auto&, auto&) { p[1].frame = 0; }), "is given twice");
    has(refused([](auto&, auto& t, auto&) { t[2] = t[1]; }), "times must ascend");
    has(refused(
            [](auto& p, auto&, auto&) { p[0].people[0].points[3].pixel.x = std::numeric_limits<double>::quiet_NaN(); }),
        "not finite");
    has(refused([](auto&, auto&, auto& params) { params.count = 0; }), "at least 1");
    CHECK(associate_people(cameras, filmed.photos, filmed.times, {.count = 2}).count == 1);
    CHECK(associate_people(cameras, {}, filmed.times, {.count = 1}).count == 0);
    CHECK(associate_people(cameras, {}, filmed.times).count == 0);
}

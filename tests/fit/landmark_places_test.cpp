// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/landmark_places.hpp>

#include "fit/filmed_person.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("places of landmarks are learned from photographs with known poses, whatever was assumed of them") {
    const BodyModel& body = test::fitted_actor();
    const Motion motion = actor_motion(ActorMotion::stride, 8);
    const auto cameras = test::cameras_around(3);
    std::vector<PhotoKeypoints> photos;
    test::Rng rng(2);
    for (const PersonPhoto& photo : test::seen(body, motion, cameras, 0.006)) {
        photos.push_back({photo.camera, photo.frame, {photo.person}});
        for (Keypoint& point : photos.back().people[0].points)
            if (rng.uniform(0, 1) < 0.1) point.pixel.x += 80; // gross errors
    }
    LandmarkSightings sightings;
    sightings.add(body, motion, cameras, photos);
    static constexpr Landmarks marks = default_landmarks();
    for (std::size_t row = 0; row < landmark_places.size(); ++row) {
        const LandmarkSightings::Place place = sightings.place(row);
        CAPTURE(landmark_places[row].name);
        REQUIRE(place.count == (landmark_places[row].sided ? 48 : 24));
        CHECK(length(place.offset - marks[2 * row].offset) < 0.006);
        CHECK((place.spread > 0.003 && place.spread < 0.012)); // the median of a normal error of 6 mm in two axes: 7 mm
    }
    // Few, doubtful, or of a crowd: no place.
    for (PhotoKeypoints& photo : photos) photo.people.push_back(photo.people[0]);
    LandmarkSightings none;
    none.add(body, motion, cameras, photos);
    for (PhotoKeypoints& photo : photos) photo.people.resize(1);
    none.add(body, motion, cameras, photos, 0.95);
    CHECK(none.place(0).count == 0);
}

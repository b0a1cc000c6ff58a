// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_people.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

std::map<std::string, double> macros_of(const MakeHumanPerson& person) {
    std::map<std::string, double> targets;
    add_macro_targets(person, [&](const std::string& name, double share) { targets[name] += share; });
    return targets;
}

} // namespace

TEST_CASE("targets of macros are mixed by products of shares") {
    MakeHumanPerson person;
    person.sex = 1, person.weight = 0.75, person.muscle = 0, person.ancestry = {0.25, 0.75, 0};
    auto targets = macros_of(person);
    CHECK(targets.at("macrodetails/african-male-young") == 0.25);
    CHECK(targets.at("macrodetails/asian-male-young") == 0.75);
    CHECK(targets.at("macrodetails/universal-male-young-minmuscle-averageweight") == 0.5);
    CHECK(targets.at("macrodetails/universal-male-young-minmuscle-maxweight") == 0.5);
    CHECK(targets.size() == 4); // average height, proportions and cup have no targets; a man has no breast

    person.sex = 0.5, person.age = 0.25, person.height = 0.75, person.proportions = 0, person.cup = 1;
    targets = macros_of(person);
    CHECK(targets.at("macrodetails/african-female-old") == doctest::Approx(0.25 * 0.5 * 0.25));
    CHECK(targets.at("macrodetails/height/male-young-minmuscle-maxweight-maxheight") ==
          doctest::Approx(0.5 * 0.75 * 0.5 * 0.5));
    CHECK(targets.at("macrodetails/proportions/male-old-minmuscle-maxweight-uncommonproportions") ==
          doctest::Approx(0.5 * 0.25 * 0.5));
    CHECK(targets.at("breast/female-young-minmuscle-maxweight-maxcup-averagefirmness") ==
          doctest::Approx(0.5 * 0.75 * 0.5));
    double universal = 0;
    for (const auto& [name, share] : targets)
        if (name.starts_with("macrodetails/universal-")) universal += share;
    CHECK(universal == doctest::Approx(1));
}

TEST_CASE("adults mix 336 targets, and no other") {
    const std::vector<std::string> all = macro_targets();
    CHECK(all.size() == 36 + 12 + 72 + 72 + 18 * 8);
    CHECK(std::is_sorted(all.begin(), all.end()));
    Rng rng(1);
    for (int n = 0; n < 200; ++n)
        for (const auto& [name, share] : macros_of(random_person(rng))) {
            CHECK(std::binary_search(all.begin(), all.end(), name));
            CHECK(share > 0);
            CHECK(share <= 1);
        }
}

TEST_CASE("random adults reach from thin to heavy, of both sexes and all ages") {
    Rng rng(5);
    int men = 0, thin = 0, heavy = 0, old = 0;
    for (int n = 0; n < 1000; ++n) {
        const MakeHumanPerson person = random_person(rng);
        CHECK(person.ancestry[0] + person.ancestry[1] + person.ancestry[2] == doctest::Approx(1));
        men += person.sex > 0.5, thin += person.weight < 0.1, heavy += person.weight > 0.9 && person.muscle < 0.2;
        old += person.age > 0.7;
        CHECK(std::abs(random_measure(rng)) <= 1);
    }
    CHECK(std::abs(men - 500) < 60);
    CHECK(thin > 30);
    CHECK(heavy > 60);
    CHECK(old > 100);
}

TEST_CASE("measures are pairs of files with opposite endings; those of limbs change both sides") {
    const std::vector<std::string> files = {
        "a-decr.target",      "a-incr.target", "b-incr.target",       "c-trans-in.target",
        "c-trans-out.target", "d-up.target",   "d-down.target.thumb", "l-e-decr.target",
        "l-e-incr.target",    "note.txt",      "r-e-decr.target",     "r-e-incr.target"};
    const auto body = measures_in("hip", files, false);
    REQUIRE(body.size() == 2);
    CHECK(body[0].more == std::vector<std::string>{"hip/a-incr"});
    CHECK(body[0].less == std::vector<std::string>{"hip/a-decr"});
    CHECK(body[1].more == std::vector<std::string>{"hip/l-e-incr", "hip/r-e-incr"});
    CHECK(body[1].less == std::vector<std::string>{"hip/l-e-decr", "hip/r-e-decr"});
    const auto face = measures_in("nose", files, true);
    REQUIRE(face.size() == 3);
    CHECK(face[1].more == std::vector<std::string>{"nose/c-trans-out"});
    CHECK(measures_in("legs", {"l-a-incr.target", "l-a-decr.target", "r-a-incr.target"}, false).empty());
}

// SPDX-License-Identifier: Apache-2.0
/// @file  People of MakeHuman: which targets a person's sex, age, weight and so on mix, and random adults.
#pragma once

#include <gsh/core/rng.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// What MakeHuman calls macros, for adults. All lie in 0 .. 1, with 0.5 for the average.
struct MakeHumanPerson {
    double sex = 0.5; ///< 0 female, 1 male
    double age = 0;   ///< 0 young (25 years), 1 old (90 years)
    double muscle = 0.5, weight = 0.5, height = 0.5;
    double proportions = 0.5; ///< 1 ideal
    double cup = 0.5, firmness = 0.5;
    std::array<double, 3> ancestry = {1.0 / 3, 1.0 / 3, 1.0 / 3}; ///< african, asian, caucasian; they sum to 1
};

/// Calls add(TARGET, COEFFICIENT) for each target that the person's macros mix, such as
/// "macrodetails/universal-male-young-averagemuscle-maxweight". Coefficients are products of shares, which are linear
/// between the anchors of a macro: the targets are interpolated multilinearly.
template <class Add>
void add_macro_targets(const MakeHumanPerson& person, const Add& add);

/// The names of all targets that adults mix, each once.
[[nodiscard]] inline std::vector<std::string> macro_targets();

/// A measure that is changed by targets in one direction or the other, such as the width of the hips. Those of limbs
/// change both sides at once.
struct MakeHumanMeasure {
    std::vector<std::string> more, less; ///< targets, mixed by the measure's value, and by its negative
};

/// The measures among the names of the files in a folder of targets: pairs with opposite endings, such as
/// hip-scale-horiz-incr.target and hip-scale-horiz-decr.target. Endings -trans-… shift a part of the body without
/// changing its shape, as a pose does. They count in the face only.
[[nodiscard]] inline std::vector<MakeHumanMeasure> measures_in(const std::string& folder,
                                                               const std::vector<std::string>& files, bool face);

/// A random adult. Weight reaches from the thinnest to the heaviest that MakeHuman has.
[[nodiscard]] inline MakeHumanPerson random_person(Rng& rng);

/// The value of a measure of a random adult, in -1 .. 1.
[[nodiscard]] inline double random_measure(Rng& rng) {
    return std::clamp(0.25 * rng.normal(), -1.0, 1.0);
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A name with its share; shares of a macro sum to 1.
using Shares = std::vector<std::pair<std::string, double>>;

/// The shares of names at equal distances over 0 .. 1.
inline Shares shares_of(double value, std::initializer_list<const char*> names) {
    const double place = std::clamp(value, 0.0, 1.0) * static_cast<double>(names.size() - 1);
    Shares shares;
    double at = 0;
    for (const char* name : names) {
        if (const double share = 1 - std::abs(place - at); share > 0) shares.emplace_back(name, share);
        at += 1;
    }
    return shares;
}

template <class Add>
void for_combinations(const std::vector<Shares>& macros, const std::string& name, double share, const Add& add,
                      std::size_t depth = 0) {
    if (depth == macros.size()) return add(name, share);
    for (const auto& [part, part_share] : macros[depth])
        for_combinations(macros, depth ? name + "-" + part : part, share * part_share, add, depth + 1);
}

} // namespace detail

template <class Add>
void add_macro_targets(const MakeHumanPerson& person, const Add& add) {
    using detail::Shares;
    const Shares sex = detail::shares_of(person.sex, {"female", "male"}),
                 age = detail::shares_of(person.age, {"young", "old"}),
                 muscle = detail::shares_of(person.muscle, {"minmuscle", "averagemuscle", "maxmuscle"}),
                 weight = detail::shares_of(person.weight, {"minweight", "averageweight", "maxweight"});
    Shares ancestry;
    constexpr std::array<const char*, 3> names = {"african", "asian", "caucasian"};
    for (std::size_t k = 0; k < names.size(); ++k)
        if (person.ancestry[k] > 0) ancestry.emplace_back(names[k], person.ancestry[k]);

    const auto in = [&](const std::string& before, std::string_view without = {}) {
        return [&add, before, without](const std::string& name, double share) {
            if (without.empty() || !name.ends_with(without)) add(before + name, share); // no target for the average
        };
    };
    detail::for_combinations({ancestry, sex, age}, {}, 1, in("macrodetails/"));
    detail::for_combinations({sex, age, muscle, weight}, {}, 1, in("macrodetails/universal-"));
    detail::for_combinations(
        {sex, age, muscle, weight,
         detail::shares_of(person.proportions, {"uncommonproportions", "average", "idealproportions"})},
        {}, 1, in("macrodetails/proportions/", "-average"));
    detail::for_combinations(
        {sex, age, muscle, weight, detail::shares_of(person.height, {"minheight", "average", "maxheight"})}, {}, 1,
        in("macrodetails/height/", "-average"));
    if (person.sex < 1)
        detail::for_combinations(
            {{{"female", 1 - person.sex}},
             age,
             muscle,
             weight,
             detail::shares_of(person.cup, {"mincup", "averagecup", "maxcup"}),
             detail::shares_of(person.firmness, {"minfirmness", "averagefirmness", "maxfirmness"})},
            {}, 1, in("breast/", "-averagecup-averagefirmness"));
}

inline std::vector<std::string> macro_targets() {
    std::vector<std::string> names;
    MakeHumanPerson person; // at 0.25 and 0.75, neighbouring anchors both count
    for (int corner = 0; corner < 64; ++corner) {
        const auto at = [&](int bit) { return (corner >> bit & 1) ? 0.75 : 0.25; };
        person.age = 0.5, person.muscle = at(0), person.weight = at(1), person.height = at(2);
        person.proportions = at(3), person.cup = at(4), person.firmness = at(5);
        add_macro_targets(person, [&](const std::string& name, double) { names.push_back(name); });
    }
    std::sort(names.begin(), names.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
}

inline std::vector<MakeHumanMeasure> measures_in(const std::string& folder, const std::vector<std::string>& files,
                                                 bool face) {
    constexpr std::array<std::array<std::string_view, 2>, 6> opposites = {{{"-incr", "-decr"},
                                                                           {"-up", "-down"},
                                                                           {"-out", "-in"},
                                                                           {"-forward", "-backward"},
                                                                           {"-convex", "-concave"},
                                                                           {"-compress", "-uncompress"}}};
    constexpr std::string_view ending = ".target";
    const std::set<std::string_view> known(files.begin(), files.end());
    const auto there = [&](const std::string& name) { return known.contains(name + std::string(ending)); };
    std::vector<MakeHumanMeasure> measures;
    for (std::string_view file : files) {
        if (!file.ends_with(ending) || file.starts_with("r-")) continue; // the left one stands for both
        file.remove_suffix(ending.size());
        const bool moves = file.find("-trans-") != std::string_view::npos;
        if ((moves && !face) || file.find("fingers-distance") != std::string_view::npos) continue;
        for (const auto& [up, down] : opposites) {
            if (!file.ends_with(up)) continue;
            const std::string stem(file.substr(0, file.size() - up.size()));
            MakeHumanMeasure measure;
            bool whole = true;
            const auto take = [&](const std::string& of) {
                const std::string more = of + std::string(up), less = of + std::string(down);
                whole = whole && there(more) && there(less);
                measure.more.push_back(folder + "/" + more), measure.less.push_back(folder + "/" + less);
            };
            take(stem);
            if (stem.starts_with("l-")) take("r-" + stem.substr(2));
            if (whole) measures.push_back(std::move(measure));
        }
    }
    return measures;
}

inline MakeHumanPerson random_person(Rng& rng) {
    const auto around_average = [&](double spread) { return std::clamp(0.5 + spread * rng.normal(), 0.0, 1.0); };
    MakeHumanPerson person;
    person.sex = rng.uniform() < 0.5 ? rng.uniform(0, 0.25) : rng.uniform(0.75, 1);
    person.age = std::pow(rng.uniform(), 1.3);
    // Bodies that are heavy or thin by more than a little exist far from average muscle only, most of them below it.
    // These two make a body mass index of 24 with a spread of 5.8, from 14 to 40.
    person.muscle = std::pow(rng.uniform(), 2);
    person.weight = std::clamp(0.65 + 0.35 * rng.normal(), 0.0, 1.0);
    // A unit above average changes stature by 1.44 m, one below by 0.73 m. With sex and measures, the spread is 11 cm.
    const double stature = 0.07 * rng.normal();
    person.height = std::clamp(0.5 + stature / (stature > 0 ? 1.44 : 0.73), 0.0, 1.0);
    person.proportions = around_average(0.25);
    person.cup = around_average(0.25), person.firmness = around_average(0.25);
    double sum = 0;
    for (double& share : person.ancestry) sum += share = -std::log(1 - rng.uniform()); // uniform over all mixtures
    for (double& share : person.ancestry) share /= sum;
    return person;
}

} // namespace gsh

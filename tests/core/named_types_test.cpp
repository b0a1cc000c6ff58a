// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/error.hpp>
#include <gsh/core/named_types.hpp>

#include <doctest/doctest.h>

#include <string>
#include <string_view>
#include <type_traits>

using namespace gsh;

namespace {

struct Cat {
    static constexpr int legs = 4;
};
struct Hen {
    static constexpr int legs = 2;
};
struct Ant {
    static constexpr int legs = 6;
};
struct Unfinished; // a list may name a type that is not complete

using Animals = NamedTypes<Named<"cat", Cat>, Named<"hen", Hen>>;

template <class Types>
int legs_of(std::string_view name) {
    return Types::choose("animal", name, []<class A>(std::type_identity<A>) { return A::legs; });
}

} // namespace

TEST_CASE("a name chooses its type, and another one is refused with all names") {
    CHECK(legs_of<Animals>("cat") == 4);
    CHECK(legs_of<Animals>("hen") == 2);
    CHECK_THROWS_WITH_AS((void)legs_of<Animals>("fish"), "animal is 'fish', expected one of cat, hen", ValueError);
    CHECK_THROWS_WITH_AS((void)legs_of<Animals>(""), "animal is '', expected one of cat, hen", ValueError);
    CHECK_NOTHROW(Animals::check_name("animal", "hen"));
}

TEST_CASE("a list grows at its end and stays as it was") {
    using More = Animals::With<Named<"ant", Ant>>;
    CHECK(legs_of<More>("ant") == 6);
    CHECK(legs_of<More>("cat") == 4);
    CHECK(More::names.size() == 3);
    CHECK(Animals::names.size() == 2);
    CHECK(NamedTypes<Named<"later", Unfinished>>::names[0] == "later");
}

// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/setting.hpp>

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

enum class Fruit { apple, pear, plum };

/// The value of a setting with value `before` after it is set from the text.
template <class V>
V read_setting(V before, const std::string& text, const SettingRange& range = {}) {
    gsh::detail::set_from_text("--set: fruit.size", text, before, range);
    return before;
}

/// Checks that the text is refused with exactly this message, and that the value does not change.
template <class V>
void refuse_setting(V value, const std::string& text, const SettingRange& range, const std::string& expected) {
    const V before = value;
    CHECK_THROWS_WITH_AS(gsh::detail::set_from_text("--set: fruit.size", text, value, range),
                         ("--set: fruit.size is '" + text + "', expected " + expected).c_str(), ValueError);
    CHECK(value == before);
}

} // namespace

template <>
struct gsh::EnumNames<Fruit> {
    static constexpr std::array<std::string_view, 3> names{"apple", "pear", "plum"};
};

TEST_CASE("a range holds its ends where it says so, and nothing beyond them") {
    struct Case {
        SettingRange range;
        double number;
        bool holds;
    };
    constexpr double next = 1 + std::numeric_limits<double>::epsilon(); // after 1
    for (const Case& c : std::initializer_list<Case>{{{}, -1e300, true},
                                                     {SettingRange::at_least(1), 1, true},
                                                     {SettingRange::at_least(next), 1, false},
                                                     {SettingRange::above(1), 1, false},
                                                     {SettingRange::above(1), next, true},
                                                     {SettingRange::above(1), 1e300, true},
                                                     {SettingRange::at_least(0).up_to(1), 0, true},
                                                     {SettingRange::at_least(0).up_to(1), 1, true},
                                                     {SettingRange::at_least(0).up_to(1), next, false},
                                                     {SettingRange::at_least(0).up_to(1), -1e-300, false},
                                                     {SettingRange::at_least(0).below(1), 0, true},
                                                     {SettingRange::at_least(0).below(1), 1, false},
                                                     {SettingRange::above(0).up_to(1), 0, false},
                                                     {SettingRange::above(0).up_to(1), 1, true},
                                                     {SettingRange::above(0).below(next), 1, true}}) {
        CAPTURE(c.range.words("a number"));
        CAPTURE(c.number);
        CHECK(c.range.holds(c.number) == c.holds);
    }
    CHECK(!SettingRange().holds(std::numeric_limits<double>::quiet_NaN()));
    const SettingRange powers = SettingRange::power_of_two();
    for (const std::uint32_t power : {1u, 2u, 4096u, 1u << 31}) CHECK(powers.holds(power));
    for (const std::uint32_t other : {0u, 3u, 1000u, ~0u}) CHECK(!powers.holds(other));
}

TEST_CASE("a range says in words what it holds") {
    CHECK(SettingRange().words("a number") == "a number");
    CHECK(SettingRange::at_least(0).words("a number") == "a number of at least 0");
    CHECK(SettingRange::above(0).words("a number") == "a number above 0");
    CHECK(SettingRange().up_to(4).words("a whole number") == "a whole number of at most 4");
    CHECK(SettingRange().below(0.5).words("a number") == "a number below 0.5");
    CHECK(SettingRange::at_least(0).up_to(1).words("a number") == "a number of at least 0 and at most 1");
    CHECK(SettingRange::above(0).below(1).words("a number") == "a number above 0 and below 1");
    CHECK(SettingRange::power_of_two().words("a whole number") == "a power of two");
}

TEST_CASE("a setting prints the shortest text that reads back as the same") {
    CHECK(gsh::detail::setting_text(true) == "true");
    CHECK(gsh::detail::setting_text(false) == "false");
    CHECK(gsh::detail::setting_text(Fruit::pear) == "pear");
    CHECK(gsh::detail::setting_text(-12) == "-12");
    CHECK(gsh::detail::setting_text(1u << 31) == "2147483648");
    CHECK(gsh::detail::setting_text(0.1) == "0.1");
    CHECK(gsh::detail::setting_text(0.1 + 0.2) == "0.30000000000000004");
    CHECK(gsh::detail::setting_text(0.1f) == "0.1");
    CHECK(gsh::detail::setting_text(5e-324) == "5e-324");
    for (const double number : {0.1 + 0.2, 1.0 / 3, 1e-3, 5e-324, std::numeric_limits<double>::lowest()})
        CHECK(read_setting(0.0, gsh::detail::setting_text(number)) == number);
    for (const Fruit fruit : {Fruit::apple, Fruit::pear, Fruit::plum})
        CHECK(read_setting(Fruit::pear, gsh::detail::setting_text(fruit)) == fruit);
    for (const bool flag : {true, false}) CHECK(read_setting(!flag, gsh::detail::setting_text(flag)) == flag);
}

TEST_CASE("a text that is no value of the setting is refused with what was expected") {
    const SettingRange any, positive = SettingRange::at_least(1), share = SettingRange::at_least(0).up_to(1),
                            power = SettingRange::power_of_two();
    for (const char* text : {"", " 1", "1 ", "fast", "1e-3x", "0x10", "+1", "1,5"})
        refuse_setting(7.0, text, any, "a number");
    for (const char* text : {"nan", "inf", "-inf"}) {
        refuse_setting(7.0, text, any, "a finite number");
        refuse_setting(0.5, text, share, "a finite number of at least 0 and at most 1");
    }
    refuse_setting(7.0, "1e999", any, "a number that fits 64 bits");
    refuse_setting(7.0f, "1e39", any, "a number that fits 32 bits");
    refuse_setting(0.5, "1.0001", share, "a number of at least 0 and at most 1");
    refuse_setting(64, "6.5", positive, "a whole number of at least 1");
    refuse_setting(64, "0", positive, "a whole number of at least 1");
    refuse_setting(64, "3000000000", positive, "a whole number of at least 1 that fits 32 bits");
    CHECK(read_setting(std::int64_t(64), "3000000000", positive) == 3000000000);
    refuse_setting(64u, "-4", power, "a power of two");
    refuse_setting(64u, "1000", power, "a power of two");
    refuse_setting(64u, "4294967296", power, "a power of two that fits 32 bits");
    CHECK(read_setting(64u, "2147483648", power) == 1u << 31);
    for (const char* text : {"yes", "1", "True", ""}) refuse_setting(true, text, any, "true or false");
    for (const char* text : {"Pear", "pea", "cherry", "1", ""})
        refuse_setting(Fruit::plum, text, any, "one of apple, pear, plum");
}

namespace {

struct Basket {
    double weight = 2;
    int count = 3;

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("basket.weight", self.weight, SettingRange::above(0));
        f("basket.count", self.count, SettingRange::at_least(1));
    }
};

struct Market {
    bool open = true;
    Fruit fruit = Fruit::pear;
    std::string name = {};
    Basket basket;

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("open", self.open, SettingRange());
        f("fruit", self.fruit, SettingRange());
        f("name", self.name, SettingRange());
        Basket::for_each_setting(self.basket, f);
    }
};

} // namespace

TEST_CASE("a struct lists its settings and those of its parts, and text sets them") {
    Market market;
    using Texts = std::vector<std::pair<std::string, std::string>>;
    CHECK(settings_of(market) ==
          Texts{{"open", "true"}, {"fruit", "pear"}, {"name", ""}, {"basket.weight", "2"}, {"basket.count", "3"}});
    CHECK(stated_settings_of(market) ==
          Texts{{"open", "true"}, {"fruit", "pear"}, {"basket.weight", "2"}, {"basket.count", "3"}});
    set_setting(market, "basket.weight", "0.5", "--set");
    set_setting(market, "fruit", "plum", "--set");
    set_setting(market, "name", "north, 2nd", "--set");
    CHECK(market.basket.weight == 0.5);
    CHECK(market.fruit == Fruit::plum);
    CHECK(market.name == "north, 2nd");
    CHECK_THROWS_WITH_AS(set_setting(market, "basket", "1", "--set"),
                         "--set: there is no setting 'basket'; docs/configurations.md lists them", ValueError);
}

TEST_CASE("numbers out of their range are refused by the part that uses them") {
    CHECK_NOTHROW(check_ranges("Market", Market()));
    const auto refused = [](const Basket& basket, const char* message) {
        CHECK_THROWS_WITH_AS(check_ranges("Market", Market{.basket = basket}), message, ValueError);
    };
    refused({.weight = 0}, "Market: basket.weight is 0, expected a finite number above 0");
    refused({.weight = -1}, "Market: basket.weight is -1, expected a finite number above 0");
    refused({.weight = std::numeric_limits<double>::infinity()},
            "Market: basket.weight is inf, expected a finite number above 0");
    refused({.weight = std::numeric_limits<double>::quiet_NaN()},
            "Market: basket.weight is nan, expected a finite number above 0");
    refused({.count = 0}, "Market: basket.count is 0, expected a whole number of at least 1");
}

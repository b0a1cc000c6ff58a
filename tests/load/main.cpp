// SPDX-License-Identifier: Apache-2.0
/// Long and large work, with bounds on memory and waiting: gsh-load LOAD [--NAME NUMBER]. scripts/load runs all loads.
#define DOCTEST_CONFIG_IMPLEMENT // helpers of the tests use doctest's checks
#include "load/load.hpp"

#include <doctest/doctest.h>

#include <exception>
#include <functional>
#include <iostream>
#include <map>
#include <string>

int main(int argc, char** argv) {
    using namespace gsh::load;
    doctest::Context checks;
    checks.setAsDefaultForAssertsOutOfTestCases();
    const std::map<std::string, std::function<void(const Options&, Verdict&)>> loads{
        {"poses", pose_and_draw}, {"pages", serve_pages}, {"people", train_people}, {"motion", long_motion}};
    const auto chosen = argc > 1 ? loads.find(argv[1]) : loads.end();
    if (chosen == loads.end()) {
        std::cerr << "usage: gsh-load poses [--frames N] | pages [--pages N] [--seconds S] | people [--people N]"
                     " | motion [--frames N]\n";
        return 2;
    }
    try {
        Verdict verdict;
        chosen->second(Options(argc, argv), verdict);
        return verdict.exit_code();
    } catch (const std::exception& error) {
        std::cerr << "gsh-load: " << error.what() << '\n';
        return 2;
    }
}

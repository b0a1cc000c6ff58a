// SPDX-License-Identifier: Apache-2.0
/// @file  The main function of the test programs. Unlike doctest's own, it fails if no test case ran, for example
///        because a filter has the old name of a file. If all test cases were skipped, it returns 77.
#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest/doctest.h>

#include "support/skip.hpp"

#include <iostream>
#include <string>

namespace {

unsigned cases_run = 0, cases_skipped = 0;
std::string running; // the test case's name

/// A second reporter, which counts.
struct CaseCounter : doctest::IReporter {
    explicit CaseCounter(const doctest::ContextOptions&) {}
    void report_query(const doctest::QueryData&) override {}
    void test_run_start() override {}
    void test_run_end(const doctest::TestRunStats& run) override { cases_run = run.numTestCasesPassingFilters; }
    void test_case_start(const doctest::TestCaseData& data) override { running = data.m_name; }
    void test_case_reenter(const doctest::TestCaseData&) override {}
    void test_case_end(const doctest::CurrentTestCaseStats&) override {}
    void test_case_exception(const doctest::TestCaseException&) override {}
    void subcase_start(const doctest::SubcaseSignature&) override {}
    void subcase_end() override {}
    void log_assert(const doctest::AssertData&) override {}
    void log_message(const doctest::MessageData&) override {}
    void test_case_skipped(const doctest::TestCaseData&) override {}
};
REGISTER_LISTENER("case_counter", 0, CaseCounter);

} // namespace

void gsh::test::skip(const std::string& why) {
    ++cases_skipped;
    std::cout << "SKIPPED: " << running << ": " << why << std::endl;
}

int main(int argc, char** argv) {
    doctest::Context context(argc, argv);
    const int status = context.run();
    // shouldExit: doctest only listed test cases or printed its help.
    if (status != 0 || context.shouldExit()) return status;
    if (cases_run == 0) std::cerr << "no test case matches the filters\n";
    if (cases_run == 0) return 1;
    return cases_skipped == cases_run ? 77 : 0;
}

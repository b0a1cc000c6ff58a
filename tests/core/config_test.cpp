// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/config.hpp>

#include <doctest/doctest.h>

GSH_HD static int marked() { return GSH_VERSION_MAJOR * 10000 + GSH_VERSION_MINOR * 100 + GSH_VERSION_PATCH; }

TEST_CASE("the version is a number and GSH_HD vanishes where there is no device compiler") { CHECK(marked() > 0); }

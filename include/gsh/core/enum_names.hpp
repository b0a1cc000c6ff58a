// SPDX-License-Identifier: Apache-2.0
/// @file  Names of an enumeration's values, for files, command lines and reports.
#pragma once

namespace gsh {

/// A specialisation has `names`, a std::array of std::string_view: those of E's values, in order. It stands beside E.
template <class E>
struct EnumNames;

} // namespace gsh

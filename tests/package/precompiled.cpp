// SPDX-License-Identifier: Apache-2.0
/// @file  A source file that includes no header of gsh: gsh_precompile puts one before it.

static_assert(gsh::sh_basis_count(2) == 9);

int main() {}

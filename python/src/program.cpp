// SPDX-License-Identifier: Apache-2.0
/// @file  The executable of a program in the Python package. The program is in libgsh-python.

extern "C" int gsh_run_program(const char* name, int argc, char** argv);

int main(int argc, char** argv) { return gsh_run_program(GSH_PROGRAM, argc, argv); }

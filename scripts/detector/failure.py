# SPDX-License-Identifier: Apache-2.0
"""The error that ends the program with one line on what was found and what to do."""


class Failure(Exception):
    pass

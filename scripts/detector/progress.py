# SPDX-License-Identifier: Apache-2.0
"""A progress line as gsh's programs have it: redrawn on a terminal, every ten seconds in a log."""

import shutil
import sys
import time


class Progress:
    def __init__(self, title, total):
        self.title, self.total = title, max(1, total)
        self.begun = self.last = time.monotonic()
        self.terminal, self.shown = sys.stderr.isatty(), False

    def show(self, done):
        now = time.monotonic()
        if now - self.last < (0.3 if self.terminal else 10):
            return
        self.last, self.shown = now, True
        fraction = min(1.0, done / self.total)
        line = (
            f"{self.title} [{'#' * int(24 * fraction):.<24}] {100 * fraction:3.0f}%  {done} of {self.total} frames"
        )
        if done:
            line += f"  {(now - self.begun) * (1 - fraction) / fraction:.0f} s left"
        if self.terminal:
            sys.stderr.write("\r\033[K" + line[: max(1, shutil.get_terminal_size().columns - 1)])
        else:
            sys.stderr.write(line + "\n")
        sys.stderr.flush()

    def finish(self):
        if self.shown and self.terminal:
            sys.stderr.write("\n")

# SPDX-License-Identifier: Apache-2.0
"""Runs functions in parallel processes, and shows how many frames they have done."""

import contextlib
import multiprocessing
import os
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from failure import Failure
from progress import Progress

_done = None  # in a worker: the counter that the main process shows


def _start(done):
    global _done
    _done = done
    os.environ["GLOG_minloglevel"] = "3"  # MediaPipe's and TensorFlow Lite's remarks help nobody
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    import cv2

    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)


def frame_done(count=1):
    with _done.get_lock():
        _done.value += count


def run(title, jobs, function, tasks, frames):
    """Calls function(*task) for all tasks, which together call frame_done for `frames` frames."""
    if not tasks:
        return
    context = multiprocessing.get_context("spawn")
    done = context.Value("i", 0)
    progress = Progress(title, frames)
    pool = ProcessPoolExecutor(min(jobs, len(tasks)), context, _start, (done,))
    try:
        waiting = {pool.submit(function, *task) for task in tasks}
        while waiting:
            finished, waiting = wait(waiting, timeout=0.3, return_when=FIRST_COMPLETED)
            progress.show(done.value)
            for future in finished:
                future.result()
    except BrokenProcessPool as error:
        raise Failure(
            f"a process of the step '{title}' was ended by the system, perhaps for want of memory; the same command "
            "goes on from here; --jobs 1 takes less"
        ) from error
    finally:
        with contextlib.suppress(Exception):
            pool.shutdown(wait=True, cancel_futures=True)
        progress.finish()

"""Work shared among threads; the caller is one of them, because a new thread has to wait for its turn."""

import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

Task = TypeVar("Task")


def run_threaded(work: Callable[[Task], object], tasks: Sequence[Task], threads: int) -> None:
    """`work` on every one of the `tasks`, by at most so many `threads`; what fails ends all and is raised here."""
    left, failed = iter(tasks), []

    def go_on() -> None:
        for task in left:
            try:
                work(task)
            except BaseException as error:
                failed.append(error)
            if failed:
                return

    helpers = [threading.Thread(target=go_on) for _ in range(min(threads, len(tasks)) - 1)]
    for helper in helpers:
        helper.start()
    go_on()
    for helper in helpers:
        helper.join()
    if failed:
        raise failed[0]

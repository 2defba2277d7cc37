"""A thread that makes blocking calls for the main thread, which meanwhile hears signals.

gRPC's blocking call looks for signals every 200 ms only, and its futures start a thread for each call when no other is
running: that took several times as long as a small job.
"""
from __future__ import annotations

import queue
import threading
import weakref
from typing import Any, Callable, Tuple, TypeVar

_Answer = TypeVar("_Answer")
_Task = Tuple[Callable[[], Any], "queue.SimpleQueue[Any]"]


class Helper:
    """One thread, for one call at a time. It ends with this object."""

    def __init__(self) -> None:
        tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        self._tasks = tasks
        self.end = weakref.finalize(self, tasks.put, None)
        threading.Thread(target=_work, args=(tasks,), daemon=True).start()

    def run(self, call: Callable[[], _Answer]) -> _Answer:
        """What the call returns or raises. KeyboardInterrupt leaves it running: the caller has to end it."""
        answer: queue.SimpleQueue[_Answer | BaseException] = queue.SimpleQueue()
        self._tasks.put((call, answer))
        result = answer.get()
        if isinstance(result, BaseException):
            raise result
        return result


def _work(tasks: Any) -> None:
    while True:
        task: _Task | None = tasks.get()
        if task is None:
            return
        call, answer = task
        try:
            answer.put(call())
        except BaseException as error:
            answer.put(error)
        del task, call, answer  # not held until the next one

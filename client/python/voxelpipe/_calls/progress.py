"""What a caller is told while a call runs."""
from __future__ import annotations

import threading
from typing import Any, Callable, Union

from .printable import printable

# callable(stage, fraction of the stage, bytes of the result so far); True: a bar of tqdm, if it is installed.
WAITING = "waiting for the server"  # a stage
Progress = Union[Callable[[str, float, int], None], bool, None]


class Reporter:
    """Tells the caller's progress, from one thread at a time, at most some twenty times a stage."""

    def __init__(self, progress: Progress) -> None:
        self._call: Callable[[str, float, int], None] | None = None
        self._bar: Any = None
        if progress is True:
            self._bar, self._call = _bar()
        elif callable(progress):
            self._call = progress
        self._lock = threading.Lock()
        self._stage = ""
        self._fraction = 0.0

    def __call__(self, stage: str, fraction: float, size: int) -> None:
        if self._call is None:
            return
        with self._lock:
            if stage == self._stage and fraction < 1 and fraction < self._fraction + 0.05:
                return
            self._stage, self._fraction = stage, fraction
            self._call(stage, min(max(fraction, 0.0), 1.0), size)

    def close(self) -> None:
        """Ends the bar."""
        if self._bar is not None:
            self._bar.close()


def _bar() -> tuple[Any, Callable[[str, float, int], None] | None]:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None, None
    bar = tqdm(total=100, bar_format="{desc:<16}{percentage:3.0f}%|{bar}| {elapsed}")

    def show(stage: str, fraction: float, size: int) -> None:
        shown = printable(stage)  # a server's text
        bar.set_description_str(f"{shown} {size >> 20} MiB" if size >> 20 else shown, refresh=False)
        bar.n = round(100 * fraction)
        bar.refresh()

    return bar, show

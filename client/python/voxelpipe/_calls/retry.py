"""When a failed call is made again. Sources: google.rpc.RetryInfo; gRFC A6 (push-back, full jitter)."""
from __future__ import annotations

import random
import time

from .. import errors

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 5.0


class Deadline:
    """The end of a call and of its retries together. In: seconds from now; None: no end."""

    def __init__(self, timeout: float | None) -> None:
        self._end = None if timeout is None else time.monotonic() + timeout
        self._timeout = timeout

    def left(self) -> float | None:
        """Seconds left, for gRPC; None without an end. Errors: DeadlineExceeded."""
        if self._end is None:
            return None
        left = self._end - time.monotonic()
        if left <= 0:
            raise errors.DeadlineExceeded(f"not done within the timeout of {self._timeout:g} s")
        return left


class Retries:
    """Counts the attempts of one call."""

    def __init__(self, retries: int, deadline: Deadline) -> None:
        self._left = retries
        self._attempt = 0
        self._deadline = deadline

    def delay(self, error: errors.VoxelpipeError) -> float:
        """Seconds to wait before the next attempt. Errors: `error` itself if there is none.

        UNAVAILABLE is tried again, RESOURCE_EXHAUSTED only with a delay of the server. Its delay is kept exactly.
        """
        if not isinstance(error, (errors.Unavailable, errors.Overloaded)) or self._left <= 0:
            raise error
        delay = error.retry_after
        if delay is None:
            delay = random.uniform(0, min(_MAX_DELAY_S, _FIRST_DELAY_S * 2.0**self._attempt))
        self._left -= 1
        self._attempt += 1
        left = self._deadline.left()
        if left is not None and delay >= left:
            raise error
        return delay

"""When a failed call is made again. Sources: google.rpc.RetryInfo; gRFC A6 (push-back, full jitter)."""
from __future__ import annotations

import dataclasses
import random
import time

from .. import errors

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 5.0
_MAX_RESTART_DELAY_S = 1.0  # between attempts to connect to a server that restarts


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


@dataclasses.dataclass
class ServerState:
    """What a client knows of its server. answered: it has answered a call. If it cannot be reached later, the address
    is right, and the server restarts.
    """

    answered: bool = False


class Retries:
    """Counts the attempts of one call. In: how many may follow the first."""

    def __init__(self, retries: int, deadline: Deadline, server: ServerState) -> None:
        self._left = retries
        self._attempt = 0
        self._deadline = deadline
        self._server = server

    def delay(self, error: errors.VoxelpipeError) -> float:
        """Seconds to wait before the next attempt. Errors: `error` itself if there is none.

        UNAVAILABLE is tried again, RESOURCE_EXHAUSTED only with a delay of the server. Its delay is kept exactly.
        Attempts to connect to a server that has answered before are not counted.
        """
        if not isinstance(error, (errors.Unavailable, errors.Overloaded)):
            raise error
        connected = not isinstance(error, errors.Unavailable) or error.connected
        restarts = self._server.answered and not connected
        self._server.answered = self._server.answered or connected
        if not restarts and self._left <= 0:
            raise error
        delay = error.retry_after
        if delay is None:
            most = _MAX_RESTART_DELAY_S if restarts else _MAX_DELAY_S
            delay = random.uniform(0, min(most, _FIRST_DELAY_S * 2.0 ** min(self._attempt, 10)))
        self._left -= not restarts
        self._attempt += 1
        left = self._deadline.left()
        if left is not None and delay >= left:
            raise error
        return delay

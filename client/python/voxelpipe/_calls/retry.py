"""When a failed call is made again. Sources: google.rpc.RetryInfo; gRFC A6 (push-back, full jitter)."""
from __future__ import annotations

import math
import random
import time

from .. import errors

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 5.0
_FIRST_CONNECT_DELAY_S, _MAX_CONNECT_DELAY_S = 0.5, 1.0  # between attempts to connect


class Deadline:
    """The end of a call and of its retries together. In: seconds from now; None: no end."""

    def __init__(self, timeout: float | None) -> None:
        self._end = None if timeout is None else time.monotonic() + timeout
        self._timeout = timeout

    @property
    def ends(self) -> bool:
        """False without an end."""
        return self._end is not None

    def rest(self) -> float:
        """Seconds left, below 0 if it has passed; infinite without an end."""
        return math.inf if self._end is None else self._end - time.monotonic()

    def left(self) -> float | None:
        """Seconds left, for gRPC; None without an end. Errors: DeadlineExceeded."""
        left = self.rest()
        if left <= 0:
            raise errors.DeadlineExceeded(f"not done within the timeout of {self._timeout:g} s")
        return left if self.ends else None


class ServerState:
    """What a client knows of its server: if it cannot be reached, is it worth waiting for? In: False for a server that
    comes back at no time.

    A server that has answered a call has the right address, so it restarts; unless a call has waited for it in vain.
    """

    def __init__(self, restarts: bool = True) -> None:
        self._restarts = restarts
        self._answered = False
        self.gave_up = False  # a call has waited in vain, and none has been answered since

    def note(self, error: errors.VoxelpipeError | None) -> None:
        """In: the error of an attempt; None: it succeeded."""
        silent = isinstance(error, (errors.DeadlineExceeded, errors.Cancelled))
        if not silent and (not isinstance(error, errors.Unavailable) or error.connected):
            self._answered = True
            self.gave_up = False

    @property
    def may_restart(self) -> bool:
        """True if a server that cannot be reached is waited for."""
        return self._restarts and self._answered and not self.gave_up


class Retries:
    """Counts the attempts of one call. In: how many may follow the first; 0: none, and no waiting either."""

    def __init__(self, retries: int, deadline: Deadline, server: ServerState) -> None:
        self._retries = retries
        self._counted = self._attempt = 0
        self._deadline = deadline
        self._server = server
        self._begin = time.monotonic()
        self.waiting = False  # for a server that restarts

    def delay(self, error: errors.VoxelpipeError) -> float:
        """Seconds to wait before the next attempt. Errors: `error` itself if there is none.

        UNAVAILABLE is tried again, RESOURCE_EXHAUSTED only with a delay of the server. Its delay is kept exactly.
        Attempts to connect to a server that restarts are not counted if the call has a deadline.
        """
        self._server.note(error)
        if not isinstance(error, (errors.Unavailable, errors.Overloaded)):
            raise error
        connected = not isinstance(error, errors.Unavailable) or error.connected
        ends = self._retries > 0 and self._deadline.ends
        self.waiting = not connected and ends and self._server.may_restart
        if not self.waiting:
            self._counted += 1
            if self._counted > (min(1, self._retries) if self._server.gave_up else self._retries):
                raise error
        delay = error.retry_after
        if delay is None:
            doubled = 2.0 ** min(self._attempt, 10)
            if connected:
                delay = random.uniform(0, min(_MAX_DELAY_S, _FIRST_DELAY_S * doubled))
            else:  # the most: the client goes on as soon as it is connected
                delay = min(_MAX_CONNECT_DELAY_S, _FIRST_CONNECT_DELAY_S * doubled) * random.uniform(0.5, 1)
        self._attempt += 1
        if self._deadline.ends and delay >= self._deadline.rest():
            if self.waiting:
                self._server.gave_up = True
                error.message += f"; asked again for {time.monotonic() - self._begin:.1f} s"
                error.args = (error.message,)
            raise error
        return delay

"""The gRPC channel of a client: one a process, opened when it is first used."""
from __future__ import annotations

import os
import threading
import time
import weakref
from typing import Any, Callable, Iterator, TypeVar

from .. import errors
from .grpc_module import FORKS_ARE_SAFE, grpc
from .helper import Helper
from .session import SERVICE, Options, new_request_id
from .status import of_call, of_cancelled

_Read = TypeVar("_Read")

_UNSAFE = (
    "this process was forked while {}; use the start method spawn or forkserver (multiprocessing.get_context), or fork "
    "before the first call"
)
_FORK_WAIT_S = 5.0  # gRPC itself waits as long
_HEALTH = "/grpc.health.v1.Health/Check"
_MIN_WAIT_S = 0.02  # between two attempts to connect
_RESPONSE_BYTES = 64  # of memory that a response takes besides its own
# Calls do not begin while this process forks: gRPC stands that only between calls.
_gate = threading.Condition()
_forking = False
# Why calls are impossible in this process.
_impossible = ""
# A child process must not touch its parent's channels, not even to free them: gRPC's threads are not in the child.
_FORGOTTEN: list[Any] = []
_ALL: "weakref.WeakSet[Connection]" = weakref.WeakSet()


class Connection:
    """Makes raw calls on a server: bytes in, bytes out. Thread-safe."""

    def __init__(self, options: Options) -> None:
        options.check()
        self.options = options
        self._lock = threading.Lock()
        # Blocking calls of the main thread have a channel of their own: closing it is the way to cancel one.
        self._channels: dict[bool, Any] = {}
        self._calls: dict[tuple[bool, str, str], Any] = {}
        self._helper: Helper | None = None
        self._closed = False
        self.running = 0  # calls
        _ALL.add(self)

    def close(self) -> None:
        """Ends all calls of this process."""
        with self._lock:
            channels = list(self._channels.values())
            self._channels.clear()
            self._calls.clear()
            self._helper = None
            self._closed = True
        for channel in channels:
            channel.close()

    @property
    def closed(self) -> bool:
        """True after close()."""
        return self._closed

    def opened(self) -> bool:
        """True if it has made calls."""
        return bool(self._channels)

    def forget(self) -> None:
        """In a child process: leaves the parent's channels alone."""
        if self._channels:
            _FORGOTTEN.append((self._channels, self._calls, self._helper))
        self._channels = {}
        self._calls = {}
        self._helper = None
        self._lock = threading.Lock()
        self.running = 0

    def _begin(self) -> None:
        with _gate:
            while _forking:
                _gate.wait()
            self.running += 1

    def _end(self, _: Any = None) -> None:
        with _gate:
            self.running -= 1
            _gate.notify_all()

    def _method(self, kind: str, name: str, helped: bool = False) -> Any:
        with self._lock:
            if _impossible:
                raise errors.ServerFailed(_impossible)
            if self._closed:
                raise errors.Cancelled("the client is closed")
            if helped not in self._channels:
                self._channels[helped] = self._opened()
            key = (helped, kind, name)
            if key not in self._calls:
                path = SERVICE + name if "/" not in name else name
                self._calls[key] = getattr(self._channels[helped], kind)(path)
            return self._calls[key]

    def _opened(self) -> Any:
        settings = self.options.channel_options()
        if self.options.tls is None:
            return grpc.insecure_channel(self.options.server, settings)
        credentials = grpc.ssl_channel_credentials(*self.options.tls_files())
        return grpc.secure_channel(self.options.server, credentials, settings)

    def unary(self, name: str, request: bytes, timeout: float | None) -> tuple[bytes | None, str]:
        """A unary call. Out: the response and the call's id; None: it ended well, and without any.

        Errors: VoxelpipeError by the call's code.
        """

        def read(response: Any) -> Any:
            return response

        return self._blocking("unary_unary", name, request, timeout, read)

    def responses(self, name: str, request: bytes, timeout: float | None, most_bytes: int) -> tuple[list[bytes], str]:
        """A call with few and small responses. Out: all of them, and the call's id.

        Errors: as of unary; DataLoss if they have more than most_bytes.
        """
        left = most_bytes

        def read(call: Any) -> list[bytes]:
            nonlocal left
            taken = []
            for response in call:
                left -= len(response) + _RESPONSE_BYTES
                if left < 0:
                    call.cancel()
                    break
                taken.append(response)
            return taken

        taken, request_id = self._blocking("unary_stream", name, request, timeout, read)
        if left < 0:
            raise errors.DataLoss(
                f"the server's result: more than {most_bytes} bytes for a small one", request_id=request_id
            )
        return taken, request_id

    def _blocking(
        self, kind: str, name: str, request: bytes, timeout: float | None, read: Callable[[Any], _Read]
    ) -> tuple[_Read, str]:
        helped = threading.current_thread() is threading.main_thread()
        method = self._method(kind, name, helped)
        request_id = new_request_id()
        metadata = self.options.metadata(request_id)

        def call() -> _Read:
            try:
                return read(method(request, timeout=timeout, metadata=metadata))
            finally:
                self._end()

        self._begin()
        try:
            return (self._helped(call) if helped else call()), request_id
        except grpc.RpcError as error:
            raise self.error(error, request_id) from None
        except ValueError as error:
            if self._closed:  # gRPC's words for a channel that another thread has closed
                raise errors.Cancelled("the client is closed", request_id=request_id) from error
            raise

    def _helped(self, call: Callable[[], _Read]) -> _Read:
        if self._helper is None:
            self._helper = Helper()
        try:
            return self._helper.run(call)
        except grpc.RpcError:
            raise
        except BaseException:  # KeyboardInterrupt, or what another handler of a signal raises
            with self._lock:
                self._helper = None
                channel = self._channels.pop(True, None)
                self._calls = {key: made for key, made in self._calls.items() if not key[0]}
            if channel is not None:
                channel.close()
            raise

    def stream(self, name: str, requests: bytes | Iterator[bytes], timeout: float | None) -> tuple[Any, str]:
        """A call with one request or many. Out: gRPC's call, an iterator of responses, and the call's id."""
        request_id = new_request_id()
        metadata = self.options.metadata(request_id)
        method = self._method("unary_stream" if isinstance(requests, bytes) else "stream_stream", name)
        return self._watched(lambda: method(requests, timeout=timeout, metadata=metadata)), request_id

    def upload(self, name: str, requests: Iterator[bytes], timeout: float | None) -> tuple[bytes | None, str]:
        """A call with a stream of requests and one response. Out: as of unary."""
        request_id = new_request_id()
        method = self._method("stream_unary", name)
        metadata = self.options.metadata(request_id)
        call = self._watched(lambda: method.future(requests, timeout=timeout, metadata=metadata))
        try:
            response: bytes | None = call.result()
            return response, request_id
        except (grpc.RpcError, grpc.FutureCancelledError) as error:
            raise self.error(error, request_id) from None
        except BaseException:
            call.cancel()
            raise

    def _watched(self, start: Callable[[], Any]) -> Any:
        self._begin()
        try:
            call = start()
        except BaseException:
            self._end()
            raise
        call.add_done_callback(self._end)
        return call

    def error(self, error: Any, request_id: str) -> errors.VoxelpipeError:
        """The error of a failed call. In: grpc.RpcError."""
        if not hasattr(error, "code"):
            return errors.Cancelled("the call was cancelled", request_id=request_id)
        text = error.details() or ""
        if error.code() is grpc.StatusCode.CANCELLED and not self._closed:
            return of_cancelled(text, self.options.server, request_id)
        return of_call(error.code().name, text, error.trailing_metadata(), self.options.server, request_id)

    def wait_connected(self, seconds: float) -> None:
        """Waits at most so long for a connection, by a call that waits for one: without a call nothing drives a
        channel, which does not connect then.
        """
        end = time.monotonic() + seconds
        time.sleep(min(seconds, _MIN_WAIT_S))
        with self._lock:
            channels = list(self._channels.values())
        for channel in channels:
            left = max(0.0, end - time.monotonic())
            method = channel.unary_unary(_HEALTH)
            try:
                call = self._watched(lambda: method.future(b"", timeout=left, wait_for_ready=True))
            except ValueError:  # another thread has closed the channel
                return
            try:
                call.exception()
            except grpc.FutureCancelledError:
                return
            except BaseException:
                call.cancel()
                raise


_running_at_fork = False


def _before_fork() -> None:
    """Holds new calls back, and gives the running ones some time to end."""
    global _forking, _running_at_fork
    end = time.monotonic() + _FORK_WAIT_S
    with _gate:
        _forking = True
        while any(connection.running for connection in list(_ALL)) and time.monotonic() < end:
            _gate.wait(end - time.monotonic())
        _running_at_fork = any(connection.running for connection in list(_ALL))


def _in_parent() -> None:
    global _forking
    with _gate:
        _forking = False
        _gate.notify_all()


def _in_child() -> None:
    global _forking, _gate, _impossible
    _gate, _forking = threading.Condition(), False
    connections = list(_ALL)
    if any(connection.opened() for connection in connections):
        if _running_at_fork:
            _impossible = _UNSAFE.format("a call was running")
        elif not FORKS_ARE_SAFE:
            _impossible = _UNSAFE.format("gRPC had no support for forks, as grpc was imported before voxelpipe")
    for connection in connections:
        connection.forget()


os.register_at_fork(before=_before_fork, after_in_parent=_in_parent, after_in_child=_in_child)

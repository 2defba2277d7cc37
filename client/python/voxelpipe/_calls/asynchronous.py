"""The transport of AsyncClient: grpc.aio."""
from __future__ import annotations

import asyncio
import contextlib
from typing import Any, AsyncIterator, Callable, Iterable, Iterator, TypeVar

from ..errors import Cancelled, ServerFailed
from ..grid import VoxelGrid
from .grpc_module import grpc
from .progress import Reporter
from .reader import ResultReader
from .session import SERVICE, Job, Options, new_request_id
from .status import of_call, of_cancelled

_Result = TypeVar("_Result")
_Item = TypeVar("_Item")


class Asynchronous:
    """A server_calls.Transport for one event loop. It connects when the first call is made."""

    def __init__(self, options: Options) -> None:
        options.check()
        self._options = options
        self._channel: Any = None
        self._closing = asyncio.Event()
        self._calls: set[Any] = set()

    async def close(self) -> None:
        """Ends running calls, which raise Cancelled, and the connection. Later calls raise Cancelled."""
        self._closing.set()
        for call in list(self._calls):
            call.cancel()
        if self._channel is not None:
            await self._channel.close()
        self._channel = None

    async def unary(self, name: str, request: bytes, timeout: float | None) -> bytes | None:
        request_id, metadata = self._begun()
        call = self._open().unary_unary(SERVICE + name)(request, timeout=timeout, metadata=metadata)
        return await self._answer(call, request_id)

    async def upload(self, name: str, requests: Iterator[bytes], timeout: float | None) -> bytes | None:
        request_id, metadata = self._begun()
        call = self._open().stream_unary(SERVICE + name)(as_async(requests), timeout=timeout, metadata=metadata)
        return await self._answer(call, request_id)

    async def wait(self, seconds: float, connected: bool) -> None:
        """Errors: Cancelled as soon as the client is closed."""
        try:
            await asyncio.wait_for(self._closing.wait(), seconds)
        except asyncio.TimeoutError:
            return
        raise Cancelled("the client is closed")

    async def work(self, run: Callable[[], _Result]) -> _Result:
        return await asyncio.to_thread(run)

    async def result(self, job: Job, timeout: float | None, reporter: Reporter) -> VoxelGrid:
        request_id, metadata = self._begun()
        if job.in_one_message():
            method = self._open().unary_stream(SERVICE + "Voxelize")
            call = method(job.whole(reporter), timeout=timeout, metadata=metadata)
        else:
            method = self._open().stream_stream(SERVICE + "VoxelizeUpload")
            call = method(as_async(job.upload(reporter)), timeout=timeout, metadata=metadata)
        reader = ResultReader(job.request, self._options.max_result_bytes, request_id, reporter)
        with self._failures(call, request_id):
            async for message in call:
                reader.add_bytes(message)
        return reader.finish()

    def _begun(self) -> tuple[str, Any]:
        request_id = new_request_id()
        return request_id, self._options.metadata(request_id)

    def _open(self) -> Any:
        if self._closing.is_set():
            raise Cancelled("the client is closed")
        if self._channel is None:
            settings = self._options.channel_options()
            if self._options.tls is None:
                self._channel = grpc.aio.insecure_channel(self._options.server, settings)
            else:
                credentials = grpc.ssl_channel_credentials(*self._options.tls_files())
                self._channel = grpc.aio.secure_channel(self._options.server, credentials, settings)
        return self._channel

    async def _answer(self, call: Any, request_id: str) -> bytes | None:
        with self._failures(call, request_id):
            answer: bytes | None = await call
        return answer

    @contextlib.contextmanager
    def _failures(self, call: Any, request_id: str) -> Iterator[None]:
        """Turns the failure of a call of gRPC into the error of its reason, and ends the call with the context."""
        self._calls.add(call)
        try:
            yield
        except asyncio.CancelledError:
            if self._closing.is_set():
                raise Cancelled("the client is closed", request_id=request_id) from None
            raise
        except grpc.RpcError as error:
            text = error.details() or ""
            code, trailers = error.code().name, error.trailing_metadata()
            if code == "CANCELLED" and not self._closing.is_set():
                raise of_cancelled(text, self._options.server, request_id) from None
            raise of_call(code, text, trailers, self._options.server, request_id) from None
        except KeyError as error:  # grpc.aio looks the code up in a table
            raise ServerFailed(f"the server ended the call with the code {error}", request_id=request_id) from None
        finally:
            self._calls.discard(call)
            call.cancel()  # without effect on a call that has ended


async def as_async(items: Iterable[_Item]) -> AsyncIterator[_Item]:
    """The items, for an `async for`."""
    for item in items:
        yield item

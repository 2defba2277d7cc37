"""A server that restarts costs its clients time and no result."""
from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import subprocess
import threading
import time
from typing import Any, Callable, Iterator

import pytest

import voxelpipe
from voxelpipe._calls.grpc_module import grpc
from voxelpipe.local_server import find_program

from . import shapes

AWAY_S = 2.5
OPTIONS: dict[str, Any] = {"resolution": 16, "coverage": "thin"}


class Restarting:
    """A server at one address that can be ended and started again."""

    def __init__(self) -> None:
        self.address = "127.0.0.1:0"
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Waits until it serves."""
        arguments = [find_program(), "--listen", self.address, "--lame-duck-ms", "0", "--gpus", "none"]
        self._process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith("listening on "):
                self.address = line.split()[2]
                return
        raise RuntimeError("the server does not start")

    def stop(self) -> None:
        """Waits until it has ended."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(30)
            assert self._process.stdout is not None
            self._process.stdout.close()
            self._process = None

    @contextlib.contextmanager
    def away(self) -> Iterator[None]:
        """Ends it now, and starts it again after AWAY_S."""
        self.stop()
        timer = threading.Timer(AWAY_S, self.start)
        timer.start()
        try:
            yield
        finally:
            timer.join()


@pytest.fixture()
def restarting() -> Iterator[Restarting]:
    """A running one."""
    try:
        find_program()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    made = Restarting()
    made.start()
    yield made
    made.stop()


def test_a_call_waits_for_a_server_that_restarts(restarting: Restarting) -> None:
    with voxelpipe.Client(restarting.address, retries=1, timeout=60) as client:
        before = client.voxelize(shapes.cube(), **OPTIONS)
        with restarting.away():
            assert client.voxelize(shapes.cube(), **OPTIONS) == before


def test_an_asynchronous_call_waits_for_a_server_that_restarts(restarting: Restarting) -> None:
    async def run() -> None:
        async with voxelpipe.AsyncClient(restarting.address, retries=1, timeout=60) as client:
            before = await client.voxelize(shapes.cube(), **OPTIONS)
            with restarting.away():
                assert await client.voxelize(shapes.cube(), **OPTIONS) == before

    asyncio.run(run())


def test_many_meshes_survive_a_server_that_restarts(restarting: Restarting) -> None:
    with voxelpipe.Client(restarting.address, retries=1, timeout=60) as client:
        with contextlib.ExitStack() as stack:

            def meshes() -> Iterator[Any]:
                for number in range(40):
                    if number == 20:
                        stack.enter_context(restarting.away())
                    yield shapes.cube()

            results = list(client.voxelize_many(meshes(), errors="return", **OPTIONS))
    assert len(results) == 40 and all(isinstance(result, voxelpipe.VoxelGrid) for result in results)
    assert all(result == results[0] for result in results)


def test_a_kept_mesh_is_sent_again_to_a_server_that_restarts(restarting: Restarting) -> None:
    with voxelpipe.Client(restarting.address, timeout=60) as client:
        handle = client.upload(shapes.cube())
        before = client.voxelize(handle, **OPTIONS)
        with restarting.away():
            assert client.voxelize(handle, **OPTIONS) == before


def test_the_timeout_ends_the_waiting(restarting: Restarting) -> None:
    with voxelpipe.Client(restarting.address, timeout=1) as client:
        client.server_info()
        restarting.stop()
        begin = time.monotonic()
        with pytest.raises((voxelpipe.Unavailable, voxelpipe.DeadlineExceeded)):
            client.voxelize(shapes.cube(), **OPTIONS)
        assert time.monotonic() - begin < 5


def test_a_wrong_address_is_not_waited_for(closed_port: str) -> None:
    begin = time.monotonic()
    with pytest.raises(voxelpipe.Unavailable) as caught:
        voxelpipe.Client(closed_port).voxelize(shapes.cube(), **OPTIONS)
    assert not caught.value.connected and time.monotonic() - begin < 10


class Cancelling(grpc.GenericRpcHandler):  # type: ignore[misc]
    """Cancels the first calls, as gRPC's servers do that shut down."""

    def __init__(self, cancelled: int) -> None:
        self.left = cancelled

    def service(self, details: Any) -> Any:
        """Of one call."""

        def answer(_: Any, context: Any) -> bytes:
            self.left -= 1
            if self.left >= 0:
                context.abort(grpc.StatusCode.CANCELLED, "CANCELLED")
            return b""

        return grpc.unary_unary_rpc_method_handler(answer)


@pytest.mark.parametrize("cancelled", [1, 9])
def test_a_call_that_the_server_cancels_is_made_again(cancelled: int) -> None:
    server = grpc.server(concurrent.futures.ThreadPoolExecutor(2), handlers=[Cancelling(cancelled)])
    address = f"127.0.0.1:{server.add_insecure_port('127.0.0.1:0')}"
    server.start()

    async def ask() -> Any:
        async with voxelpipe.AsyncClient(address) as client:
            return await client.server_info()

    try:
        calls: list[Callable[[], Any]] = [voxelpipe.Client(address).server_info, lambda: asyncio.run(ask())]
        for call in calls:
            if cancelled == 1:
                call()
            else:
                with pytest.raises(voxelpipe.Unavailable, match="cancelled the call"):
                    call()
    finally:
        server.stop(None)

"""A server that restarts costs its clients time and no result."""
from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import signal
import subprocess
import threading
import time
from typing import Any, Callable, Iterator

import pytest

import voxelpipe
from voxelpipe import api
from voxelpipe._calls.grpc_module import grpc
from voxelpipe.local_server import find_program

from . import shapes

AWAY_S = 1.5
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

    def stop(self, how: int = signal.SIGKILL) -> None:
        """Waits until it has ended. A server that drains waits for clients without a call, which notice it late."""
        if self._process is not None:
            self._process.send_signal(how)
            self._process.wait(30)
            assert self._process.stdout is not None
            self._process.stdout.close()
            self._process = None

    @contextlib.contextmanager
    def away(self, how: int = signal.SIGKILL) -> Iterator[None]:
        """Ends it now, and starts it again after AWAY_S."""
        self.stop(how)
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
                        stack.enter_context(restarting.away(signal.SIGTERM))
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


@pytest.mark.parametrize("options", [{"retries": 0}, {"timeout": None}])
def test_without_retries_or_a_timeout_a_call_does_not_wait(restarting: Restarting, options: dict[str, Any]) -> None:
    with voxelpipe.Client(restarting.address, **options) as client:
        client.server_info()
        restarting.stop()
        begin = time.monotonic()
        with pytest.raises(voxelpipe.Unavailable):
            client.voxelize(shapes.cube(), **OPTIONS)
        assert time.monotonic() - begin < 5


def test_one_call_waits_in_vain_and_the_next_do_not(restarting: Restarting) -> None:
    with voxelpipe.Client(restarting.address, timeout=2) as client:
        client.voxelize(shapes.cube(), **OPTIONS)
        restarting.stop()
        told: list[str] = []
        with pytest.raises(voxelpipe.VoxelpipeError):
            client.voxelize(shapes.cube(), progress=lambda stage, *_: told.append(stage), **OPTIONS)
        assert "waiting for the server" in told
        begin = time.monotonic()
        for errors in ("raise", "return"):
            with contextlib.suppress(voxelpipe.Unavailable):
                results = list(client.voxelize_many([shapes.cube()] * 8, errors=errors, **OPTIONS))
        assert all(isinstance(result, voxelpipe.VoxelpipeError) for result in results)
        assert time.monotonic() - begin < 12, "less than the timeout a mesh, and once more"
        restarting.start()
        assert isinstance(client.voxelize(shapes.cube(), **OPTIONS), voxelpipe.VoxelGrid)


def test_an_answer_that_is_an_error_is_an_answer(restarting: Restarting) -> None:
    with voxelpipe.Client(restarting.address, retries=1, timeout=60) as client:
        with pytest.raises(voxelpipe.InvalidRequest):
            client.voxelize(shapes.cube(), shader="no_such_shader")
        with restarting.away():
            assert client.voxelize(shapes.cube(), **OPTIONS).mask.any()


def test_a_local_server_that_is_gone_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    with voxelpipe.local_server() as local, local.client() as client:
        client.voxelize(shapes.cube(), **OPTIONS)
        assert local.is_running()
        local.stop()
        assert not local.is_running()
        begin = time.monotonic()
        with pytest.raises(voxelpipe.Unavailable):
            client.voxelize(shapes.cube(), **OPTIONS)
        assert time.monotonic() - begin < 5
    monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)
    monkeypatch.setattr("voxelpipe._calls.core_module.available", lambda: False)
    voxelpipe.shutdown()
    first = voxelpipe.default_client()
    before = voxelpipe.voxelize(shapes.cube(), **OPTIONS)
    api._server.stop()  # type: ignore[union-attr]
    assert voxelpipe.voxelize(shapes.cube(), **OPTIONS) == before, "by a new one"
    assert voxelpipe.default_client() is not first
    voxelpipe.shutdown()


def test_closing_ends_a_call_that_waits(restarting: Restarting) -> None:
    async def run() -> None:
        client = voxelpipe.AsyncClient(restarting.address, timeout=60)
        await client.server_info()
        restarting.stop()
        waits = asyncio.ensure_future(client.voxelize(shapes.cube(), **OPTIONS))
        await asyncio.sleep(1)
        begin = time.monotonic()
        await client.aclose()
        with pytest.raises(voxelpipe.errors.Cancelled):
            await waits
        with pytest.raises(voxelpipe.errors.Cancelled):
            await client.server_info()
        assert time.monotonic() - begin < 1

    asyncio.run(run())


def test_closing_ends_a_call_that_runs(restarting: Restarting) -> None:
    async def run() -> None:
        client = voxelpipe.AsyncClient(restarting.address, timeout=60)
        runs = asyncio.ensure_future(client.voxelize(shapes.heavy(), resolution=700, normal="normal:f32"))
        await asyncio.sleep(0.7)
        await client.aclose()
        with pytest.raises(voxelpipe.errors.Cancelled):
            await runs

    asyncio.run(run())


def test_a_wrong_address_is_not_waited_for(closed_port: str) -> None:
    begin = time.monotonic()
    with pytest.raises(voxelpipe.Unavailable) as caught:
        voxelpipe.Client(closed_port).voxelize(shapes.cube(), **OPTIONS)
    assert not caught.value.connected and time.monotonic() - begin < 10


class Cancelling(grpc.GenericRpcHandler):  # type: ignore[misc]
    """Cancels the first calls, as a gRPC server does that shuts down."""

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

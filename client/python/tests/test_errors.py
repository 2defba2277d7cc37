"""Errors by reason, and when calls are made again."""
from __future__ import annotations

import concurrent.futures
import datetime
import pathlib
import pickle
import time
from typing import Any, Callable, Iterator

import pytest

import voxelpipe
from voxelpipe import Client, LocalServer
from voxelpipe._calls.grpc_module import grpc
from voxelpipe._proto.google.rpc import error_details_pb2, status_pb2
from voxelpipe._proto.voxelpipe.v1 import error_pb2

from . import shapes


def test_errors_by_reason(client: Client) -> None:
    with pytest.raises(voxelpipe.TooLarge) as large:
        client.voxelize(shapes.cube(), resolution=100_000)
    assert large.value.need_bytes == 125 * 10**12 and large.value.limit_bytes == 16 << 30
    assert large.value.largest_resolution is not None and 5000 < large.value.largest_resolution < 5200
    with pytest.raises(voxelpipe.TooLarge) as fine:
        client.voxelize(shapes.cube(), voxel_size=1e-5)
    assert fine.value.smallest_voxel_size is not None and fine.value.largest_resolution is None
    with pytest.raises(voxelpipe.InvalidRequest) as request:
        client.voxelize(shapes.cube(), targets="bit:min")
    assert request.value.field == "targets[0].blend" and len(request.value.request_id) == 32
    with pytest.raises(voxelpipe.InvalidMesh) as mesh:
        client.voxelize(b"glTF and no more")
    assert mesh.value.field.startswith("GLB") and mesh.value.code == "INVALID_ARGUMENT" and not mesh.value.retryable
    with pytest.raises(voxelpipe.TooLarge, match="max_result_bytes"):
        Client(client.server, max_result_bytes=1000).voxelize(shapes.cube(), resolution=64)
    copy = pickle.loads(pickle.dumps(large.value))
    assert type(copy) is voxelpipe.TooLarge and copy.__dict__ == large.value.__dict__ and str(copy) == str(large.value)


def test_a_mesh_beyond_a_limit_is_named(client: Client, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "deep.gltf"
    path.write_text('{"asset": {"version": "2.0"}, "extras": ' + "[" * 500 + "]" * 500 + "}", encoding="utf-8")
    with pytest.raises(voxelpipe.TooLarge) as alone:
        client.voxelize(path)
    (among,) = client.voxelize_many([path], errors="return")
    for error in (alone.value, among):
        assert isinstance(error, voxelpipe.TooLarge)
        assert str(error).startswith(f"{path}: ") and str(error).count(str(path)) == 1


@pytest.mark.parametrize("one", ["box.glb", b"glTF", pathlib.Path("box.glb")])
def test_one_mesh_is_no_list_of_meshes(client: Client, one: Any) -> None:
    with pytest.raises(TypeError, match="is one mesh"):
        client.voxelize_many(one)


def test_many_takes_every_form_of_a_mesh(client: Client, tmp_path: pathlib.Path) -> None:
    file = voxelpipe.load_mesh(shapes.cube())
    (tmp_path / "cube.glb").write_bytes(bytes(file.data))
    kept, arrays = client.upload(file), voxelpipe.Mesh(*shapes.cube())
    meshes = [shapes.cube(), file, bytes(file.data), tmp_path / "cube.glb", kept, arrays]
    many = list(client.voxelize_many(meshes, resolution=8))
    assert many == [client.voxelize(mesh, resolution=8) for mesh in meshes] and many == [many[0]] * len(meshes)


def test_no_server_is_an_error_that_names_it(closed_port: str) -> None:
    begin = time.monotonic()
    with pytest.raises(voxelpipe.Unavailable, match=f"{closed_port}: ") as caught:
        Client(closed_port, retries=1).server_info()
    assert isinstance(caught.value, ConnectionError) and time.monotonic() - begin < 5


def test_a_timeout_ends_the_call(client: Client) -> None:
    begin = time.monotonic()
    with pytest.raises(voxelpipe.DeadlineExceeded) as caught:
        client.voxelize(shapes.heavy(), resolution=900, timeout=0.3)
    assert isinstance(caught.value, TimeoutError) and time.monotonic() - begin < 3


def test_a_closed_client_makes_no_calls(server: LocalServer) -> None:
    client = server.client()
    client.server_info()
    client.close()
    with pytest.raises(voxelpipe.VoxelpipeError):
        client.server_info()


class Failing(grpc.GenericRpcHandler):  # type: ignore[misc]
    """Answers each call by the next of some functions."""

    def __init__(self, answers: list[Callable[[Any], bytes]]) -> None:
        self.answers = answers
        self.times: list[float] = []
        self.metadata: list[dict[str, str]] = []

    def service(self, details: Any) -> Any:
        self.metadata.append(dict(details.invocation_metadata))

        def answer(_: Any, context: Any) -> bytes:
            self.times.append(time.monotonic())
            return self.answers.pop(0)(context)

        return grpc.unary_unary_rpc_method_handler(answer)


def status(code: Any, message: str, *details: Any) -> Callable[[Any], bytes]:
    def fail(context: Any) -> bytes:
        made = status_pb2.Status(code=code.value[0], message=message)
        for detail in details:
            made.details.add().Pack(detail)
        context.set_trailing_metadata((("grpc-status-details-bin", made.SerializeToString()),))
        context.abort(code, message)
        return b""

    return fail


def retry_info(seconds: float) -> Any:
    info = error_details_pb2.RetryInfo()
    info.retry_delay.FromTimedelta(datetime.timedelta(seconds=seconds))
    return info


def ok(_: Any) -> bytes:
    return b""


@pytest.fixture()
def failing() -> Iterator[tuple[Failing, str]]:
    """A server whose answers a test sets, and its address."""
    handler = Failing([])
    made = grpc.server(concurrent.futures.ThreadPoolExecutor(2), handlers=[handler])
    port = made.add_insecure_port("127.0.0.1:0")
    made.start()
    yield handler, f"127.0.0.1:{port}"
    made.stop(None)


BUSY = grpc.StatusCode.RESOURCE_EXHAUSTED
AWAY = grpc.StatusCode.UNAVAILABLE


def test_a_busy_server_is_asked_again_after_its_delay(failing: tuple[Failing, str]) -> None:
    handler, address = failing
    handler.answers = [status(BUSY, "busy", retry_info(0.4)), ok]
    Client(address).server_info()
    assert 0.4 <= handler.times[1] - handler.times[0] < 1.5


def test_a_server_that_is_away_is_asked_again_after_a_random_delay(failing: tuple[Failing, str]) -> None:
    handler, address = failing
    handler.answers = [status(AWAY, "away"), status(AWAY, "away"), ok]
    Client(address).server_info()
    assert len(handler.times) == 3 and handler.times[2] - handler.times[0] < 2
    assert len({metadata["x-request-id"] for metadata in handler.metadata}) == 3


def test_retries_end(failing: tuple[Failing, str]) -> None:
    handler, address = failing
    quota = error_details_pb2.QuotaFailure(violations=[{"subject": "tests"}])
    handler.answers = [status(BUSY, "used up", retry_info(0.01), quota)] * 3
    with pytest.raises(voxelpipe.QuotaExceeded) as caught:
        Client(address, retries=2).server_info()
    assert len(handler.times) == 3
    assert (caught.value.subject, caught.value.retry_after, caught.value.retryable) == ("tests", 0.01, True)


def test_a_delay_beyond_the_deadline_is_not_waited_for(failing: tuple[Failing, str]) -> None:
    handler, address = failing
    handler.answers = [status(BUSY, "busy", retry_info(60))]
    begin = time.monotonic()
    with pytest.raises(voxelpipe.Overloaded) as caught:
        Client(address, timeout=5).estimate(shapes.cube())
    assert time.monotonic() - begin < 3 and caught.value.retry_after == 60


def test_too_large_is_not_tried_again(failing: tuple[Failing, str]) -> None:
    handler, address = failing
    handler.answers = [status(BUSY, "too large", error_pb2.LimitExceeded(limit_bytes=7))]
    with pytest.raises(voxelpipe.TooLarge) as caught:
        Client(address).server_info()
    assert caught.value.limit_bytes == 7 and caught.value.need_bytes is None and len(handler.times) == 1

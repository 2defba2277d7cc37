"""Clients without a server: the methods of a server's, with its bytes."""
from __future__ import annotations

import asyncio
import os
import pathlib
import pickle
import subprocess
import sys
import threading
import time
from typing import Any, Callable, Iterator

import numpy
import pytest

import voxelpipe
from voxelpipe import InProcessClient, LocalServer
from voxelpipe._calls import core_module

from . import shapes

pytestmark = pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")
COLORS: dict[str, Any] = {"resolution": 24, "result": "sparse", "normal": "normal:f32", "fill": "parity"}


@pytest.fixture()
def inside() -> Iterator[InProcessClient]:
    """A client of this process."""
    made = InProcessClient()
    yield made
    made.close()


@pytest.fixture(autouse=True)
def without_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)
    voxelpipe.shutdown()
    yield
    voxelpipe.shutdown()


def test_the_default_client_needs_no_server(ball: shapes.Triangles, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    monkeypatch.delenv("VOXELPIPE_VOXELPIPED", raising=False)
    client = voxelpipe.default_client()
    assert isinstance(client, InProcessClient) and client is voxelpipe.default_client() and client.server == ""
    assert client.voxelize(ball, resolution=8) == voxelpipe.voxelize(ball, resolution=8)
    with pytest.raises(voxelpipe.errors.NotSupported, match="there is no server"):
        client.server_info()


def test_the_results_are_those_of_a_server(
    ball: shapes.Triangles, inside: InProcessClient, server: LocalServer
) -> None:
    with server.client() as client:
        one, other = inside.upload(ball), client.upload(ball)
        assert one.name == other.name
        for field in ("triangles", "vertices", "min", "max"):  # a server that has examined it knows more
            assert getattr(one.stored.mesh, field) == getattr(other.stored.mesh, field)
        assert inside.voxelize(one, **COLORS) == client.voxelize(other, **COLORS)
        count = one.stored.mesh.vertices
        moved = numpy.linspace(0, 1, 3 * count, dtype="f4").reshape(count, 3)
        assert inside.voxelize(one, new_positions=moved, **COLORS) == client.voxelize(
            other, new_positions=moved, **COLORS
        )
        here, there = inside.estimate(one, resolution=99), client.estimate(other, resolution=99)
        assert (here.place, here.result_bytes, here.mesh) == (there.place, there.result_bytes, there.mesh)
        assert inside.estimate(ball, resolution=99).place == here.place
        assert inside.shaders() == client.shaders()
        many = list(inside.voxelize_many([ball, shapes.cube(), one], **COLORS))
        assert many == list(client.voxelize_many([ball, shapes.cube(), other], **COLORS))


def test_a_loaded_mesh_stays_until_it_is_freed(ball: shapes.Triangles, inside: InProcessClient) -> None:
    handle = inside.upload(ball, keep=False)
    assert inside.upload(ball).already_stored and not handle.already_stored
    assert inside.stored_mesh(handle) == inside.stored_mesh(handle.name) == handle.stored
    other = inside.upload(shapes.cube())
    assert [mesh.name for mesh in inside.meshes()] == [other.name, handle.name]
    assert inside.release_mesh(handle) > 0 and [mesh.name for mesh in inside.meshes()] == [other.name]
    calls: list[Callable[[Any], Any]] = [inside.voxelize, inside.stored_mesh, inside.release_mesh, inside.estimate]
    for call in calls:
        with pytest.raises(voxelpipe.MeshNotFound):
            call(handle)
    assert inside.voxelize(InProcessClient().upload(ball), resolution=8).mask.any(), "of the handle's file"
    inside.close()
    calls = [lambda _: inside.upload(ball), lambda _: next(inside.voxelize_many([ball])), inside.voxelize]
    for call in calls:
        with pytest.raises(voxelpipe.errors.Cancelled):
            call(handle)


def test_one_of_several_threads_loads_a_mesh(inside: InProcessClient) -> None:
    handles: list[voxelpipe.MeshHandle] = []
    threads = [threading.Thread(target=lambda: handles.append(inside.upload(shapes.heavy()))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(handle.already_stored for handle in handles) == [False, True, True, True]


def test_what_came_before_an_exception_is_given(inside: InProcessClient) -> None:
    def meshes() -> Iterator[Any]:
        yield shapes.cube()
        yield shapes.cube()
        raise LookupError("no more")

    wrong: list[tuple[Any, type[Exception]]] = [
        (meshes(), LookupError),
        ([shapes.cube(), shapes.cube(), None, shapes.cube()], TypeError),
        ([shapes.cube(), shapes.cube(), "none.glb", shapes.cube()], FileNotFoundError),
    ]
    for source, kind in wrong:
        many = inside.voxelize_many(source, resolution=4)
        assert [next(many).mask.any(), next(many).mask.any()] == [True, True]  # type: ignore[union-attr]
        with pytest.raises(kind):
            next(many)


def test_results_beyond_the_limit_are_refused(ball: shapes.Triangles) -> None:
    client = InProcessClient(max_result_bytes=1000)
    with pytest.raises(voxelpipe.TooLarge):
        client.voxelize(ball, resolution=64)
    assert isinstance(next(client.voxelize_many([ball], resolution=64, errors="return")), voxelpipe.TooLarge)


def test_the_default_client_is_made_anew_after_its_end(ball: shapes.Triangles) -> None:
    with voxelpipe.default_client() as client:
        client.voxelize(ball, resolution=4)
    assert client.closed and voxelpipe.voxelize(ball, resolution=4).mask.any()
    assert not voxelpipe.default_client().closed


def test_positions_that_do_not_fit_are_refused(ball: shapes.Triangles, inside: InProcessClient) -> None:
    handle = inside.upload(ball)
    with pytest.raises(voxelpipe.InvalidRequest, match="bytes are wanted"):
        inside.voxelize(handle, new_positions=numpy.zeros((1, 3)), resolution=8)
    bad = numpy.zeros((handle.stored.mesh.vertices, 3))
    bad[1, 2] = numpy.inf
    with pytest.raises(voxelpipe.InvalidRequest, match="vertex 1 is not finite"):
        inside.voxelize(handle, new_positions=bad, resolution=8)


def test_many_meshes_keep_their_order_and_their_errors(inside: InProcessClient, tmp_path: pathlib.Path) -> None:
    (tmp_path / "bad.glb").write_bytes(b"nonsense")
    meshes = [shapes.cube(), tmp_path / "bad.glb", tmp_path / "none.glb", shapes.cube()] * 3
    results = list(inside.voxelize_many(meshes, in_flight=5, errors="return", resolution=8))
    kinds = [voxelpipe.VoxelGrid, voxelpipe.InvalidMesh, voxelpipe.InvalidMesh, voxelpipe.VoxelGrid] * 3
    assert [type(result) for result in results] == kinds
    assert str(results[1]).startswith(str(tmp_path / "bad.glb")) and isinstance(results[2].__cause__, OSError)
    many = inside.voxelize_many([shapes.cube(), b"nonsense"], resolution=8)
    next(many)
    with pytest.raises(voxelpipe.InvalidMesh):
        next(many)
    assert [type(result) for result in voxelpipe.voxelize_many(meshes[:1], resolution=8)] == kinds[:1]
    big: dict[str, Any] = {"resolution": 160, "normal": "normal:f32", "result": "sparse"}
    alone = [inside.voxelize(mesh, **big) for mesh in meshes[:1]]
    assert list(inside.voxelize_many(meshes[:1], **big)) == alone, "one after the other"
    late = inside.voxelize_many([shapes.heavy(), shapes.cube()], errors="return", resolution=700, timeout=0.05)
    assert isinstance(next(late), voxelpipe.DeadlineExceeded)


def test_many_takes_every_form_of_a_mesh(inside: InProcessClient, tmp_path: pathlib.Path) -> None:
    file = voxelpipe.load_mesh(shapes.cube())
    (tmp_path / "cube.glb").write_bytes(bytes(file.data))
    meshes = [shapes.cube(), file, bytes(file.data), tmp_path / "cube.glb", inside.upload(file)]
    assert list(inside.voxelize_many(meshes, resolution=8)) == [inside.voxelize(file, resolution=8)] * len(meshes)


def test_threads_share_a_loaded_mesh(ball: shapes.Triangles, inside: InProcessClient) -> None:
    handle = inside.upload(ball)
    wrong: list[int] = []
    expected = {name: inside.voxelize(ball, resolution=20, v=f"{name}:f32") for name in ("normal", "base_color")}

    def run(name: str) -> None:
        wrong.extend(1 for _ in range(20) if inside.voxelize(handle, resolution=20, v=f"{name}:f32") != expected[name])

    threads = [threading.Thread(target=run, args=(name,)) for name in [*expected] * 3]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_it_pickles_without_its_meshes(inside: InProcessClient) -> None:
    copy = pickle.loads(pickle.dumps(inside))
    assert isinstance(copy, InProcessClient) and copy.voxelize(shapes.cube(), resolution=4).mask.any()


FORKED = """
import os, sys, voxelpipe
client = voxelpipe.default_client()
if sys.argv[1] == "used":
    client.voxelize(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), resolution=4)
child = os.fork()
if child == 0:
    r = client.voxelize(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), resolution=4)
    print(r.mask.sum(), r.summary.worker != "", flush=True)
    client.close()
    os._exit(0)
os.waitpid(child, 0)
"""


@pytest.mark.parametrize("used", [True, False])
def test_a_forked_child_takes_a_server_only_if_the_core_was_used(server: LocalServer, used: bool) -> None:
    arguments = [sys.executable, "-c", FORKED, "used" if used else "new"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ran = subprocess.run(arguments, capture_output=True, text=True, timeout=120, env=environment)
    assert ran.stdout.split() == ["13", str(used)], ran.stderr


def test_asyncio_without_a_server(ball: shapes.Triangles) -> None:
    async def run() -> None:
        async with voxelpipe.AsyncClient() as client:
            assert client.server == ""
            handle = await client.upload(ball)
            expected = voxelpipe.voxelize(ball, **COLORS)
            assert await client.voxelize(handle, **COLORS) == expected
            assert (await client.stored_mesh(handle)).mesh == handle.stored.mesh
            assert [mesh async for mesh in client.meshes()] == [handle.stored]
            assert (await client.estimate(ball, resolution=24)).place == expected.place
            assert len(await client.shaders()) > 10
            assert [result async for result in client.voxelize_many([ball, handle], **COLORS)] == [expected] * 2
            assert await client.release_mesh(handle) > 0
            with pytest.raises(voxelpipe.errors.NotSupported):
                await client.server_info()
            with pytest.raises(voxelpipe.InvalidRequest, match="resolution"):
                [one async for one in client.voxelize_many([ball], resolution=-1, errors="return")]
            told: list[str] = []
            await client.voxelize(ball, resolution=32, progress=lambda stage, *_: told.append(stage))
            assert told

    asyncio.run(run())


def test_closing_ends_a_job() -> None:
    async def run() -> None:
        client = voxelpipe.AsyncClient()
        runs = asyncio.ensure_future(client.voxelize(shapes.heavy(), resolution=500, normal="normal:f32"))
        await asyncio.sleep(0.3)
        await client.aclose()
        with pytest.raises(voxelpipe.errors.Cancelled):
            await runs
        with pytest.raises(voxelpipe.errors.Cancelled):
            await client.shaders()

    asyncio.run(run())


def test_cancelling_a_task_ends_its_job() -> None:
    async def run() -> None:
        async with voxelpipe.AsyncClient() as client:
            begin = time.monotonic()
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(client.voxelize(shapes.heavy(), resolution=500, normal="normal:f32"), 0.3)
            assert time.monotonic() - begin < 5

    begin = time.monotonic()
    asyncio.run(run())  # which waits for the thread
    assert time.monotonic() - begin < 20

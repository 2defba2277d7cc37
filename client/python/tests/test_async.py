"""AsyncClient."""
from __future__ import annotations

import asyncio
import time
from typing import Any, AsyncIterator, Coroutine

import pytest

import voxelpipe
from voxelpipe import AsyncClient, Client, LocalServer

from . import shapes


def test_it_gives_what_client_gives(server: LocalServer, client: Client, ball: shapes.Triangles) -> None:
    async def run() -> None:
        async with AsyncClient(server.server) as other:
            seen: list[str] = []
            small, large = await asyncio.gather(
                other.voxelize(ball, resolution=16),
                other.voxelize(
                    ball, resolution=200, targets="normal:f32", progress=lambda stage, *_: seen.append(stage)
                ),
            )
            assert small == client.voxelize(ball, resolution=16)
            assert large == client.voxelize(ball, resolution=200, targets="normal:f32")
            assert seen[0] == "upload" and seen[-1] == "download"
            handle = await other.upload(ball)
            assert await other.voxelize(handle, resolution=16) == small
            assert (await other.stored_mesh(handle)).name == handle.name
            assert handle.name in [mesh.name async for mesh in other.meshes()]
            await other.release_mesh(handle)
            assert await other.voxelize(handle, resolution=16) == small
            assert (await other.estimate(ball, resolution=16)).place == small.place
            assert await other.shaders() == client.shaders()
            assert await other.server_info() == client.server_info()

    asyncio.run(run())


def test_many_meshes_come_in_their_order(server: LocalServer) -> None:
    async def run() -> None:
        vertices, faces = shapes.TETRAHEDRON
        async with AsyncClient(server.server) as client:
            meshes: list[Any] = [(vertices * (1, 1, 1 + i), faces) for i in range(12)]
            meshes[5], meshes[7] = b"nonsense", "/missing.glb"

            async def read() -> AsyncIterator[Any]:
                for mesh in meshes:
                    yield mesh

            sources: list[Any] = [meshes, read()]
            for source in sources:
                dims = []
                async for result in client.voxelize_many(source, voxel_size=0.25, in_flight=4, errors="return"):
                    dims.append(result.dims[2] if isinstance(result, voxelpipe.VoxelGrid) else 0)
                assert dims == [0 if i in (5, 7) else 4 * (1 + i) for i in range(12)]

    asyncio.run(run())


def test_errors(server: LocalServer, closed_port: str) -> None:
    async def fails(call: Coroutine[Any, Any, Any], kind: type[voxelpipe.VoxelpipeError]) -> None:
        with pytest.raises(kind):
            await call

    async def run() -> None:
        async with AsyncClient(server.server, retries=0) as client:
            await fails(client.voxelize(shapes.cube(), resolution=100_000), voxelpipe.TooLarge)
            await fails(client.voxelize(b"nonsense"), voxelpipe.InvalidMesh)
            await fails(client.voxelize(shapes.heavy(), resolution=900, timeout=0.3), voxelpipe.DeadlineExceeded)
        async with AsyncClient(closed_port, retries=0) as away:
            await fails(away.server_info(), voxelpipe.Unavailable)

    asyncio.run(run())


def test_a_mesh_with_a_unit_is_kept_under_a_name_of_both(server: LocalServer) -> None:
    plain = b"OFF 3 1 0\n0 0 0\n4 0 0\n0 4 0\n3 0 1 2\n"

    async def run() -> None:
        async with AsyncClient(server.server) as client:
            mesh = voxelpipe.load_mesh(plain, unit="cm")
            handle = await client.upload(mesh)
            assert handle.name == mesh.stored_name() != voxelpipe.load_mesh(plain).stored_name()
            assert (await client.voxelize(handle, voxel_size=0.01)).dims[0] == 4

    asyncio.run(run())


def test_a_cancelled_task_cancels_its_call(server: LocalServer) -> None:
    async def run() -> None:
        async with AsyncClient(server.server) as client:
            task = asyncio.ensure_future(client.voxelize(shapes.heavy(), resolution=900))
            await asyncio.sleep(0.3)
            begin = time.monotonic()
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert time.monotonic() - begin < 0.1

    asyncio.run(run())

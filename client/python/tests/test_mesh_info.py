"""mesh_info(): what `voxelpipe info` prints."""
from __future__ import annotations

import asyncio
import dataclasses
import json
import pathlib
import subprocess
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import AsyncClient, Client, InProcessClient, LocalServer
from voxelpipe._calls import core_module

from . import shapes

inside = pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")


def several() -> dict[str, shapes.Triangles]:
    vertices, faces = shapes.cube()
    triangles = numpy.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    two = numpy.concatenate([triangles, triangles + 8])
    return {
        "closed": (vertices, triangles),
        "flipped": (vertices, triangles[:, ::-1]),
        "open": (vertices, triangles[:-1]),
        "degenerate": (vertices, numpy.concatenate([triangles, [[0, 0, 1]], triangles[:1]])),
        "overlapping": (numpy.concatenate([vertices, vertices + 0.5]), two),
        "nested": (numpy.concatenate([vertices, vertices * 0.5 + 0.25]), two),
        "empty": (vertices[:0], triangles[:0]),
    }


@pytest.fixture(params=[*several()])
def mesh(request: pytest.FixtureRequest, tmp_path: pathlib.Path) -> pathlib.Path:
    file = tmp_path / "mesh.glb"
    file.write_bytes(bytes(voxelpipe.load_mesh(several()[request.param]).data))
    return file


def told_by(cli: str, mesh: pathlib.Path) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(subprocess.check_output([cli, "info", "--json", mesh]))
    return told


def report_of(told: dict[str, Any]) -> voxelpipe.MeshReport:
    names = ("triangles", "vertices", "degenerate_triangles", "open_edges")
    facts: dict[str, Any] = {name: told[name] for name in names} | {name: tuple(told[name]) for name in ("min", "max")}
    return voxelpipe.MeshReport(**facts)


@inside
def test_without_a_server_it_is_what_the_command_line_prints(cli: str, mesh: pathlib.Path) -> None:
    told = told_by(cli, mesh)
    del told["health"]["next"]
    with InProcessClient() as client:
        info = client.mesh_info(mesh)
        assert info.health is not None and dataclasses.asdict(info.health) == told["health"]
        assert info.mesh == report_of(told)
        assert [(one.code, one.place, one.text) for one in info.warnings] == [
            (one["code"], one["place"], one["text"]) for one in told["warnings"]
        ]
        assert client.mesh_info(client.upload(mesh)) == info

    async def ask() -> voxelpipe.MeshInfo:
        async with AsyncClient() as other:
            return await other.mesh_info(mesh)

    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("VOXELPIPE_SERVER", raising=False)
        assert voxelpipe.mesh_info(mesh) == info and asyncio.run(ask()) == info


def test_a_server_gives_all_but_the_health(cli: str, mesh: pathlib.Path, server: LocalServer, client: Client) -> None:
    told = told_by(cli, mesh)
    expected = voxelpipe.MeshInfo(report_of(told), client.estimate(mesh).warnings, None)

    async def ask() -> voxelpipe.MeshInfo:
        async with AsyncClient(server.server) as other:
            return await other.mesh_info(mesh)

    assert client.mesh_info(mesh) == expected and client.mesh_info(client.upload(mesh)) == expected
    assert voxelpipe.mesh_info(mesh, server=server.server) == expected and asyncio.run(ask()) == expected


@pytest.mark.parametrize("by_server", [False, True])
def test_errors_name_the_file(server: LocalServer, tmp_path: pathlib.Path, by_server: bool) -> None:
    if not by_server and not core_module.available():
        pytest.skip("voxelpipe_core is not installed")
    file = tmp_path / "broken.glb"
    file.write_bytes(b"glTF is not what this is")
    with server.client() if by_server else InProcessClient() as client:
        with pytest.raises(voxelpipe.InvalidMesh, match="broken.glb"):
            client.mesh_info(file)


@inside
def test_a_timeout_ends_the_check() -> None:
    with InProcessClient() as client:
        handle = client.upload(shapes.heavy())
        with pytest.raises(voxelpipe.DeadlineExceeded):
            client.mesh_info(handle, timeout=0.0)

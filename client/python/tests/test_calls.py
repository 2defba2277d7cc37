"""Calls: progress, kept meshes, many meshes, questions, tokens and TLS."""
from __future__ import annotations

import concurrent.futures
import pathlib
import pickle
import subprocess
import sys
import time
import types
from typing import Iterator

import numpy
import pytest

import voxelpipe
from voxelpipe import Client, LocalServer, Tls
from voxelpipe._calls.progress import Reporter
from voxelpipe._version import CONTRACT_REVISION

from . import shapes


def test_progress_tells_stages_in_order(client: Client, ball: shapes.Triangles) -> None:
    seen: list[tuple[str, float, int]] = []
    grid = client.voxelize(ball, resolution=300, progress=lambda *report: seen.append(report))  # type: ignore[arg-type]
    stages = list(dict.fromkeys(stage for stage, _, _ in seen))
    assert stages[0] == "upload" and stages[-1] == "download"
    assert all(0 <= fraction <= 1 for _, fraction, _ in seen)
    assert seen[-1][1] == 1 and seen[-1][2] == grid.summary.result_bytes


def test_a_stage_of_a_server_does_not_steer_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    bar = types.SimpleNamespace(
        n=0, set_description_str=lambda text, refresh: shown.append(text), refresh=lambda: None, close=lambda: None
    )
    module = types.ModuleType("tqdm.auto")
    module.tqdm = lambda **_: bar  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "tqdm", types.ModuleType("tqdm"))
    monkeypatch.setitem(sys.modules, "tqdm.auto", module)
    reporter = Reporter(True)
    reporter("\x1b]0;a\x07\r\n\x7f\x9b31m\u202e\u2066\u200f\u061c\u2028\udc80\u00e9\u6e29", 0.5, 0)
    reporter("\x1b[2J", 0.5, 3 << 20)
    assert shown == ["?]0;a?????31m??????\u00e9\u6e29", "?[2J 3 MiB"]


def test_an_exception_of_progress_ends_the_call(client: Client, ball: shapes.Triangles) -> None:
    def broken(stage: str, fraction: float, size: int) -> None:
        raise RuntimeError(stage)

    with pytest.raises(RuntimeError, match="upload"):
        client.voxelize(ball, resolution=300, progress=broken)


def test_many_threads_share_a_client(client: Client, ball: shapes.Triangles) -> None:
    def one(i: int) -> int:
        return int(client.voxelize(ball, resolution=10 + i % 3).summary.occupied)

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        counts = list(pool.map(one, range(60)))
    assert counts[:3] * 20 == counts


def test_a_kept_mesh_is_sent_again_where_it_is_unknown(client: Client, ball: shapes.Triangles) -> None:
    handle = client.upload(ball)
    assert handle.stored.mesh.triangles == len(ball[1]) and client.upload(ball).already_stored
    expected = client.voxelize(ball, resolution=30)
    assert client.voxelize(handle, resolution=30) == expected
    assert client.release_mesh(handle) > 0
    with pytest.raises(voxelpipe.MeshNotFound) as caught:
        client.stored_mesh(handle)
    assert caught.value.name == handle.name
    assert client.voxelize(pickle.loads(pickle.dumps(handle)), resolution=30) == expected
    assert client.stored_mesh(handle).uses == 1
    client.release_mesh(handle)
    assert list(client.voxelize_many([handle], resolution=30)) == [expected]
    client.release_mesh(handle)
    light = client.upload(ball, keep=False)
    client.release_mesh(light)
    with pytest.raises(voxelpipe.MeshNotFound):
        client.voxelize(light, resolution=30)


def test_new_positions_move_a_kept_mesh(client: Client, ball: shapes.Triangles) -> None:
    handle = client.upload(ball)
    vertices, faces = ball
    moved = client.voxelize(handle, resolution=20, new_positions=vertices * 2 + 5)
    assert moved == client.voxelize((vertices * 2 + 5, faces), resolution=20)
    with pytest.raises(voxelpipe.InvalidRequest):
        client.voxelize(handle, resolution=20, new_positions=vertices[:-1])


def test_many_meshes_come_in_their_order(client: Client) -> None:
    vertices, faces = shapes.TETRAHEDRON
    read: list[int] = []

    def meshes() -> Iterator[shapes.Triangles]:
        for i in range(40):
            read.append(i)
            yield vertices * (1, 1, 1 + i), faces

    for i, grid in enumerate(client.voxelize_many(meshes(), voxel_size=0.25, in_flight=5)):
        assert isinstance(grid, voxelpipe.VoxelGrid) and grid.dims == (4, 4, 4 * (1 + i))
        assert len(read) <= i + 5
    assert len(read) == 40


@pytest.mark.parametrize("in_flight", [1, 2, 3, 300])
def test_many_meshes_with_any_number_in_flight(client: Client, in_flight: int) -> None:
    vertices, faces = shapes.TETRAHEDRON
    meshes = [(vertices * (1, 1, 1 + i % 5), faces) for i in range(400 if in_flight == 300 else 9)]
    grids = list(client.voxelize_many(meshes, voxel_size=0.5, in_flight=in_flight))
    assert [grid.dims[2] for grid in grids if isinstance(grid, voxelpipe.VoxelGrid)] == [
        2 * (1 + i % 5) for i in range(len(meshes))
    ]


def test_errors_of_many_meshes(client: Client) -> None:
    meshes = [shapes.cube(), b"nonsense", shapes.cube(), (numpy.zeros((3, 3)), [[0, 1, 7]])]
    results = list(client.voxelize_many(meshes, resolution=8, errors="return"))
    assert [type(result).__name__ for result in results] == ["VoxelGrid", "InvalidMesh", "VoxelGrid", "InvalidMesh"]
    with pytest.raises(voxelpipe.InvalidMesh):
        list(client.voxelize_many(meshes, resolution=8))


def test_a_file_that_cannot_be_read_takes_the_place_of_its_result(client: Client, tmp_path: pathlib.Path) -> None:
    meshes = [shapes.cube(), tmp_path / "missing.glb", shapes.cube()]
    results = list(client.voxelize_many(meshes, resolution=8, errors="return"))
    assert results[0] == results[2] and isinstance(results[1], voxelpipe.InvalidMesh)
    assert isinstance(results[1].__cause__, FileNotFoundError)
    with pytest.raises(FileNotFoundError):
        list(client.voxelize_many(meshes, resolution=8))


def test_each_of_many_meshes_has_the_timeout(client: Client) -> None:
    meshes = [shapes.cube(), shapes.heavy(), shapes.cube()]
    start = time.monotonic()
    results = list(client.voxelize_many(meshes, resolution=1000, packed_bits=True, timeout=0.6, errors="return"))
    assert isinstance(results[1], voxelpipe.DeadlineExceeded) and time.monotonic() - start < 10


def test_the_timeout_leaves_out_the_callers_own_work(client: Client) -> None:
    for grid in client.voxelize_many([shapes.cube()] * 4, resolution=8, timeout=1.5, in_flight=4):
        assert isinstance(grid, voxelpipe.VoxelGrid)
        time.sleep(0.5)


def test_many_large_results(client: Client, ball: shapes.Triangles) -> None:
    grids = list(client.voxelize_many([ball] * 3, resolution=120, targets="normal:f32", in_flight=2))
    assert grids == [client.voxelize(ball, resolution=120, targets="normal:f32")] * 3


def test_kept_meshes_are_listed(client: Client, ball: shapes.Triangles) -> None:
    file = voxelpipe.load_mesh(b"OFF 3 1 0\n0 0 0\n7 0 0\n0 7 0\n3 0 1 2\n", format="off", unit="in")
    first, last = client.upload(ball), client.upload(file)
    assert last.name == file.stored_name() and last.name.endswith("-in-off")
    listed = [mesh.name for mesh in client.meshes()]
    assert last.name in listed and listed.index(last.name) < listed.index(first.name)
    assert client.release_mesh(last) > 0
    assert last.name not in [mesh.name for mesh in client.meshes()]


def test_questions(client: Client, ball: shapes.Triangles) -> None:
    info = client.server_info()
    assert "cpu" in info.backends and info.limits["max_triangles"] > 0 and info.devices
    assert info.contract_revision == CONTRACT_REVISION and info.limits["batch_jobs"] > 0
    shaders = {shader.name: shader for shader in client.shaders()}
    assert shaders["constant"].parameters[0].type == "vec4" and shaders["skin"].stage == "vertex"
    estimate = client.estimate(ball, resolution=64, targets="u8:add")
    grid = client.voxelize(ball, resolution=64, targets="u8:add")
    assert estimate.result_bytes == grid.nbytes and estimate.place == grid.place
    assert estimate.time_class in ("instant", "short") and grid.summary.backend in info.backends
    assert info.backends[grid.summary.backend] == grid.summary.simd and grid.summary.voxelize_ms > 0
    assert client.estimate(client.upload(ball), resolution=64).place == grid.place


def test_tokens_and_tls(server: LocalServer, tmp_path: pathlib.Path, closed_port: str) -> None:
    key, cert = tmp_path / "key.pem", tmp_path / "cert.pem"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "2",
            "-keyout",
            key,
            "-out",
            cert,
            "-subj",
            "/CN=tests",
            "-addext",
            "subjectAltName=DNS:voxels.test",
        ],
        check=True,
        capture_output=True,
    )
    tokens = tmp_path / "tokens.json"
    tokens.write_text('{"clients": [{"name": "tests", "token": "a-token-of-32-characters-or-more-0", "role": "user"}]}')
    options = [
        "--tls-cert",
        str(cert),
        "--tls-key",
        str(key),
        "--tls-client-ca",
        str(cert),
        "--token-file",
        str(tokens),
    ]
    with voxelpipe.local_server(options=options) as guarded:
        tls = Tls(str(cert), str(cert), str(key), "voxels.test")
        token = tmp_path / "token"
        token.write_text("a wrong-one".replace(" ", "-"))
        client = Client(guarded.server, tls=tls, token_file=token)
        with pytest.raises(voxelpipe.Unauthenticated):
            client.voxelize(shapes.cube(), resolution=8)
        token.write_text("a-token-of-32-characters-or-more-0\n")
        assert client.voxelize(shapes.cube(), resolution=8).dims == (8, 8, 8)
        with pytest.raises(voxelpipe.Unavailable):
            Client(guarded.server, tls=Tls(str(cert), server_name="voxels.test"), retries=0).server_info()
        with pytest.raises(voxelpipe.Unavailable):
            Client(guarded.server, retries=0).server_info()
    with pytest.raises(voxelpipe.InvalidRequest, match="plain text"):
        Client("voxels.test:50051", token="secret")
    with pytest.raises(voxelpipe.InvalidRequest, match="none.pem"):
        Client(closed_port, tls=Tls("none.pem")).server_info()

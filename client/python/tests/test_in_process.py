"""voxelize() in this process, by voxelpipe_core: bytes, errors, progress as of a server; Ctrl-C, threads, forks."""
from __future__ import annotations

import ast
import asyncio
import ctypes
import importlib.util
import json
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe._calls import core_module
from voxelpipe.local_server import LocalServer

from . import shapes
from .test_processes import environment

pytestmark = pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")

REQUESTS = [
    {"resolution": 40},
    {"resolution": 33, "packed_bits": True},
    {"resolution": 24, "fill": "parity", "normal": "normal:f32", "color": "base_color:srgb8"},
    {"resolution": 30, "result": "sparse", "targets": ["bit", "f32x3:average:shader=normal"], "layout": "planar"},
    {"resolution": 20, "result": "buckets", "coverage": "thin", "targets": "u32:replace:shader=triangle_id"},
    {"dims": (5, 4, 3), "origin": (9, 9, 9), "voxel_size": 0.1},
    {"resolution": 20, "axes": "-y,z,x", "clip": (-0.5, -2, 0.1, 0.5, 2, 0.8), "padding": 1, "normal": "normal:f32"},
]


@pytest.fixture(autouse=True)
def without_server(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)


@pytest.mark.parametrize("options", REQUESTS)
def test_the_bytes_are_those_of_a_server(
    ball: shapes.Triangles, server: LocalServer, options: dict[str, object]
) -> None:
    inside = voxelpipe.voxelize(ball, **options)  # type: ignore[arg-type]
    served = voxelpipe.voxelize(ball, server=server.server, **options)  # type: ignore[arg-type]
    assert inside == served
    assert inside.sha256 == served.sha256
    assert inside.summary.occupied == served.summary.occupied
    assert inside.summary.mesh == served.summary.mesh
    assert inside.warnings == served.warnings
    assert set(inside.summary.stages) == set(served.summary.stages)


@pytest.mark.parametrize(
    "options",
    [
        {"resolution": "50"},
        {"resolution": "40", "axes": "x,z,-y", "clip": "-0.5,-0.6,0.1,0.7,2,0.8", "padding": "2"},
        {"voxel_size": "0.03", "axes": "-y,x,z", "clip": "0,0,0,1,1,1.5", "fill": "parity"},
        {"dims": "30,20,10", "clip": "-2,-0.5,-0.3,0.2,0.5,0.6"},
        {"resolution": "30", "axes": "z,y,x", "vertex_shader": "transform:matrix=1/0/0/2/0/3/0/0/0/0/1/0/0/0/0/1"},
    ],
)
def test_the_bytes_are_those_of_the_command_line(
    cli: str, ball: shapes.Triangles, tmp_path: pathlib.Path, server: LocalServer, options: dict[str, str]
) -> None:
    file = tmp_path / "ball.glb"
    file.write_bytes(bytes(voxelpipe.load_mesh(ball).data))
    flags = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    told = json.loads(subprocess.check_output([cli, "voxelize", file, "--json", *flags]))
    given: dict[str, Any] = {
        name: value if name in ("axes", "clip", "fill", "vertex_shader") else ast.literal_eval(value)
        for name, value in options.items()
    }
    for client in (voxelpipe.InProcessClient(), server.client()):
        with client:
            grid = client.voxelize(file, **given)
            place = [*grid.dims], [*grid.origin_corner], [*grid.voxel_size]
            assert grid.sha256 == told["hash"] and place == (told["dims"], told["origin"], told["voxel_size"])
            assert grid.summary.occupied > 0
            assert client.estimate(file, **given).place == grid.place
            assert [*client.voxelize_many([file], **given)] == [grid]

    async def asked(address: str) -> voxelpipe.VoxelGrid:
        async with voxelpipe.AsyncClient(address) as client:
            return await client.voxelize(file, **given)

    assert [asyncio.run(asked(address)).sha256 for address in ("", server.server)] == [told["hash"]] * 2


def test_arrays_are_writable_and_own_their_memory(ball: shapes.Triangles) -> None:
    grid = voxelpipe.voxelize(ball, resolution=16, normal="normal:f32")
    kept, mask = grid.normal, grid.mask
    before = kept.copy()
    del grid
    for _ in range(3):
        voxelpipe.voxelize(ball, resolution=16, normal="normal:f32")
    assert numpy.array_equal(kept, before)
    assert kept.flags.c_contiguous and kept.flags.writeable and mask.flags.writeable
    kept[:] = 0
    assert not kept.any()


def test_errors_have_the_classes_and_fields_of_a_servers(ball: shapes.Triangles, server: LocalServer) -> None:
    for options in (
        {"resolution": 8, "targets": "f32:or:shader=normal"},
        {"resolution": 8, "shader": "no_such_shader"},
        {"resolution": 1 << 19, "targets": "f32x4:replace:shader=normal"},
    ):
        raised = []
        for where in (None, server.server):
            with pytest.raises(voxelpipe.VoxelpipeError) as caught:
                voxelpipe.voxelize(ball, server=where, **options)  # type: ignore[arg-type]
            raised.append(caught.value)
        assert type(raised[0]) is type(raised[1])
        assert raised[0].code == raised[1].code
        assert getattr(raised[0], "field", "") == getattr(raised[1], "field", "")
    with pytest.raises(voxelpipe.InvalidMesh):
        voxelpipe.voxelize(b"glTF is not what this is", resolution=8)


def test_a_timeout_ends_the_job() -> None:
    with pytest.raises(voxelpipe.DeadlineExceeded):
        voxelpipe.voxelize(shapes.heavy(), resolution=900, timeout=0.05)


def test_progress_is_told_and_its_exception_ends_the_job(ball: shapes.Triangles) -> None:
    told: list[tuple[str, float]] = []
    voxelpipe.voxelize(ball, resolution=64, progress=lambda stage, fraction, size: told.append((stage, fraction)))
    assert {"load", "flatten"} <= {stage for stage, _ in told}
    assert all(0 <= fraction <= 1 for _, fraction in told)

    def refuse(stage: str, fraction: float, size: int) -> None:
        raise LookupError(stage)

    with pytest.raises(LookupError):
        voxelpipe.voxelize(ball, resolution=64, progress=refuse)


def test_other_threads_run_meanwhile() -> None:
    ticks: list[float] = []
    ended = threading.Event()

    def tick() -> None:
        while not ended.wait(0.002):
            ticks.append(time.monotonic())

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.monotonic()
    try:
        voxelpipe.voxelize(shapes.heavy(), resolution=200)
    finally:
        end = time.monotonic()
        ended.set()
        thread.join()
    during = [moment for moment in ticks if begin < moment < end]
    assert len(during) >= min(5.0, (end - begin) / 0.1), "the GIL was held"


def at_the_same_time(ball: shapes.Triangles, count: int) -> list[voxelpipe.VoxelGrid]:
    together = threading.Barrier(count)
    grids: list[voxelpipe.VoxelGrid] = []

    def call() -> None:
        first = True

        def meet(*_: object) -> None:
            nonlocal first
            if first:
                first = False
                together.wait(30)  # BrokenBarrierError unless all jobs are running

        grids.append(voxelpipe.voxelize(ball, resolution=16, progress=meet))

    callers = [threading.Thread(target=call) for _ in range(count)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    return grids


def test_calls_one_after_the_other_run_on_one_thread(ball: shapes.Triangles) -> None:
    # A new thread has no memory yet: each call took a third longer, to map and clear its pages. Those that ran at the
    # same time before are all idle: only the last one is used.
    at_the_same_time(ball, 3)
    ran_on: set[int] = set()
    for _ in range(5):
        voxelpipe.voxelize(ball, resolution=16, progress=lambda *_: ran_on.add(threading.get_native_id()))
    assert len(ran_on) == 1 and threading.get_native_id() not in ran_on


def test_calls_of_several_threads_run_at_the_same_time(ball: shapes.Triangles) -> None:
    expected = voxelpipe.voxelize(ball, resolution=16)
    grids = at_the_same_time(ball, 4)
    assert len(grids) == 4 and all(grid == expected for grid in grids)


def script(code: str, folder: pathlib.Path) -> "subprocess.Popen[str]":
    """A process of its own, without a server's address."""
    (folder / "client_tests").symlink_to(pathlib.Path(__file__).parent)
    variables = environment(folder, *map(pathlib.Path, os.environ.get("PYTHONPATH", "").split(os.pathsep)))
    variables.pop("VOXELPIPE_SERVER", None)
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)],
        env=variables,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def test_ctrl_c_ends_the_job_soon(tmp_path: pathlib.Path) -> None:
    process = script(
        """
        import time, voxelpipe
        from client_tests import shapes
        mesh = voxelpipe.load_mesh(shapes.heavy())
        voxelpipe.voxelize(mesh, resolution=8)
        print("begins", flush=True)
        try:
            voxelpipe.voxelize(mesh, resolution=300, result="sparse", normal="normal:f32x3:average")
        except KeyboardInterrupt:
            print("interrupted", time.time(), flush=True)
        """,
        tmp_path,
    )
    assert process.stdout is not None and process.stdout.readline() == "begins\n", process.communicate()
    time.sleep(0.3)
    sent = time.time()
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert output.startswith("interrupted "), (output, errors)
    assert float(output.split()[1]) - sent < 5  # far less, but for a busy machine


def test_a_forked_child_waits_for_no_thread_of_its_parent(tmp_path: pathlib.Path) -> None:
    process = script(
        """
        import os, voxelpipe
        from voxelpipe._calls import in_process
        from voxelpipe._calls.session import Job
        from voxelpipe.options import make_request
        from client_tests import shapes
        mesh = voxelpipe.load_mesh(shapes.TETRAHEDRON)
        first = voxelpipe.voxelize(mesh, resolution=12)
        child = os.fork()
        if child == 0:
            same = in_process.run(Job(make_request(resolution=12), mesh), 30, None) == first
            os._exit(0 if same else 3)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        """,
        tmp_path,
    )
    output, errors = process.communicate(timeout=60)
    assert output == "0\n", errors


def test_a_forked_child_takes_a_server(tmp_path: pathlib.Path) -> None:
    process = script(
        """
        import os, voxelpipe
        from voxelpipe._calls import core_module
        from client_tests import shapes
        first = voxelpipe.voxelize(shapes.TETRAHEDRON, resolution=12)
        assert core_module.available()
        child = os.fork()
        if child == 0:
            assert not core_module.available()
            same = voxelpipe.voxelize(shapes.TETRAHEDRON, resolution=12) == first
            voxelpipe.shutdown()
            os._exit(0 if same else 3)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        """,
        tmp_path,
    )
    output, errors = process.communicate(timeout=60)
    assert output == "0\n", errors


def on_a_gpu(ball: shapes.Triangles, **options: object) -> voxelpipe.DeviceGrid:
    try:
        return voxelpipe.voxelize_on_device(ball, **options)  # type: ignore[arg-type]
    except voxelpipe.NotAvailable as error:
        if "slab" in str(error):
            raise
        pytest.skip(f"no GPU: {error}")


def test_results_stay_on_the_gpu_with_the_same_bytes(ball: shapes.Triangles) -> None:
    options = {"resolution": 40, "color": "base_color:srgb8", "normal": "normal:f32:average"}
    grid = on_a_gpu(ball, **options)
    expected = voxelpipe.voxelize(ball, packed_bits=True, **options)  # type: ignore[arg-type]
    driver = ctypes.CDLL("libcuda.so.1")
    context = ctypes.c_void_p()  # that of the runtime, which this thread has not used
    assert driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), 0) == 0 and driver.cuCtxSetCurrent(context) == 0
    assert list(grid.arrays) == ["mask", "color", "normal"]
    for name, array in grid.arrays.items():
        interface = array.__cuda_array_interface__
        there = numpy.empty(array.shape, array.dtype)
        copied = driver.cuMemcpyDtoH_v2(
            ctypes.c_void_p(there.ctypes.data),
            ctypes.c_uint64(interface["data"][0]),
            ctypes.c_size_t(array.nbytes),
        )
        assert copied == 0
        assert there.tobytes() == expected.stored[name].tobytes()
        assert array.__dlpack_device__() == (2, 0)
        assert '"dltensor"' in repr(array.__dlpack__())  # freed by its own destructor
    torch = pytest.importorskip("torch") if importlib.util.find_spec("torch") else None
    if torch is not None and torch.cuda.is_available():
        assert torch.from_dlpack(grid["normal"]).cpu().numpy().tobytes() == expected["normal"].tobytes()


def test_lists_are_refused_before_the_run(ball: shapes.Triangles) -> None:
    with pytest.raises(voxelpipe.NotAvailable, match="only dense results stay on a GPU, not sparse"):
        voxelpipe.voxelize_on_device(ball, resolution=8, result="sparse")


def test_without_a_gpu_nothing_stays_on_one(ball: shapes.Triangles) -> None:
    try:
        voxelpipe.voxelize_on_device(ball, resolution=8)
    except voxelpipe.NotAvailable as error:
        assert "CUDA" in str(error)
    else:
        pytest.skip("there is a GPU")

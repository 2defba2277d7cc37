"""Clients and processes: Ctrl-C, forks, pickles, and servers of one's own. Scripts run in fresh processes."""
from __future__ import annotations

import os
import pathlib
import pickle
import signal
import subprocess
import sys
import textwrap
import time
import urllib.parse

import pytest

import voxelpipe
from voxelpipe import Client, LocalServer
from voxelpipe.local_server import find_program

HERE = pathlib.Path(__file__).parent

COMMON = """
    import multiprocessing, os, signal, sys, threading, time
    import voxelpipe
    from client_tests import shapes
    client = voxelpipe.Client(sys.argv[1])

    def occupied(scale):
        vertices, faces = shapes.TETRAHEDRON
        return client.voxelize((vertices * scale, faces), resolution=24, normal="normal:f32").summary.occupied

    def late(_):
        try:
            client.voxelize(shapes.heavy(), resolution=900, timeout=0.5)
        except voxelpipe.VoxelpipeError as error:
            return error.code
"""


def output_of(script: str, server: LocalServer, folder: pathlib.Path) -> list[str]:
    """The lines that a script prints, in a process of its own."""
    (folder / "client_tests").symlink_to(HERE)
    code = textwrap.dedent(COMMON) + textwrap.dedent(script)
    ran = subprocess.run(
        [sys.executable, "-c", code, server.server], capture_output=True, text=True, timeout=60, env=environment(folder)
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.split("\n")[:-1]


def environment(*paths: pathlib.Path) -> dict[str, str]:
    """The variables of a process that finds this package."""
    package = pathlib.Path(voxelpipe.__file__).parents[1]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (package, *paths)))}


INTERRUPTED = """
    handle = client.upload(shapes.heavy())
    for options in ({"resolution": 900}, {"resolution": 120}):
        sent = []
        def fire():
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)
        threading.Timer(0.3, fire).start()
        try:
            while True:
                client.voxelize(handle, packed_bits=True, **options)
        except KeyboardInterrupt:
            print(time.monotonic() - sent[0])
    sent = []
    threading.Timer(0.3, fire).start()
    try:
        list(client.voxelize_many([handle] * 4, resolution=900, packed_bits=True))
    except KeyboardInterrupt:
        print(time.monotonic() - sent[0])
    print(client.server_info().version)
"""


def test_ctrl_c_ends_a_call_within_100_ms(server: LocalServer, tmp_path: pathlib.Path) -> None:
    lines = output_of(INTERRUPTED, server, tmp_path)
    assert len(lines) == 4 and max(float(line) for line in lines[:3]) < 0.1


FORKED = """
    expected = occupied(1)
    for _ in range(3):
        with multiprocessing.get_context("fork").Pool(3) as pool:
            assert pool.map_async(occupied, [1, 2, 3, 4, 5, 6]).get(timeout=30) == [expected] * 6
            assert pool.map_async(late, [0]).get(timeout=30) == ["DEADLINE_EXCEEDED"]
        assert occupied(1) == expected
    print("done")
"""


def test_forked_children_open_connections_of_their_own(server: LocalServer, tmp_path: pathlib.Path) -> None:
    assert output_of(FORKED, server, tmp_path) == ["done"]


def test_a_client_pickles_as_its_options(server: LocalServer) -> None:
    client = Client(server.server, timeout=7, tls=False, retries=5)
    client.server_info()
    copy = pickle.loads(pickle.dumps(client))
    assert copy._connection.options == client._connection.options and copy.server_info() == client.server_info()


def test_a_local_server_ends_with_its_process(server: LocalServer) -> None:
    code = "import voxelpipe, os, time; s = voxelpipe.local_server(); print(s.server, flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment())
    assert process.stdout is not None
    address = process.stdout.readline().strip()
    assert Client(address).server_info().version
    process.send_signal(signal.SIGKILL)
    process.wait()
    end = time.monotonic() + 20
    while time.monotonic() < end:
        try:
            Client(address, retries=0).server_info()
        except voxelpipe.VoxelpipeError:
            break
        time.sleep(0.1)
    else:
        pytest.fail("the server still answers")
    folder = pathlib.Path(urllib.parse.unquote(address.removeprefix("unix:"))).parent
    while folder.exists() and time.monotonic() < end:
        time.sleep(0.1)
    assert not folder.exists()


@pytest.mark.parametrize("name", ["n" * 90, "long/" + "n" * 200, "a b%20c#d?e", "\u00fc\u6e29"])
def test_a_local_server_starts_whatever_the_temporary_folder_is_called(
    server: LocalServer, tmp_path: pathlib.Path, name: str
) -> None:
    folder = tmp_path / name
    folder.mkdir(parents=True)
    code = """
import voxelpipe
with voxelpipe.local_server() as server, server.client() as client:
    print(client.server_info().version)
print(server.server)
"""
    environ = {**environment(), "TMPDIR": str(folder)}
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environ)
    assert ran.returncode == 0, ran.stderr
    path = pathlib.Path(urllib.parse.unquote(ran.stdout.split("\n")[1].removeprefix("unix:")))
    assert len(os.fsencode(path)) <= 107
    assert not path.parent.exists() and not list(folder.iterdir()), "nothing is left"


def test_the_program_of_the_wheel_is_found(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "voxelpipe_core" / "bin" / "voxelpiped"
    program.parent.mkdir(parents=True)
    (tmp_path / "voxelpipe_core" / "__init__.py").write_text("raise ImportError('need not be loaded')")
    program.touch(0o755)
    monkeypatch.delitem(sys.modules, "voxelpipe_core", raising=False)
    monkeypatch.delenv("VOXELPIPE_VOXELPIPED", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_program() == str(program)


def test_a_local_server_that_does_not_start_says_why(server: LocalServer) -> None:
    with pytest.raises(voxelpipe.Unavailable, match="--no-such-option"):
        voxelpipe.local_server(options=["--no-such-option"])
    with pytest.raises(voxelpipe.Unavailable, match="does not start"):
        voxelpipe.local_server(program="/bin/false")

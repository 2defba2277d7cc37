"""The package as users get it: types, the wheel, the README's first lines."""
from __future__ import annotations

import inspect
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

import voxelpipe
from voxelpipe._mesh.glb import write_glb

from . import shapes

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE.parent


def run(*command: object, **options: object) -> str:
    ran = subprocess.run([*map(str, command)], capture_output=True, text=True, **options)  # type: ignore[call-overload]
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return str(ran.stdout)


def test_types_are_strict(tmp_path: pathlib.Path) -> None:
    if not shutil.which("mypy"):
        pytest.skip("mypy is not installed")
    run("mypy", "--cache-dir", os.environ.get("VOXELPIPE_MYPY_CACHE", tmp_path), cwd=PACKAGE)


def test_lines_have_at_most_120_columns() -> None:
    for path in PACKAGE.rglob("*.py"):
        if "_proto" in path.parts or "build" in path.parts:
            continue
        lines = path.read_text(encoding="utf-8").splitlines()
        assert len(lines) < 500, path
        assert [number for number, line in enumerate(lines, 1) if len(line) > 120] == [], path


def test_no_private_names_of_protobuf_and_grpc() -> None:
    private = re.compile(r"google\.protobuf\.internal|google\.protobuf\.pyext|symbol_database|grpc\._|_descriptor\._")
    for path in (PACKAGE / "voxelpipe").rglob("*.py"):
        assert not private.search(path.read_text(encoding="utf-8")), path


def test_the_messages_are_the_same_in_every_implementation_of_protobuf() -> None:
    script = (
        "from google.protobuf import any_pb2, duration_pb2; from voxelpipe.options import make_request; "
        "from voxelpipe._proto.google.rpc import status_pb2; from voxelpipe._proto.voxelpipe.v1 import types_pb2 as t; "
        "message = make_request(axes='x,z,-y', color='base_color:srgb8', padding=2, content_hash=True).message; "
        "status = status_pb2.Status(code=3); status.details.add().Pack(t.Dims(x=-1, y=1 << 40)); "
        "print(message.SerializeToString().hex(), status.SerializeToString().hex(), t.Backend.Name(t.BACKEND_CPU))"
    )
    environment = dict(os.environ)
    ours = run(sys.executable, "-c", script, cwd=PACKAGE, env=environment)
    environment["PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION"] = "python"
    assert run(sys.executable, "-c", script, cwd=PACKAGE, env=environment) == ours and "BACKEND_CPU" in ours


def test_both_clients_have_the_same_calls() -> None:
    def parameters(client: type, name: str) -> list[inspect.Parameter]:
        listed = inspect.signature(getattr(client, name)).parameters.values()
        return [one for one in listed if (name, one.name) != ("voxelize_many", "meshes")]  # also an async iterable

    def calls(client: type) -> set[str]:
        return {name for name, value in vars(client).items() if name[0] != "_" and callable(value)}

    assert calls(voxelpipe.AsyncClient) - {"aclose"} == calls(voxelpipe.Client) - {"close", "run", "max_message_bytes"}
    for name in (*calls(voxelpipe.AsyncClient) - {"aclose"}, "__init__"):
        assert parameters(voxelpipe.Client, name) == parameters(voxelpipe.AsyncClient, name), name


def test_the_wheel_runs_the_readme(server: voxelpipe.LocalServer, tmp_path: pathlib.Path) -> None:
    if not shutil.which("protoc"):
        pytest.skip("protoc is not installed")
    if not (PACKAGE.parents[1] / "proto").is_dir():
        pytest.skip("the .proto files are not there")
    source = tmp_path / "tree" / "client" / "python"
    shutil.copytree(
        PACKAGE, source, ignore=shutil.ignore_patterns("build", "*.egg-info", "_proto", ".*", "__pycache__")
    )
    (tmp_path / "tree" / "proto").symlink_to(PACKAGE.parents[1] / "proto")
    wheels = tmp_path / "wheels"
    run(sys.executable, "-m", "pip", "wheel", "--no-index", "--no-build-isolation", "--no-deps", "-w", wheels, source)
    (wheel,) = wheels.glob("voxelpipe-*-py3-none-any.whl")
    # Without pip of its own, which takes seconds to install: the system's is there too.
    run(sys.executable, "-m", "venv", "--without-pip", "--system-site-packages", tmp_path / "venv")
    python = tmp_path / "venv" / "bin" / "python"
    run(python, "-m", "pip", "install", "--no-index", "--no-deps", wheel)
    work = tmp_path / "work"
    work.mkdir()
    (work / "bunny.glb").write_bytes(write_glb(voxelpipe.Mesh(*shapes.ball())))
    blocks = re.findall(r"^```python\n(.*?)^```", (PACKAGE / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    variables = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VOXELPIPE_SERVER")}
    printed = run(python, "-c", blocks[0] + "print(voxelpipe.__file__)", cwd=work, env=variables)
    assert "<VoxelGrid dense: 128 x 128 x 128 voxels" in printed
    assert str(tmp_path / "venv") in printed.splitlines()[-1]
    assert (work / "bunny.png").read_bytes().startswith(b"\x89PNG")

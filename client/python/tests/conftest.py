"""Fixtures. VOXELPIPE_VOXELPIPED names the server's program, VOXELPIPE_CLI the command line's."""
from __future__ import annotations

import os
import shutil
import socket
from typing import Iterator

import pytest

import voxelpipe
from voxelpipe.local_server import find_program

from . import shapes


@pytest.fixture(scope="session")
def server() -> Iterator[voxelpipe.LocalServer]:
    """A server for all tests."""
    try:
        find_program()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    with voxelpipe.local_server() as started:
        os.environ["VOXELPIPE_SERVER"] = started.server
        yield started
        del os.environ["VOXELPIPE_SERVER"]
        voxelpipe.shutdown()


@pytest.fixture()
def client(server: voxelpipe.LocalServer) -> Iterator[voxelpipe.Client]:
    """A client of it."""
    with server.client() as opened:
        yield opened


@pytest.fixture()
def closed_port() -> Iterator[str]:
    """An address at which no server listens: bound, so that no other process listens there, and a call is refused."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        yield f"127.0.0.1:{bound.getsockname()[1]}"


@pytest.fixture(scope="session")
def cli() -> str:
    """The path of the program `voxelpipe`."""
    path = os.environ.get("VOXELPIPE_CLI") or shutil.which("voxelpipe")
    if not path or not os.access(path, os.X_OK):
        pytest.skip("the program voxelpipe is not there; VOXELPIPE_CLI names it")
    return path


@pytest.fixture(scope="session")
def ball() -> shapes.Triangles:
    """A closed ball of radius 1 about the origin."""
    return shapes.ball()

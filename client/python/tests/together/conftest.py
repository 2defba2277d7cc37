"""Clients for tests of meshes together, their parts and the table of parts."""
from __future__ import annotations

from typing import Iterator

import pytest

from voxelpipe import Client, InProcessClient, LocalServer
from voxelpipe._calls import core_module


@pytest.fixture(params=["in process", "server"])
def client(request: pytest.FixtureRequest) -> Iterator[Client]:
    """A client of this process, and one of a server."""
    if request.param == "server":
        server: LocalServer = request.getfixturevalue("server")
        with server.client() as served:
            yield served
        return
    if not core_module.available():
        pytest.skip("voxelpipe_core is not installed")
    with InProcessClient() as inside:
        yield inside

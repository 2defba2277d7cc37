#!/usr/bin/env python3
"""What the client costs: large results beside a bare gRPC stream of the same messages, memory, and small calls.

usage: transport.py [--server ADDRESS] [--resolution N] [--repeat N] [--seconds S]

Prints MB/s of a dense u8 result by Client.voxelize and by a grpcio stream whose messages are dropped (medians of runs
in turn), the peak memory above that of the result, and calls a second of a small mesh, by one client and by
voxelize_many; `voxelpipe bench MESH --server ADDRESS` gives the latter for C++.
"""
import argparse
import pathlib
import statistics
import time
from typing import Callable, Iterator

import numpy

import voxelpipe
from voxelpipe._calls.connection import Connection
from voxelpipe._calls.progress import Reporter
from voxelpipe._calls.session import Job
from voxelpipe.options import make_request

QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
CUBE = voxelpipe.load_mesh((numpy.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], float), QUADS))
LARGE = "u8:replace"
SMALL = 16


def seconds(call: Callable[[], object]) -> float:
    """How long a call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def bare(client: voxelpipe.Client, messages: list[bytes]) -> int:
    """The same requests on a stream of grpcio, whose responses are dropped. Out: their bytes."""
    connection: Connection = client._connection
    call, _ = connection.stream("VoxelizeUpload", iter(messages), None)
    return sum(len(message) for message in call)


def memory(name: str) -> int:
    """A figure of /proc/self/status, in bytes."""
    text = pathlib.Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = (line for line in text.splitlines() if line.startswith(f"{name}:"))
    return int(line.split()[1]) * 1024


def large_results(client: voxelpipe.Client, resolution: int, repeat: int) -> None:
    """Prints throughput and memory of large results."""
    request = make_request(resolution=resolution, targets=LARGE)
    messages = list(Job(request, CUBE).upload(Reporter(None)))
    bare(client, messages)  # connects, and warms the server
    before = memory("VmRSS")
    pathlib.Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # VmHWM starts anew
    grid = client.voxelize(CUBE, resolution=resolution, targets=LARGE)
    above = memory("VmHWM") - before - grid.nbytes
    size = grid.nbytes
    del grid
    ours: list[float] = []
    theirs: list[float] = []
    for _ in range(repeat):
        theirs.append(seconds(lambda: bare(client, messages)))
        ours.append(seconds(lambda: client.voxelize(CUBE, resolution=resolution, targets=LARGE)))
    rates = [size / statistics.median(times) / 1e6 for times in (ours, theirs)]
    print(f"{resolution}^3 u8: {rates[0]:.0f} MB/s, bare stream {rates[1]:.0f} MB/s: {rates[0] / rates[1]:.0%}")
    print(f"peak memory above the result: {above / 2**20:.0f} MiB")


def small_calls(client: voxelpipe.Client, duration: float) -> None:
    """Prints calls a second."""
    handle = client.upload(CUBE)

    def handles() -> Iterator[voxelpipe.MeshHandle]:
        end = time.perf_counter() + duration
        while time.perf_counter() < end:
            yield handle

    for name, results in (
        ("one after another", (client.voxelize(mesh, resolution=SMALL) for mesh in handles())),
        ("voxelize_many, 32 in flight", client.voxelize_many(handles(), in_flight=32, resolution=SMALL)),
    ):
        start = time.perf_counter()
        count = sum(1 for _ in results)
        print(f"small mesh, {name}: {count / (time.perf_counter() - start):.0f} calls a second")


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--server", default="", help="default: VOXELPIPE_SERVER, else a server for the time of this run"
    )
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=3.0)
    given = parser.parse_args()
    with voxelpipe.Client(given.server or voxelpipe.default_client().server) as client:
        large_results(client, given.resolution, given.repeat)
        small_calls(client, given.seconds)


if __name__ == "__main__":
    main()

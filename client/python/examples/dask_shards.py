#!/usr/bin/env python3
"""Thousands of meshes on a dask cluster: packed occupancy, as arrays in this process or as shards on a shared disk.

usage: dask_shards.py MESH_FOLDER [OUT_FOLDER] [--resolution N] [--shard N] [--workers N] [--scheduler ADDRESS]

A task is a shard: --shard meshes in the order of their names. dask runs the tasks of a worker that died again on others
(up to distributed.scheduler.allowed-failures times each); a mesh gives the same bytes wherever it runs, so that costs
time alone. Without OUT_FOLDER the arrays come here. With it each task writes shard-00000.npz, ... which appears when it
is complete: `names` (n), paths from the folder, `bits` uint8 (n, bytes), cubes of resolution^3 voxels (see
training_set.py), and `failed`, one line for each mesh that is not in it. A further run makes what is missing. Without
--scheduler the cluster is on this machine. The last line has the SHA-256 of all bits in order.
"""
import argparse
import hashlib
import os
import pathlib
import time
from typing import Any

import distributed
import numpy
import numpy.typing

import voxelpipe

SUFFIXES = (".glb", ".gltf", ".drc", ".stl", ".ply", ".off", ".obj", ".3mf")
RETRIES = 3  # of a task whose server was away


# What one task makes: names, bits with a row a name, a line for each mesh that failed.
Shard = tuple[list[str], numpy.typing.NDArray[numpy.uint8], list[str]]


def voxelize(names: list[str], folder: str, resolution: int, client: voxelpipe.Client) -> Shard:
    """Runs in a worker; the client arrives there as its options. Errors: those that another try may not have."""
    done: list[str] = []
    failed: list[str] = []
    bits = numpy.zeros((len(names), (resolution**3 + 7) // 8), numpy.uint8)
    meshes = [os.path.join(folder, name) for name in names]
    results = client.voxelize_many(
        meshes, resolution=resolution, fit="cube", fill="parity", packed_bits=True, in_flight=32, errors="return"
    )
    for name, result in zip(names, results):
        if not isinstance(result, voxelpipe.VoxelpipeError):
            bits[len(done)] = result.packed()
            done.append(name)
        elif result.retryable:
            raise result
        else:
            failed.append(f"{name}: {result}")
    return done, bits[: len(done)], failed


def read(path: pathlib.Path) -> Shard:
    """A shard that was written."""
    with numpy.load(path) as arrays:
        return arrays["names"].tolist(), arrays["bits"], arrays["failed"].tolist()


def voxelize_to_disk(path: str, *arguments: Any) -> str:
    """The same, into a file. Two workers may write one shard, if dask takes a slow one for dead: the same bytes."""
    names, bits, failed = voxelize(*arguments)
    part = f"{path}.{os.uname().nodename}-{os.getpid()}.part"
    with open(part, "wb") as file:
        numpy.savez_compressed(file, names=numpy.array(names, str), bits=bits, failed=numpy.array(failed, str))
    os.replace(part, path)
    return path


def is_of(shard: Shard, chunk: list[str], resolution: int) -> bool:
    """True if the shard was made of these meshes at this resolution."""
    names, bits, failed = shard
    return (
        set(names) <= set(chunk)
        and len(names) + len(failed) == len(chunk)
        and (not len(bits) or bits.shape[1] == (resolution**3 + 7) // 8)
    )


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path, nargs="?")
    parser.add_argument("--resolution", type=int, default=32)
    parser.add_argument("--shard", type=int, default=200, help="meshes a shard")
    parser.add_argument("--workers", type=int, default=2, help="of the cluster on this machine")
    parser.add_argument("--scheduler", help="its address; default: a cluster on this machine")
    given = parser.parse_args()
    folder = given.folder.resolve()
    names = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    if not names:
        parser.error(f"{folder}: no meshes are below it")
    chunks = [names[first : first + given.shard] for first in range(0, len(names), given.shard)]
    client = voxelpipe.default_client()
    options = {"n_workers": given.workers, "threads_per_worker": 1, "dashboard_address": None}
    begin = time.monotonic()
    with distributed.Client(given.scheduler) if given.scheduler else distributed.Client(**options) as dask:
        shards: dict[int, Shard] = {}
        tasks = {}
        for number, chunk in enumerate(chunks):
            arguments = (chunk, str(folder), given.resolution, client)
            if given.out is None:
                tasks[dask.submit(voxelize, *arguments, retries=RETRIES)] = number
                continue
            given.out.mkdir(parents=True, exist_ok=True)
            path = given.out.resolve() / f"shard-{number:05}.npz"
            if path.exists():
                shards[number] = read(path)
                if not is_of(shards[number], chunk, given.resolution):
                    parser.error(f"{path} is of other meshes, or of another resolution; choose another OUT_FOLDER")
            else:
                tasks[dask.submit(voxelize_to_disk, str(path), *arguments, retries=RETRIES)] = number
        # Each result is fetched as soon as it is there: a worker that dies then loses only what it works on.
        for task, result in distributed.as_completed(tasks, with_results=True):
            shards[tasks.pop(task)] = read(pathlib.Path(result)) if isinstance(result, str) else result
            print(f"{len(shards)} of {len(chunks)} shards", flush=True)
        seconds = time.monotonic() - begin
    bits = numpy.concatenate([shards[number][1] for number in range(len(chunks))])
    failed = [line for number in range(len(chunks)) for line in shards[number][2]]
    for line in failed:
        print(line)
    digest = hashlib.sha256(bits.tobytes()).hexdigest()
    print(f"{len(bits)} meshes, {len(failed)} failed, {len(names) / seconds:.0f} a second, sha256 {digest}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""A training set of the meshes below a folder: shards of packed occupancy. A run that was interrupted goes on.

usage: training_set.py MESH_FOLDER OUT_FOLDER [--resolution N] [--shard N] [--in-flight N]

Out: shard-00000.npz, ... each of the same meshes in every run: `names` (n), paths from the folder, and `bits` uint8
(n, bytes), cubes of resolution^3 voxels: numpy.unpackbits(bits, axis=1, count=N**3, bitorder="little").reshape(-1, N,
N, N) gives (n, z, y, x). Meshes that failed or are empty are not in it; failed-00000.json says why. A shard appears
when it is complete.
"""
import argparse
import json
import os
import pathlib

import numpy

import voxelpipe

SUFFIXES = (".glb", ".gltf", ".drc", ".stl", ".ply", ".off", ".obj", ".3mf")


def write_shard(
    client: voxelpipe.Client, meshes: dict[str, pathlib.Path], path: pathlib.Path, resolution: int, in_flight: int
) -> dict[str, str]:
    """Voxelizes the meshes of one shard, by their names, and writes it. Out: the errors by name."""
    names, rows = [], []
    failed = {}
    # Each mesh fills its cube; bits arrive eight a byte and stay so.
    results = client.voxelize_many(
        meshes.values(),
        resolution=resolution,
        fit="cube",
        fill="parity",
        packed_bits=True,
        in_flight=in_flight,
        errors="return",
    )
    for name, result in zip(meshes, results):
        if not isinstance(result, voxelpipe.VoxelpipeError):
            if result.summary.occupied == 0:
                failed[name] = "empty: " + "; ".join(warning.text for warning in result.warnings)
                continue
            names.append(name)
            rows.append(result.packed())
        elif result.retryable:
            raise result  # the server is away or busy, beyond the client's own retries: go on in a later run
        else:
            failed[name] = str(result)
    bits = numpy.stack(rows) if rows else numpy.zeros((0, (resolution**3 + 7) // 8), numpy.uint8)
    part = path.with_suffix(f".{os.getpid()}.part")
    with open(part, "wb") as file:
        numpy.savez_compressed(file, names=numpy.array(names, dtype=str), bits=bits)
    os.replace(part, path)
    return failed


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--resolution", type=int, default=32)
    parser.add_argument("--shard", type=int, default=1000, help="meshes a shard")
    parser.add_argument("--in-flight", type=int, default=32)
    given = parser.parse_args()
    meshes = sorted(path for path in given.folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    if not meshes:
        parser.error(f"{given.folder}: no meshes are below it")
    given.out.mkdir(parents=True, exist_ok=True)
    client = voxelpipe.default_client()
    for number, first in enumerate(range(0, len(meshes), given.shard)):
        path = given.out / f"shard-{number:05}.npz"
        if path.exists():
            print(f"{path.name}: is there")
            continue
        part = {path.relative_to(given.folder).as_posix(): path for path in meshes[first : first + given.shard]}
        failed = write_shard(client, part, path, given.resolution, given.in_flight)
        if failed:
            (given.out / f"failed-{number:05}.json").write_text(json.dumps(failed, indent=2))
        print(f"{path.name}: {len(part) - len(failed)} meshes, {len(failed)} failed")


if __name__ == "__main__":
    main()

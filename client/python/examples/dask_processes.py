#!/usr/bin/env python3
"""Meshes on a dask cluster of processes: each worker calls the server through a connection of its own, or none.

usage: dask_processes.py MESH... [--server ADDRESS] [--workers N] [--resolution N]

Without a server each worker voxelizes itself, if voxelpipe-core is installed. Here the cluster is on this machine;
distributed.Client("scheduler:8786") takes another one.
"""
import argparse
import functools
import math
import os

import distributed

import voxelpipe


def filled_volume(path: str, client: voxelpipe.Client, resolution: int) -> float:
    """The volume of a closed mesh, in cubic world units; NaN if it cannot be read. Runs in a worker; the client arrives
    there as its options.
    """
    try:
        grid = client.voxelize(path, resolution=resolution, coverage="none", fill="nonzero")
    except (voxelpipe.InvalidMesh, voxelpipe.TooLarge):
        return math.nan
    x, y, z = grid.voxel_size
    return grid.summary.occupied * x * y * z


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+")
    parser.add_argument(
        "--server", default="", help="default: VOXELPIPE_SERVER, else each worker itself, or a server for this run"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--resolution", type=int, default=64)
    given = parser.parse_args()
    client = voxelpipe.default_client(given.server)
    with distributed.LocalCluster(
        n_workers=given.workers, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as dask:
        work = functools.partial(filled_volume, client=client, resolution=given.resolution)
        paths = [os.path.abspath(path) for path in given.meshes]
        for path, volume in zip(given.meshes, dask.gather(dask.map(work, paths))):
            print(f"{path}: {volume:.6g}")


if __name__ == "__main__":
    main()

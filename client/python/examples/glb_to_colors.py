#!/usr/bin/env python3
"""Colours of many meshes as point clouds: numpy arrays of world positions and sRGB colours, an .npz a mesh.

usage: glb_to_colors.py OUT_FOLDER MESH... [--resolution N]

Out: NAME.npz, of further meshes with the same name NAME-2.npz and so on, with `points` float64 (n, 3), centres of the
occupied voxels in the mesh's world units, and `colors` uint8 (n, 4). Exit status 1 if a mesh failed; the others are
written.
"""
import argparse
import collections
import pathlib
import sys

import numpy

import voxelpipe


def write_points(grid: voxelpipe.VoxelGrid, path: pathlib.Path) -> int:
    """Writes one mesh's points. Out: their number."""
    ijk, values = grid.sparse()
    points = grid.world(ijk)
    # And back: a position is in the voxel whose centre it is.
    assert numpy.array_equal(grid.index(points), ijk)
    numpy.savez(path, points=points, colors=values["color"])
    return len(points)


def main() -> int:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("meshes", type=pathlib.Path, nargs="+")
    parser.add_argument("--resolution", type=int, default=128)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    client = voxelpipe.default_client()
    # Sparse: only the occupied voxels travel. The bits of occupancy come along as "mask".
    results = client.voxelize_many(
        arguments.meshes, resolution=arguments.resolution, result="sparse", color="base_color:srgb8", errors="return"
    )
    failed = 0
    times: collections.Counter[str] = collections.Counter()
    for path, result in zip(arguments.meshes, results):
        if isinstance(result, voxelpipe.VoxelpipeError):
            failed += 1
            of_mesh = isinstance(result, (voxelpipe.InvalidMesh, voxelpipe.TooLarge))  # names its file
            print(result if of_mesh else f"{path}: {result}", file=sys.stderr)
            continue
        times[path.stem] += 1
        name = path.stem if times[path.stem] == 1 else f"{path.stem}-{times[path.stem]}"
        count = write_points(result, arguments.out / f"{name}.npz")
        print(f"{path}: {count} points of {result.dims} voxels, of {result.voxel_size[0]:.6g}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

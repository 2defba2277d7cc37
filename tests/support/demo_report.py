"""Checks what one demo job left behind and prints it.

usage: demo_report.py MESH STEM
  STEM.json, STEM.local.json  `voxelpipe voxelize --json` with and without a server
  STEM.npy, STEM.png          what came back
Exit 1 with one line on stderr when anything disagrees.
"""

import json
import os
import sys

import numpy


def check(condition, message):
    if not condition:
        sys.exit(f"demo: {message}")


def main():
    mesh, stem = sys.argv[1:]
    with open(stem + ".json") as file:
        served = json.load(file)
    with open(stem + ".local.json") as file:
        local = json.load(file)

    voxels = numpy.load(stem + ".npy")
    dims = served["dims"]
    occupied = int(numpy.count_nonzero(voxels))
    check(list(voxels.shape) == dims[::-1], f"{stem}.npy has shape {voxels.shape}, the summary says dims {dims}")
    check(occupied > 0, f"{stem}.npy is empty")
    check(occupied == served["occupied"], f"{stem}.npy has {occupied} voxels, the summary says {served['occupied']}")
    check(served["hash"] == local["hash"], f"served bytes {served['hash']} differ from in-process {local['hash']}")
    with open(stem + ".png", "rb") as file:
        check(file.read(8) == b"\x89PNG\r\n\x1a\n", f"{stem}.png is no PNG")

    print()
    print(f"sent       {mesh}")
    print(f"           {os.path.getsize(mesh):,} bytes, {served['triangles']:,} triangles")
    print(f"came back  {dims[0]} x {dims[1]} x {dims[2]} voxels, {served['bytes']:,} bytes, {occupied:,} occupied")
    print(f"           sha256 {served['hash']} (the in-process run gives the same)")
    voxel_size, origin = (" x ".join(f"{x:.6g}" for x in served[key]) for key in ("voxel_size", "origin"))
    print(f"           voxel size {voxel_size}, origin {origin.replace(' x ', ', ')}, backend {served['backend']}")
    if served.get("peak_bytes"):
        print(f"           server peak {served['peak_bytes'] / 2**20:,.1f} MiB")
    print("took       " + ", ".join(f"{name} {ms:.1f} ms" for name, ms in served["stages"].items()))
    print(f"           voxelize {served['voxelize_ms']:.1f} ms")
    print(f"array      {stem}.npy ({os.path.getsize(stem + '.npy'):,} bytes)")
    print(f"picture    {stem}.png ({os.path.getsize(stem + '.png'):,} bytes)")
    print()


if __name__ == "__main__":
    main()

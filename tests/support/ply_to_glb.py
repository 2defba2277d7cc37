"""Packs an ASCII PLY triangle mesh, gzipped or not, as GLB.

usage: ply_to_glb.py IN.ply[.gz] OUT.glb

Reads the `vertex` element's x, y, z and the `face` element's index lists; every face has to be a triangle.
"""

import gzip
import os
import sys

import numpy

import glb


def read_header(file, path):
    """Elements in file order: [(name, count, [property names])]; the file is left at the first data line."""
    elements = []
    if file.readline().strip() != b"ply":
        sys.exit(f"{path}: no PLY file")
    for line in file:
        words = line.decode("ascii", "replace").split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and words[1] != "ascii":
            sys.exit(f"{path}: format {words[1]} is not supported, only ascii")
        elif words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            elements[-1][2].append(words[-1])
        elif words[0] == "end_header":
            return elements
    sys.exit(f"{path}: the header does not end")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    in_path, out_path = sys.argv[1:]
    positions = triangles = None
    with gzip.open(in_path, "rb") if in_path.endswith(".gz") else open(in_path, "rb") as file:
        for name, count, properties in read_header(file, in_path):
            rows = numpy.loadtxt(file, max_rows=count, ndmin=2) if count else numpy.zeros((0, len(properties)))
            if name == "vertex":
                positions = rows[:, [properties.index(axis) for axis in "xyz"]]
            elif name == "face":
                if (rows[:, 0] != 3).any():
                    sys.exit(f"{in_path}: a face is not a triangle")
                triangles = rows[:, 1:4].astype(numpy.int64)
    if positions is None or triangles is None or not len(triangles):
        sys.exit(f"{in_path}: no vertices or no faces")
    if triangles.min() < 0 or triangles.max() >= len(positions):
        sys.exit(f"{in_path}: a face names a vertex that is not there")
    glb.write_glb(out_path + ".part", positions, triangles)
    os.replace(out_path + ".part", out_path)
    print(f"{out_path}: {len(positions):,} vertices, {len(triangles):,} triangles")


if __name__ == "__main__":
    main()

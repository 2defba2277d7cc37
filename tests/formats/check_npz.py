#!/usr/bin/env python3
"""check_npz.py VOXELPIPE: voxelizes a small mesh into every format and kind, and compares what NumPy loads."""
import json
import os
import subprocess
import sys
import tempfile
import zipfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
import glb  # noqa: E402


def make_mesh(path):
    """A closed octahedron that is not aligned with anything: no voxel is decided by a rounding."""
    points = np.array([[1, .1, 0], [-1, 0, .2], [.1, 1, 0], [0, -1, .1], [.2, 0, 1], [0, .1, -1]], np.float32)
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.uint32)
    glb.write_glb(path, points, faces)


class Tool:
    def __init__(self, program, folder):
        self.program, self.folder = program, folder
        self.mesh = os.path.join(folder, "mesh.glb")
        make_mesh(self.mesh)

    def run(self, name, *options):
        out = os.path.join(self.folder, name)
        command = [self.program, "voxelize", self.mesh, "--resolution", "37", "--json", "-o", out, *options]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return out, json.loads(done.stdout)


def check_dense(tool):
    types = {"bit": "|u1", "u8": "|u1", "u16": "<u2", "u32": "<u4", "f16": "<f2", "f32": "<f4"}
    for name, descr in types.items():
        blend = "or" if name == "bit" else "count"
        npy, summary = tool.run(f"{name}.npy", "--target", f"{name}:{blend}")
        npz, _ = tool.run(f"{name}.npz", "--target", f"{name}:{blend}")
        array, archive = np.load(npy), np.load(npz)
        nx, ny, nz = summary["dims"]
        assert array.shape == (nz, ny, nx) and array.dtype.str == descr, (name, array.shape, array.dtype)
        assert np.array_equal(array, archive["target0"])
        assert np.count_nonzero(array) == summary["occupied"]
        assert archive["dims"].tolist() == summary["dims"] and np.array_equal(archive["origin"], summary["origin"])
        assert np.array_equal(archive["voxel_size"], summary["voxel_size"])
    _, interleaved = tool.run("i.npy", "--target", "f32x3:max:shader=position"), np.load(tool.folder + "/i.npy")
    _, planar = tool.run("p.npy", "--target", "f32x3:max:shader=position", "--layout", "planar"), np.load(tool.folder + "/p.npy")
    assert interleaved.shape[-1] == 3 and planar.shape[0] == 3
    assert np.array_equal(np.moveaxis(planar, 0, -1), interleaved)
    # index_to_world takes an index to its voxel's centre: the surface passes within half a diagonal of it.
    archive = np.load(tool.run("w.npz", "--target", "f32x3:average:shader=position")[0])
    k, j, i = np.nonzero(np.any(archive["target0"] != 0, axis=-1))
    centres = np.stack([i, j, k, np.ones_like(i)], -1) @ archive["index_to_world"].T
    away = np.abs(centres[:, :3] - archive["target0"][k, j, i]) / archive["voxel_size"]
    assert away.max() < 1.5, away.max()


def check_sparse(tool):
    for fill in ("none", "parity", "nonzero", "flood"):
        for target in ("f32x2:min:shader=uv,fill=3", "bit:or", "u16:max:shader=packed_normal", "f16x3:add:shader=normal",
                       "f32:average:shader=position", "u8:max:shader=base_color,encoding=srgb,fill=1/2/3/4"):
            options = ["--fill", fill, "--target", target, "--target", "bit:or"]
            sparse = np.load(tool.run("s.npz", "--result", "sparse", *options)[0])
            dense = np.load(tool.run("d.npz", *options)[0])
            x, y, z = sparse["ijk"].T
            assert sparse["ijk"].dtype.str == "<i4" and sparse["target1"].all()
            assert np.array_equal(sparse["target0"], dense["target0"][z, y, x]), (fill, target)
            occupied = np.zeros_like(dense["target1"])
            occupied[z, y, x] = 1
            assert np.array_equal(occupied, dense["target1"]), (fill, target)


def check_buckets(tool):
    for coverage in ("conservative", "thin"):
        options = ["--coverage", coverage, "--target", "u32:max:shader=triangle_id", "--target", "f32x3:max:shader=barycentric"]
        path, summary = tool.run("b.npz", "--result", "buckets", *options)
        buckets = np.load(path)
        counts = np.load(tool.run("c.npy", "--coverage", coverage, "--target", "u32:count")[0])
        offsets, triangle = buckets["offsets"], buckets["triangle"]
        assert offsets.dtype.str == "<i8" and triangle.dtype.str == "<u4"
        x, y, z = buckets["ijk"].T
        assert np.array_equal(np.diff(offsets), counts[z, y, x]) and counts.sum() == triangle.size == summary["fragments"]
        assert np.array_equal(buckets["target0"], triangle)
        inner = np.ones(triangle.size, bool)
        inner[offsets[:-1]] = False
        assert np.all(np.diff(triangle.astype(np.int64))[inner[1:]] > 0), "ascending within a voxel"
        assert np.allclose(buckets["target1"].sum(axis=1), 1, atol=1e-6)
        linear = x + summary["dims"][0] * (y + summary["dims"][1] * z.astype(np.int64))
        assert np.all(np.diff(linear) > 0)


def main():
    with tempfile.TemporaryDirectory() as folder:
        tool = Tool(sys.argv[1], folder)
        check_dense(tool)
        check_sparse(tool)
        check_buckets(tool)
        with zipfile.ZipFile(tool.run("z.npz")[0]) as archive:
            assert archive.testzip() is None, "a checksum is wrong"
    print("dense, sparse and bucketed files agree")


main()

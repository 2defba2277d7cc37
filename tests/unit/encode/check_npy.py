#!/usr/bin/env python3
"""check_npy.py WRITE_NPY_SAMPLES: runs the writer and compares what NumPy loads with the formulas of sample_results.h."""
import os
import subprocess
import sys
import tempfile

import numpy as np


def expected(nx, ny, nz, target, layout):
    k, j, i = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    if target == 0:
        return ((7 * i + 3 * j + 5 * k) % 3 == 0).astype(np.uint8)
    planes = [(i + 10 * j + 100 * k + 1000 * c + 0.5).astype(np.float32) for c in range(target)]
    if target == 1:
        return planes[0]
    return np.stack(planes, axis=0 if layout == "planar" else -1)


def main():
    checked = 0
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.argv[1], folder], check=True)
        for name in sorted(os.listdir(folder)):
            stem, target, extension = name.split(".")
            layout, nx, ny, nz = stem.split("_")
            assert extension == "npy", name
            got = np.load(os.path.join(folder, name), allow_pickle=False)
            want = expected(int(nx), int(ny), int(nz), int(target), layout)
            assert got.dtype == want.dtype, f"{name}: {got.dtype}, {want.dtype} expected"
            assert got.shape == want.shape, f"{name}: {got.shape}, {want.shape} expected"
            assert got.flags.c_contiguous, name
            assert np.array_equal(got, want), f"{name}: values differ"
            checked += 1
    assert checked == 50, f"{checked} files checked, 50 expected"
    print(f"{checked} files agree")


main()

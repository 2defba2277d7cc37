#!/usr/bin/env python3
"""Times Open3D's loader and its voxelizers with colours beside ours, on one thread each.

usage: open3d_peer.py VOXELPIPE LARGE.glb SMALL.glb [--out FOLDER] [--machine TEXT] [--commit TEXT]

Needs Debian's python3-open3d (docker/packages-python-extras.txt). LARGE.glb, of write_mesh, is loaded by both, and
voxelized at 512 by Open3D's way with colours that can: points sampled on the triangles, four each, averaged in voxels.
SMALL.glb, of write_mesh with some 5,000 triangles, is voxelized at 64 by its voxelizer of triangles, which tests every
voxel against every triangle. Prints the rows; with --out, FOLDER/cpu-open3d.json holds them (bench_file.py).
"""
import argparse
import datetime
import json
import os
import pathlib
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import bench_file  # noqa: E402

os.environ.setdefault("OMP_NUM_THREADS", "1")
REPEATS = 3
POINTS_A_TRIANGLE = 4


def ours(program, mesh, resolution):
    """What `voxelize --json` says of colours, sparse."""
    done = subprocess.run([program, "voxelize", mesh, "--json", "--resolution", str(resolution), "--threads", "1",
                           "--repeat", str(REPEATS), "--backend", "cpu", "--result", "sparse", "--target",
                           "u8x4:average:shader=base_color"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def least(work):
    """The least CPU ms of REPEATS calls, and what the last returned."""
    best, made = float("inf"), None
    for _ in range(REPEATS):
        begin = time.process_time()
        made = work()
        best = min(best, 1e3 * (time.process_time() - begin))
    return round(best, 2), made


def measure(open3d, given):
    def with_points(mesh, size):
        points = mesh.sample_points_uniformly(POINTS_A_TRIANGLE * len(mesh.triangles))
        return open3d.geometry.VoxelGrid.create_from_point_cloud(points, voxel_size=size)

    def row(case, mesh, n, said, theirs, grid):
        return {"case": case, "mesh": mesh, "N": n, "ours": round(said["voxelize_cpu_ms_min"], 2), "theirs": theirs,
                "occupied": said["occupied"], "its_voxels": len(grid.get_voxels())}

    rows = []
    load_ms, mesh = least(lambda: open3d.io.read_triangle_mesh(given.large))
    said = ours(given.program, given.large, 512)
    rows.append({"case": "load, flatten, decode the texture", "mesh": "sphere1M",
                 "ours": round(said["stages"]["load"] + said["stages"]["flatten"], 2), "theirs": load_ms})
    mesh.paint_uniform_color([1, 0, 0])  # it reads colours of vertices, no texture
    rows.append(row("colours by sampled points", "sphere1M", 512, said,
                    *least(lambda: with_points(mesh, max(said["voxel_size"])))))
    small = open3d.io.read_triangle_mesh(given.small)
    small.paint_uniform_color([1, 0, 0])
    said = ours(given.program, given.small, 64)
    rows.append(row("colours of triangles", "sphere5k", 64, said, *least(
        lambda: open3d.geometry.VoxelGrid.create_from_triangle_mesh(small, voxel_size=max(said["voxel_size"])))))
    return rows


def main():
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n\n")[0])
    for name in ("program", "large", "small"):
        parser.add_argument(name)
    parser.add_argument("--out")
    parser.add_argument("--machine", default="not recorded")
    parser.add_argument("--commit", default="not recorded")
    given = parser.parse_args()
    try:
        import open3d
    except ImportError:
        print("SKIPPED: python3-open3d is not installed (docker/packages-python-extras.txt)")
        return 77
    results = {
        "title": "CPU beside Open3D, one thread", "date": str(datetime.date.today()), "commit": given.commit,
        "machine": given.machine,
        "method": f"`peers/open3d_peer.py`: the least of {REPEATS} runs. Ours: u8x4 average base_color, sparse, "
                  "textured; of the load wall time on one thread. Its: colours of vertices.",
        "unit": "CPU ms", "better": "lower", "peer": f"Open3D {open3d.__version__}",
        "rows": measure(open3d, given)}
    print(bench_file.to_text(results))
    if given.out:
        bench_file.write(f"{given.out}/cpu-open3d.json", results)
    return 0


if __name__ == "__main__":
    sys.exit(main())

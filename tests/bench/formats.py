#!/usr/bin/env python3
"""usage: formats.py VOXELPIPE MESH [RESOLUTION] [FORMAT...]

Prints a table in Markdown: for each format the time to write a dense result, the file's size and the peak memory of the
process, of bits and of bits with u8 x 4 colours (formats of one target: the colours alone). The time is the "encode"
stage of the summary, median of three runs in turn.
"""
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROUNDS = 3
COLOURS = ["--target", "u8x4:replace:shader=base_color"]
BOTH = ["--target", "bit:or", *COLOURS]
FORMATS = "npy npz vti nrrd nii.gz zarr ply glb merged.glb vox binvox nvdb vdb html".split()
ONE_TARGET = {"nrrd", "nii.gz"}


def size_of(path):
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def write(program, mesh, resolution, name, options, folder):
    with tempfile.TemporaryDirectory(dir=folder) as out:
        command = [program, "voxelize", mesh, "--fit", "cube", "--resolution", resolution, "--json", *options,
                   "-o", f"{out}/result.{name}"]
        done = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        return done["stages"]["encode"] / 1000, size_of(pathlib.Path(out)) / 2**20, done["peak_bytes"] / 2**20


def main():
    program, mesh, *rest = sys.argv[1:]
    resolution = rest[0] if rest else "512"
    names = rest[1:] or FORMATS
    print("| format | bits: s | MiB | peak MiB | u8 x 4: s | MiB | peak MiB |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            cells = []
            for options in ([], COLOURS if name in ONE_TARGET else BOTH):
                runs = [write(program, mesh, resolution, name, options, folder) for _ in range(ROUNDS)]
                seconds, size, peak = (statistics.median(column) for column in zip(*runs))
                cells += [f"{seconds:.2f}", f"{size:.0f}", f"{peak:.0f}"]
            print(f"| .{name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()

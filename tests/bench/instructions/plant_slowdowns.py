#!/usr/bin/env python3
"""Proves that the test instruction_counts sees slow-downs of 10 %: plants them, one at a time.

usage: plant_slowdowns.py BUILD_DIR [PLANT]...     PLANT: rows, shading, flatten, filter; all without any

For use by hand: each plant changes source files of this checkout, builds instruction_rows in BUILD_DIR, counts, and
puts the files back; after the last one instruction_rows is built without any. A plant does a tenth of the work twice,
or adds as many instructions that do nothing as a tenth of the work took when it was written. instruction_counts.json
has to hold the numbers of this commit. Prints what the test says; exit 1 if it does not fail.
"""
import json
import pathlib
import subprocess
import sys
import typing

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parents[2]


class Plant(typing.NamedTuple):
    file: str
    changes: tuple  # pairs of text and what replaces it


def nops(count):
    return f'asm volatile(".rept {count}\\n nop\\n .endr");'


PLANTS = {
    "rows": (
        Plant("core/cpu/rows/row_kernels-inl.h", ((
            "    RasterBatch(batch, slab, list);\n",
            "    RasterBatch(batch, slab, list);\n"
            "    if (i / kLanes % 10 == 9) {\n"
            "      SetUpBatch<kCoverage>(mesh, divisors, batch_ids, batch);\n"
            "      RasterBatch(batch, slab, list);\n"
            "    }\n"),)),
        Plant("core/cpu/rows/row_kernels_scalar.cpp", ((
            "  for (int64_t i = 0; i < count; ++i) {\n    const uint32_t* v = mesh.triangles[ids[i]];\n",
            "  for (int64_t n = 0; n < count + count / 10; ++n) {\n"
            "    const int64_t i = n % count;\n"
            "    const uint32_t* v = mesh.triangles[ids[i]];\n"),)),
    ),
    "shading": (
        Plant("core/cpu/shaded_targets.cpp", ((
            "      shaders_[t]->Shade(batch_, shaded_);\n",
            "      shaders_[t]->Shade(batch_, shaded_);\n"
            "      static int batches = 0;\n"
            "      if (++batches % 10 == 0) {\n"
            "        if (traits_.needs_plane) state_.shade_kernels->place(batch_);\n"
            "        shaders_[t]->Shade(batch_, shaded_);\n"
            "      }\n"),)),
    ),
    "flatten": (  # 219 for a vertex with normal and texture coordinates
        Plant("core/mesh/flatten.cpp", ((
            "    Mat4d m = p.world;\n",
            f"    Mat4d m = p.world;\n    {nops(22)}\n"),)),
    ),
    "filter": (  # 426 for a sample of two levels
        Plant("core/shaders/texture/texture.h", ((
            "  if (!(texels_per_voxel > 1)) return",
            f"#ifndef __CUDA_ARCH__\n  {nops(42)}\n#endif\n"
            "  if (!(texels_per_voxel > 1)) return"),)),
    ),
}


def compile_rows(build):
    subprocess.run(["cmake", "--build", build, "--target", "instruction_rows"], check=True, stdout=subprocess.DEVNULL)


def count(build):
    """Builds and counts; exit code and text of the test."""
    compile_rows(build)
    known = json.loads((HERE / "instruction_counts.json").read_text(encoding="utf-8"))["build"]
    done = subprocess.run([sys.executable, HERE / "instruction_counts.py", f"{build}/bin/instruction_rows", known],
                          capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def planted(plants, build):
    """Counts with the plants in place."""
    before = {}
    try:
        for plant in plants:
            path = SOURCE / plant.file
            text = before[path] = path.read_text(encoding="utf-8")
            for old, new in plant.changes:
                if text.count(old) != 1:
                    raise SystemExit(f"{plant.file} has changed: it holds {text.count(old)} times:\n{old}")
                text = text.replace(old, new)
            path.write_text(text, encoding="utf-8")
        return count(build)
    finally:
        for path, text in before.items():
            path.write_text(text, encoding="utf-8")


def main(build, *names):
    missed = []
    try:
        for name in names or PLANTS:
            code, said = planted(PLANTS[name], build)
            print(f"== {name}: {', '.join(plant.file for plant in PLANTS[name])}: exit {code}\n{said}", flush=True)
            if code != 1:
                missed.append(name)
    finally:
        compile_rows(build)  # so that no binary is left with a plant
    print(f"not seen: {', '.join(missed)}" if missed else "every slow-down was seen")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

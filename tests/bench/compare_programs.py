#!/usr/bin/env python3
"""Times our command line beside those of other commits, in turns, on the rows that users feel.

usage: compare_programs.py OURS --old NAME=PROGRAM... --mesh NAME=FILE... [--out FOLDER] [--rounds 5] [--repeat 5]
         [--threads 1] [--simd auto] [--row REGEX] [--machine TEXT] [--commit TEXT]

OURS and PROGRAM are `voxelpipe` of two builds. A mesh runs all rows, one named maze those of flood alone, one named
masked those of masked colours; tests/bench/inputs/write_mesh.cpp writes meshes for them. In each round every program
runs each row once, in an order that turns from round to round: `voxelize --repeat R --json`, whose CPU time of the
pipeline counts, the least of R runs. Prints a table: the least and the median over all rounds, and the median of ours
over theirs within a round with its extremes (below 1: ours is quicker). Results that are not the same bytes are marked.
With --out, FOLDER/cpu-beside-NAME.json holds the figures for each NAME (bench_file.py).

Exit: 0, or 1 if a program failed on a row; the other rows are measured and written all the same.
"""
import argparse
import datetime
import json
import re
import statistics
import subprocess
import sys
import typing

import bench_file

SPARSE, BUCKETS = ("--result", "sparse"), ("--result", "buckets")


class Case(typing.NamedTuple):
    name: str
    options: tuple
    sizes: tuple


def target(text, *more):
    return ("--target", text, *more)


FLOOD = Case("flood fill", ("--fill", "flood"), (64, 512))
MASKED = target("u8x4:replace:shader=base_color", *SPARSE)
CASES = (
    Case("bits", (), (64, 512, 1024)),
    Case("bits thin", ("--coverage", "thin"), (512,)),
    Case("parity fill", ("--fill", "parity"), (512,)),
    FLOOD,
    Case("f32 max triangle_id dense", target("f32:max:shader=triangle_id"), (512,)),
    Case("f32 max triangle_id sparse", target("f32:max:shader=triangle_id", *SPARSE), (64, 512)),
    Case("f32x3 replace normal sparse", target("f32x3:replace:shader=normal", *SPARSE), (64, 512)),
    Case("f32x3 first normal sparse", target("f32x3:first:shader=normal", *SPARSE), (512,)),
    Case("f32x3 average normal sparse", target("f32x3:average:shader=normal", *SPARSE), (512,)),
    Case("u8x4 replace base_color sparse", target("u8x4:replace:shader=base_color", *SPARSE), (64, 512)),
    Case("u8x4 average base_color sparse", target("u8x4:average:shader=base_color", *SPARSE), (512,)),
    Case("buckets of bits", BUCKETS, (512,)),
    Case("buckets of u8x4 base_color", target("u8x4:replace:shader=base_color", *BUCKETS), (512,)),
    Case("four targets sparse",
         target("f32:max:shader=triangle_id", *target("f32x3:replace:shader=normal"),
                *target("u8x4:replace:shader=base_color"), *target("f32x2:replace:shader=uv"), *SPARSE), (512,)),
)
OF_A_MESH = {"maze": (Case("flood fill", FLOOD.options, (128, 256, 400)),),
             "masked": (Case("u8x4 replace base_color masked sparse", MASKED, (512,)),
                        Case("buckets of u8x4 base_color masked", MASKED[:2] + BUCKETS, (512,)))}


class Run(typing.NamedTuple):
    cpu_ms: float
    wall_ms: float
    hash: str


def rows_of(meshes, pattern):
    """(name, mesh, file, N, options) of all rows that the pattern names."""
    rows = [(case.name, mesh, file, size, case.options) for mesh, file in meshes
            for case in OF_A_MESH.get(mesh, CASES) for size in case.sizes]
    return [row for row in rows if re.search(pattern, f"{row[0]} {row[1]} {row[3]}")]


def run(program, row, given):
    """One run of a program, None if it failed."""
    _, _, file, size, options = row
    command = [program, "voxelize", file, "--json", "--resolution", str(size), "--fit", "cube", "--backend", "cpu",
               "--threads", str(given.threads), "--simd", given.simd, "--repeat", str(given.repeat), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        print(f"{' '.join(command)}: {done.stderr.strip()}", file=sys.stderr)
        return None
    said = json.loads(done.stdout)
    return Run(said.get("voxelize_cpu_ms_min", said["voxelize_cpu_ms"]), said["voxelize_ms"], said["hash"])


def measure(rows, programs, given):
    """Runs by (row number, program name), None where one failed."""
    runs = {(i, name): [] for i in range(len(rows)) for name, _ in programs}
    for turn in range(given.rounds):
        for i, row in enumerate(rows):
            for name, program in programs[turn % len(programs):] + programs[:turn % len(programs)]:
                if runs[i, name] is not None:
                    done = run(program, row, given)
                    runs[i, name] = None if done is None else runs[i, name] + [done]
        print(f"round {turn + 1} of {given.rounds}", file=sys.stderr)
    return runs


def digits(value):
    return float(f"{value:.4g}")


def compared(row, ours, theirs):
    """A row of bench_file.py."""
    name, mesh, _, size, _ = row
    pairs = [digits(a.cpu_ms / b.cpu_ms) for a, b in zip(ours, theirs)]
    made = {"case": name, "mesh": mesh, "N": size, "ours": digits(min(r.cpu_ms for r in ours)),
            "theirs": digits(min(r.cpu_ms for r in theirs))}
    for whose, runs in (("ours", ours), ("its", theirs)):
        made[f"{whose}_median"] = digits(statistics.median(r.cpu_ms for r in runs))
        made[f"{whose}_wall_ms"] = digits(statistics.median(r.wall_ms for r in runs))
    made.update(of_its_time=digits(statistics.median(pairs)), least_pair=min(pairs), most_pair=max(pairs))
    if ours[0].hash != theirs[0].hash:
        made["result"] = "other bytes"
    return made


def table(name, made):
    lines = [f"Ours beside {name}, CPU ms:", "",
             "| row | mesh | N | ours, least / median | its, least / median | ours / its (least, most) | |",
             "|---|---|---|---|---|---|---|"]
    for row in made:
        lines.append(f"| {row['case']} | {row['mesh']} | {row['N']} | {row['ours']} / {row['ours_median']} "
                     f"| {row['theirs']} / {row['its_median']} | {row['of_its_time']} ({row['least_pair']}, "
                     f"{row['most_pair']}) | {row.get('result', '')} |")
    return "\n".join(lines)


def machine():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        models = re.findall(r"^model name\s*: (.*)", file.read(), re.M)
    return f"{len(models)} CPUs, {models[0] if models else 'not known'}"


def named(text):
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"'{text}' is no NAME=PATH")
    return name, value


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].split("\n\n")[0])
    parser.add_argument("ours")
    parser.add_argument("--old", type=named, action="append", required=True)
    parser.add_argument("--mesh", type=named, action="append", required=True)
    parser.add_argument("--out")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--simd", default="auto")
    parser.add_argument("--row", default="")
    parser.add_argument("--machine", default=machine())
    parser.add_argument("--commit", default="not recorded")
    given = parser.parse_args(arguments)
    rows = rows_of(given.mesh, given.row)
    if not rows:
        parser.error(f"no row matches {given.row}")
    runs = measure(rows, [("ours", given.ours), *given.old], given)
    for name, _ in given.old:
        made = [compared(row, runs[i, "ours"], runs[i, name]) for i, row in enumerate(rows)
                if runs[i, "ours"] and runs[i, name]]
        print(table(name, made), end="\n\n")
        if given.out and made:
            bench_file.write(f"{given.out}/cpu-beside-{name}.json", {
                "title": f"CPU, beside {name}", "date": str(datetime.date.today()), "commit": given.commit,
                "machine": given.machine,
                "method": f"`compare_programs.py`, the programs in turns: {given.rounds} rounds, --repeat "
                          f"{given.repeat}, --threads {given.threads}, --simd {given.simd}. CPU time of the pipeline, "
                          "mesh in memory to result in memory, clearing included, the least of all runs. The grid is "
                          "a cube. of_its_time: ours over its within a round, the median.",
                "unit": "CPU ms", "better": "lower", "peer": name, "rows": made})
    failed = [f"{row[0]} {row[1]} {row[3]}: {name}" for i, row in enumerate(rows) for name in ("ours", *dict(given.old))
              if runs[i, name] is None]
    print(*(f"failed: {text}" for text in failed), sep="\n", end="\n" if failed else "")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

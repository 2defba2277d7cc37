#!/usr/bin/env python3
"""table.py RESULTS.json: Google Benchmark's JSON of voxelize_bench as one Markdown table."""
import json
import sys


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        results = json.load(file)
    print("| mesh | case | grid | wall ms (p10-p90) | CPU ms | CPU ms, least | floor ms | x floor | occupied |")
    print("|---|---|---|---|---|---|---|---|---|")
    yardsticks = []
    for row in results["benchmarks"]:
        if "error_message" in row:
            print(f"| {row['name']} | {row['error_message']} |")
            continue
        mesh, case, grid = row["name"].split("/")[:3]
        if case == "yardstick":
            yardsticks.append((mesh, grid, row))
            continue
        floor = row.get("floor")
        floors = " | " if floor is None else f"{floor:.3g} | {row['wall'] / floor:.2f}"
        print(f"| {mesh} | {case} | {grid} | {row['wall']:.2f} ({row['wall_p10']:.2f}-{row['wall_p90']:.2f}) "
              f"| {row['cpu']:.2f} | {row['cpu_min']:.2f} | {floors} | {int(row['occupied']):,} |")
    print("\n| mesh | grid | plain loop, CPU ms | ours, one thread, CPU ms | ratio | voxels of the loop that we miss |")
    print("|---|---|---|---|---|---|")
    for mesh, grid, row in yardsticks:
        print(f"| {mesh} | {grid} | {row['cpu']:.0f} | {row['ours_cpu']:.2f} | {row['ratio']:.1f} | {int(row['missed'])} |")

    peers(yardsticks)


def peers(yardsticks):
    """Prints the table of OpenVDB's meshToVolume, or that the benchmarks were built without it."""
    if not any("openvdb_cpu" in row for _, _, row in yardsticks):
        if yardsticks:
            print("\nOpenVDB's meshToVolume: not measured, libopenvdb-dev was not found when the benchmarks were built.")
        return
    print("\nOpenVDB's meshToVolume (unsigned, a band of one voxel) beside ours (conservative bits), one thread each:\n")
    print("| mesh | grid | OpenVDB, CPU ms | wall ms | its voxels | ours, CPU ms | wall ms | our voxels | ratio, CPU |")
    print("|---|---|---|---|---|---|---|---|---|")
    for mesh, grid, row in yardsticks:
        print(f"| {mesh} | {grid} | {row['openvdb_cpu']:.0f} | {row['openvdb_wall']:.0f} | {int(row['openvdb_voxels']):,} "
              f"| {row['ours_cpu']:.2f} | {row['ours_wall']:.2f} | {int(row['ours_voxels']):,} "
              f"| {row['openvdb_cpu'] / row['ours_cpu']:.0f} |")


main()

#!/usr/bin/env python3
"""Compares two JSON files of the same benchmark row by row.

usage: compare_results.py OLD.json NEW.json [--tolerance 0.15] [--row "CASE MESH N=0.33"]...

Prints a table: both figures, how many times worse the new one is, and a flag. A row is flagged as WORSE if it is worse
by more than the tolerance (0.15: 15 %), of its own where --row names one; as DIFFERENT if a figure for which only
equality is good, or `occupied`, is another; as MISSING if the new file lacks it. Rows that only the new file has are
listed as new.
Exit status: 0 nothing is flagged, 1 something is, 2 wrong usage or a file that is none.
"""
import argparse
import sys

import bench_file


def compare(old, new, tolerance, own_tolerances):
    """A list of (name, old figure, new figure, times worse, flag); None for what does not exist."""
    after = {bench_file.key(row): row for row in new["rows"]}
    rows = []
    for row in old["rows"]:
        name = bench_file.name(row)
        now = after.pop(bench_file.key(row), None)
        if now is None:
            rows.append((name, row["ours"], None, None, "MISSING"))
            continue
        better = bench_file.of(old, row, "better")
        worse, flag = None, ""
        if better != "equal" and row["ours"] > 0 and now["ours"] > 0:
            worse = now["ours"] / row["ours"] if better == "lower" else row["ours"] / now["ours"]
            flag = "WORSE" if worse > 1 + own_tolerances.get(name, tolerance) else ""
        elif row["ours"] != now["ours"]:
            flag = "DIFFERENT"
        units = bench_file.of(old, row, "unit"), bench_file.of(new, now, "unit")
        if row.get("occupied") != now.get("occupied") or units[0] != units[1]:
            flag = "DIFFERENT"
        rows.append((name, row["ours"], now["ours"], worse, flag))
    rows += [(bench_file.name(row), None, row["ours"], None, "new") for row in after.values()]
    return rows


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("--tolerance", type=float, default=0.15)
    parser.add_argument("--row", action="append", default=[], metavar="NAME=TOLERANCE")
    options = parser.parse_args(arguments)
    try:
        own = {name: float(value) for name, _, value in (row.rpartition("=") for row in options.row)}
        old, new = bench_file.read(options.old), bench_file.read(options.new)
        unknown = set(own) - {bench_file.name(row) for row in old["rows"]}
        if unknown:
            raise ValueError(f"--row: no row {sorted(unknown)[0]}")
    except (OSError, ValueError) as error:
        print(f"compare_results: {error}", file=sys.stderr)
        return 2
    print(f"old: {old['title']}, {old['commit']}, {old['machine']}\nnew: {new['title']}, {new['commit']}, "
          f"{new['machine']}\n\n| row | old | new | times worse | |\n|---|---|---|---|---|")
    flagged = 0
    for name, before, now, worse, flag in compare(old, new, options.tolerance, own):
        flagged += flag not in ("", "new")
        cells = ["" if before is None else before, "" if now is None else now,
                 "" if worse is None else f"{worse:.3f}", flag]
        print(f"| {name} | " + " | ".join(str(cell) for cell in cells) + " |")
    print(f"\ncompare_results: {flagged} of {len(old['rows'])} rows flagged")
    return 1 if flagged else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
"""Makes RESULTS.md and RESULTS.svg of the JSON files in results/ (bench_file.py describes them), and the list of
experiments in experiments/README.md of the files beside it.

usage: make_results.py                 writes the three files (make results)
       make_results.py --print FILE... prints the page of these files instead
       make_results.py --check         exits with 1 if the three files are not what it would write
"""
import fnmatch
import glob
import math
import os
import re
import sys

import bench_file

HERE = os.path.dirname(os.path.abspath(__file__))
INTRO = """# Benchmark results

`make results` makes this page and its plot of [results/](results/)`*.json`; change those, not this page.
[CONTRIBUTING.md](../../CONTRIBUTING.md#benchmarks) says how to measure and compare. What was tried, with its figures
before and after, stands in [experiments/](experiments/README.md).
"""
EXPERIMENTS = """# Experiments

What was tried for speed or memory, one file each: question, change, figures before and after, decision. `make results`
makes this list. A new one takes the next number, keeps under a page, and says machine and commit; a source that rests
on it cites it. A rejected one is tried again only with a reason why it would go otherwise now.

Rows are those of [RESULTS.md](../RESULTS.md), by case, mesh and N; `512, 1024 | a, b` are two rows. Figures are ms
unless a column says otherwise. Names of files and kernels are those of the commit. "Kept" is what was decided then:
later experiments and the [changelog](../../../CHANGELOG.md) may have removed it.

| number | question | decision |
|---|---|---|
"""
SHADED = "sphere1M"
# What users feel: a name, and the figures beside each other as file, case, mesh, N. A file "*-beside-X" is read for
# every commit X that ours was measured beside.
TWELVE = (
    ("CPU: bits, 512 / 64", ("cpu-beside-*", "bits", SHADED, 512), ("cpu-beside-*", "bits", SHADED, 64)),
    ("CPU: triangle ids, 512", ("cpu-beside-*", "f32 max triangle_id sparse", SHADED, 512)),
    ("CPU: normals, 512, replace / average", ("cpu-beside-*", "f32x3 replace normal sparse", SHADED, 512),
     ("cpu-beside-*", "f32x3 average normal sparse", SHADED, 512)),
    ("CPU: textured colours, 512, replace / average", ("cpu-beside-*", "u8x4 replace base_color sparse", SHADED, 512),
     ("cpu-beside-*", "u8x4 average base_color sparse", SHADED, 512)),
    ("CPU: buckets of colours, 512", ("cpu-beside-*", "buckets of u8x4 base_color", SHADED, 512)),
    ("CPU: flood fill, 512", ("cpu-beside-*", "flood fill", SHADED, 512)),
    ("CPU: flood of a maze, 256 / 400", ("cpu-beside-*", "flood fill", "maze", 256),
     ("cpu-beside-*", "flood fill", "maze", 400)),
    ("GPU: sparse f32 max, 1024, 2 M triangles kept / new", ("gpu-limits", "sparse f32 max", "shaded2M, kept", 1024),
     ("gpu-limits", "sparse f32 max", "shaded2M", 1024)),
    ("GPU: sparse normals, 1024, 2 M triangles kept",
     ("gpu-limits", "sparse f32x3 replace normal", "shaded2M, kept", 1024)),
    ("GPU: dense f32, 1024, bunny kept / new", ("gpu-limits", "dense f32 max", "bunny, kept", 1024),
     ("gpu-limits", "dense f32 max", "bunny", 1024)),
    ("GPU: GLB of 2 M triangles to normals, 512",
     ("gpu-whole-calls", "sparse f32x3 replace normal, new, GLB", "sphere2M", 512)),
    ("GPU: textured GLB of 2 M triangles to colours, 512",
     ("gpu-whole-calls", "sparse u8x4 replace base_color, new, textured GLB", "sphere2M", 512)),
)
NONE = "-"  # in place of a figure, so that those of a row of the page stay in their order
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666", "#000000")


def number(value):
    """A figure as it was recorded; counts with separators."""
    return f"{value:,}" if isinstance(value, int) else str(value)


def factor(value):
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def text(value):
    return (number(value) if bench_file.is_number(value) else str(value)).replace("|", "\\|")


def link(path, folder):
    return os.path.relpath(path, folder).replace(os.sep, "/")


def first_page(files):
    """The twelve rows: ours, and beside it what it was compared with in the same run."""
    lines = ["| row | ours | compared with | its figure | times better | commit |", "|---|---|---|---|---|---|"]
    for name, *figures in TWELVE:
        found = False
        for path, results in files:
            stem = os.path.basename(path).removesuffix(".json")
            known = {bench_file.key(row): row for row in results["rows"]}
            rows = [known.get(tuple(key)) for pattern, *key in figures if fnmatch.fnmatch(stem, pattern)]
            if not rows or None in rows:
                continue
            found = True
            ratios = [bench_file.ratio(results, row) for row in rows]
            peers = dict.fromkeys(bench_file.of(results, row, "peer", "") for row in rows if "theirs" in row)
            cells = [name, " / ".join(number(row["ours"]) for row in rows) + " " + results["unit"],
                     ", ".join(peers) or NONE,
                     " / ".join(number(row["theirs"]) if "theirs" in row else NONE for row in rows),
                     " / ".join(NONE if ratio is None else factor(ratio) for ratio in ratios), results["commit"]]
            lines.append("| " + " | ".join(cells) + " |")
        if not found:
            lines.append(f"| {name} | not measured | | | | |")
    return "\n".join(lines)


def runs(files, folder):
    """The list of the files: what was measured, where and how."""
    lines = []
    for i, (path, results) in enumerate(files, 1):
        lines.append(f"{i}. **{results['title']}** ([JSON]({link(path, folder)})). {results['date']}, commit "
                     f"{results['commit']}. Machine: {results['machine']}. {results['method']}")
    return "\n".join(lines)


def table(files):
    """All rows of all files."""
    lines = ["| run | case | mesh | N | ours | p10-p90 | unit | compared with | its figure | ratio | other figures |",
             "|---|---|---|---|---|---|---|---|---|---|---|"]
    for i, (_, results) in enumerate(files, 1):
        for row in results["rows"]:
            spread = f"{number(row['p10'])}-{number(row['p90'])}" if "p10" in row and "p90" in row else ""
            ratio = bench_file.ratio(results, row)
            has_peer = "theirs" in row
            more = ", ".join(f"{field} {text(value)}" for field, value in bench_file.others(row).items())
            cells = [i, text(row["case"]), text(row.get("mesh", "")), row.get("N", ""), number(row["ours"]), spread,
                     bench_file.of(results, row, "unit"), bench_file.of(results, row, "peer", "") if has_peer else "",
                     number(row["theirs"]) if has_peer else "", "" if ratio is None else factor(ratio), more]
            lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines)


def page(files, plot, folder):
    """The whole page. `folder`: where it will lie, for its links."""
    picture = f"\n![{', '.join(r['title'] for _, r in files if 'plot' in r)}: time over N]({plot})\n" if plot else ""
    return (f"{INTRO}\n## What users feel\n\n{first_page(files)}\n{picture}\n"
            f"## Runs\n\n{runs(files, folder)}\n\n## Figures\n\n"
            "`ratio`: how many times better ours is than what it is compared with; below 1 it is worse. `N`: voxels\n"
            "along the longest axis. `run`: the number in the list above.\n\n" + table(files) + "\n")


def experiments(folder):
    """The list of the experiments in a folder. Raises BadResults where one has no title or decision."""
    rows = []
    for path in sorted(glob.glob(os.path.join(folder, "[0-9]*.md"))):
        file_name, content = os.path.basename(path), read_text(path)
        title = re.match(r"# (\d{3}): (.+)\n", content)
        decision = re.search(r"^\*\*Decision\.\*\* (.+?)\s*\Z", content, re.M | re.S)
        if not title or not decision or not file_name.startswith(title[1] + "-"):
            raise bench_file.BadResults(f"{path}: no '# NNN: TITLE' of its number, or no **Decision.** at the end")
        rows.append(f"| [{title[1]}]({file_name}) | {text(title[2])} | {text(' '.join(decision[1].split()))} |")
    return EXPERIMENTS + "\n".join(rows) + "\n"


def decades(values):
    """The powers of ten around these values."""
    low = math.floor(math.log10(min(values)))
    return low, max(low + 1, math.ceil(math.log10(max(values))))


def panel(results, left, top, width, height):
    """One plot: figures over N on logarithmic axes, a line a mesh."""
    lines = {}
    for row in results["rows"]:
        if row["case"] == results["plot"]:
            lines.setdefault(row["mesh"], []).append((row["N"], row["ours"]))
    xs = sorted({n for line in lines.values() for n, _ in line})
    low, high = decades([value for line in lines.values() for _, value in line])
    x_range = math.log(xs[-1] / xs[0]) or 1.0

    def at(n, value):
        return (left + width * math.log(n / xs[0]) / x_range,
                top + height * (high - math.log10(value)) / (high - low))

    out = [f'<text x="{left}" y="{top - 10}" font-weight="bold">{results["title"]}: {results["plot"]}, '
           f'{results["unit"]}</text>']
    for power in range(low, high + 1):
        y = at(xs[0], 10.0 ** power)[1]
        out.append(f'<path d="M{left} {y:.1f}h{width}" stroke="#ddd"/>'
                   f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{10.0 ** power:g}</text>')
    for n in xs:
        x = at(n, 1)[0]
        out.append(f'<text x="{x:.1f}" y="{top + height + 16}" text-anchor="middle">{n}</text>')
    for color, (mesh, line) in zip(COLORS, lines.items()):
        points = [at(n, value) for n, value in sorted(line)]
        out.append(f'<polyline fill="none" stroke="{color}" stroke-width="1.5" points="'
                   + " ".join(f"{x:.1f},{y:.1f}" for x, y in points) + '"/>')
    for i, (color, mesh) in enumerate(zip(COLORS, lines)):
        y = top + 14 * i + 6
        out.append(f'<path d="M{left + width + 12} {y}h14" stroke="{color}" stroke-width="3"/>'
                   f'<text x="{left + width + 30}" y="{y + 4}">{mesh}</text>')
    return out


def svg(files):
    """The plot of all files that name a case for it."""
    plotted = [results for _, results in files if "plot" in results]
    if not plotted:
        return ""
    height = 260 * len(plotted)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="640" height="{height}" viewBox="0 0 640 {height}" '
           'font-family="sans-serif" font-size="11">', f'<rect width="640" height="{height}" fill="#fff"/>']
    for i, results in enumerate(plotted):
        out += panel(results, 60, 260 * i + 34, 450, 190)
    return "\n".join(out + ["</svg>"]) + "\n"


def read_text(path):
    """A file's text, empty where there is no such file."""
    if not os.path.exists(path):
        return ""
    with open(path, encoding="utf-8") as file:
        return file.read()


def main(arguments):
    try:
        if arguments[:1] == ["--print"]:
            files = [(path, bench_file.read(path)) for path in arguments[1:]]
            print(page(files, None, os.getcwd()), end="")
            return 0
        paths = sorted(glob.glob(os.path.join(HERE, "results", "*.json")))
        files = [(path, bench_file.read(path)) for path in paths]
        wanted = (("RESULTS.md", page(files, "RESULTS.svg", HERE)), ("RESULTS.svg", svg(files)),
                  ("experiments/README.md", experiments(os.path.join(HERE, "experiments"))))
    except (OSError, bench_file.BadResults) as error:
        print(f"make_results: {error}", file=sys.stderr)
        return 2
    code = 0
    for name, made in wanted:
        path = os.path.join(HERE, name)
        if arguments[:1] != ["--check"]:
            with open(path, "w", encoding="utf-8") as file:
                file.write(made)
        elif read_text(path) != made:
            print(f"make_results: {name} is not what its sources make; run make results", file=sys.stderr)
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

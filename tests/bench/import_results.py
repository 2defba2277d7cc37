#!/usr/bin/env python3
"""Makes JSON files of results (bench_file.py) of what the benchmarks print.

usage: import_results.py INPUT --out DIR [--machine TEXT] [--commit TEXT] [--date YYYY-MM-DD] [--method TEXT]

INPUT is Google Benchmark's JSON of voxelize_bench, or the log of cuda_bench, of whole_calls, of whole_calls_bench, of
tests/gpu/run.sh's section service, or of service.py: their Markdown tables and lines of stages. Each kind of table
becomes a file in DIR, named after it.
Rows that were not measured (an error in place of figures) are left out, and said on stderr.
"""
import argparse
import datetime
import json
import os
import re
import sys

import bench_file

OPENVDB = "OpenVDB meshToVolume"
RENAMED = {"n": "N", "grid": "N", "at": "N", "ms": "ours", "requests_s": "ours", "pass": "theirs", "floor": "theirs",
           "stretch": "stretch_ms"}
FLOOR = "bytes to move, at the machine's rates"
STAGES = re.compile(r"^(?:- )?(?P<case>.+), (?P<mesh>\S+) (?P<n>\d+): "
                    r"(?P<stages>[A-Z]\w+ [\d.]+(?:, [A-Z]\w+ [\d.]+)*)$")
# The figure of a cell of service.py that stands for it, and its unit; the first that is found.
CELL_FIGURES = ((re.compile(r"p99 ([\d.]+)"), "ms"), (re.compile(r"(?:worst|most) ([\d.]+) ms"), "ms"),
                (re.compile(r"peak ([\d.]+)"), "MiB"), (re.compile(r"([\d,]+) of [\d,]+ lost"), "lost"),
                (re.compile(r"^([\d.,]+) (GB/s|us|ms|/s)"), None), (re.compile(r"([\d.]+)(%)"), None))


def slug(text):
    """The name of a column as that of a field."""
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_").lower()


def figure(text):
    """A number as it stands in a cell, or None."""
    if not re.fullmatch(r"-?[\d,]*\.?\d+", text):
        return None
    plain = text.replace(",", "")
    return float(plain) if "." in plain else int(plain)


def tables(text):
    """The Markdown tables of a text: lists of header cells and of rows of cells."""
    found, rows = [], None
    for line in text.splitlines():
        if not line.startswith("|"):
            rows = None
            continue
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if rows is None:
            rows = []
            found.append((cells, rows))
        elif not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
            rows.append(cells)
    return found


def field_of(column):
    name = slug(column)
    return RENAMED.get(name, name)


def plain_row(header, cells):
    """A row whose cells are figures: the first one is the case. None without a figure in `ours`."""
    if len(cells) != len(header):
        return None
    row = {"case": cells[0]}
    for column, cell in zip(header[1:], cells[1:]):
        field = field_of(column)
        if field == "p10_p90":
            row["p10"], row["p90"] = (figure(part) for part in cell.split("-"))
        elif " / " in cell and " / " in column:  # two figures in one column
            first, _, second = column.rpartition(" / ")
            one, two = (figure(part.strip()) for part in cell.split(" / "))
            row[slug(first)], row[slug(first.rpartition(",")[0]) + "_" + slug(second)] = one, two
        elif field == "mesh":
            row["mesh"] = cell
        elif cell and field not in ("result", "errors"):
            value = figure(cell)
            row[field] = cell if value is None else value
    return row if bench_file.is_number(row.get("ours")) else None


def cell_figure(cell):
    """The figure that stands for a cell of text, and its unit; (None, None) where it has none."""
    for pattern, unit in CELL_FIGURES:
        if match := pattern.search(cell):
            return figure(match.group(1)), unit or {"/s": "requests/s"}.get(match.group(2), match.group(2))
    return None, None


def service_row(cells):
    """A row of service.py: cells of text that begin with or hold a figure; texts stay beside the figures."""
    case, ours, bare, target = (cells + [""] * 4)[:4]
    value, unit = cell_figure(ours or bare)
    if value is None:
        return None
    row = {"case": case, "ours": value, "unit": unit, "text": ours or bare,
           "better": "higher" if unit in ("GB/s", "requests/s") else "lower"}
    if ours and bare:
        row["bare"] = bare
        its_value, its_unit = cell_figure(bare)
        if its_unit == unit:
            row["theirs"] = its_value
    if target:
        row["target"] = target
    return row


# What is known by the first cells of its header: file, title, unit, better, peer.
KINDS = (
    (("case", "mesh", "N"), "gpu-kernels", "GPU, mesh and result on the device", "ms", "lower", "target"),
    (("shaded case",), "gpu-shaders", "GPU, shaders as users run them", "ms", "lower", None),
    (("call from bytes, cpu",), "cpu-whole-calls", "CPU, from a file's bytes to the result", "ms", "lower", FLOOR),
    (("call from bytes, cuda",), "gpu-whole-calls", "GPU, from a file's bytes to the result", "ms", "lower", FLOOR),
    (("whole call", "mesh", "N", "first ms", "ms", "p10-p90", "stages ms"), "gpu-limits",
     "GPU, whole calls beside the sizes where they change their way", "ms", "lower", None),
    (("whole call",), "gpu-calls", "GPU, whole calls", "ms", "lower", None),
    (("1000 meshes of 500 triangles",), "gpu-batches", "GPU, 1,000 meshes of 500 triangles", "ms", "lower", None),
    (("backend", "batches", "clients", "call"), "gpu-service", "Service, small jobs on the GPU and on the CPU",
     "requests/s", "higher", None),
    (("", "ours", "bare gRPC, same run"), "service", "Service beside bare gRPC", "ms", "lower", "bare gRPC, same run"),
)


def of_log(text, complain):
    """name -> results without their texts about the run, of all tables of a log."""
    made = {}
    for header, rows in tables(text):
        kind = next((k for k in KINDS if tuple(header[:len(k[0])]) == k[0]), None)
        if kind is None:
            continue
        first, name, title, unit, better, peer = kind
        results = made.setdefault(name, {"title": title, "unit": unit, "better": better, "rows": []})
        if peer:
            results["peer"] = peer
        if name == "gpu-kernels":
            results["plot"] = "bit conservative"
        for cells in rows:
            if name == "service":
                row = service_row(cells)
            elif name == "gpu-service":
                batches = "" if cells[1] == "yes" else ", no batches"
                case = f"{cells[0]}, {cells[3]} calls, {cells[2]} clients{batches}"
                row = plain_row(["case", *header[4:]], [case, *cells[4:]])
            else:
                row = plain_row(header, cells)
            if row is None:
                complain(f"{name}: not measured: {' | '.join(cells)}")
            else:
                results["rows"].append(row)
    stages = [match for match in map(STAGES.match, text.splitlines()) if match]
    if stages:
        rows = [{"case": f"{match['case']}: {stage.split()[0]}", "mesh": match["mesh"], "N": int(match["n"]),
                 "ours": figure(stage.split()[1])}
                for match in stages for stage in match["stages"].split(", ")]
        made["gpu-stages"] = {"title": "GPU, stages", "unit": "ms", "better": "lower", "rows": rows}
    return made


def of_google(benchmarks, complain):
    """The same of voxelize_bench's JSON."""
    cpu = {"title": "CPU pipeline", "unit": "ms", "better": "lower", "plot": "conservative",
           "peer": "clearing or sorting rate", "rows": []}
    loop = {"title": "CPU beside a plain loop, one thread", "unit": "CPU ms", "better": "lower",
            "peer": "a plain loop over triangles and voxels", "rows": []}
    openvdb = {"title": "CPU beside OpenVDB, one thread", "unit": "CPU ms", "better": "lower", "peer": OPENVDB,
               "rows": []}
    for row in benchmarks:
        if "error_message" in row:
            complain(f"not measured: {row['name']}: {row['error_message']}")
            continue
        mesh, case, grid = row["name"].split("/")[:3]
        head = {"case": case, "mesh": mesh, "N": int(grid)}
        if case != "yardstick":
            made = {**head, "ours": round(row["wall"], 2), "p10": round(row["wall_p10"], 2),
                    "p90": round(row["wall_p90"], 2), "cpu_ms": round(row["cpu"], 2),
                    "cpu_min_ms": round(row["cpu_min"], 2), "occupied": int(row["occupied"])}
            made.update((name.removeprefix("stage.") + "_ms", round(ms, 2)) for name, ms in row.items()
                        if name.startswith("stage."))
            if "floor" in row:
                made["theirs"] = float(f"{row['floor']:.3g}")
            cpu["rows"].append(made)
            continue
        head["case"] = "conservative"
        loop["rows"].append({**head, "ours": round(row["ours_cpu"], 2), "theirs": round(row["cpu"]),
                             "missed_voxels": int(row["missed"])})
        if "openvdb_cpu" in row:
            openvdb["rows"].append({
                **head, "ours": round(row["ours_cpu"], 2), "theirs": round(row["openvdb_cpu"]),
                "ours_wall_ms": round(row["ours_wall"], 2), "its_wall_ms": round(row["openvdb_wall"]),
                "occupied": int(row["ours_voxels"]), "its_voxels": int(row["openvdb_voxels"])})
    if loop["rows"] and not openvdb["rows"]:
        complain("OpenVDB was not measured: libopenvdb-dev was not found when the benchmarks were built")
    made = {"cpu-pipeline": cpu, "cpu-plain-loop": loop, "cpu-openvdb": openvdb}
    return {name: results for name, results in made.items() if results["rows"]}


def of_text(text, complain):
    """The results of any of the inputs."""
    if text.lstrip().startswith("{"):
        return of_google(json.loads(text)["benchmarks"], complain)
    return of_log(text, complain)


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("input")
    parser.add_argument("--out", required=True)
    for field in ("machine", "commit", "method"):
        parser.add_argument(f"--{field}", default="not recorded")
    parser.add_argument("--date", default=datetime.date.today().isoformat())
    options = parser.parse_args(arguments)

    def complain(what):
        print(f"import_results: {what}", file=sys.stderr)

    try:
        with open(options.input, encoding="utf-8") as file:
            made = of_text(file.read(), complain)
        if not made:
            raise ValueError(f"{options.input}: holds no table of a benchmark")
        os.makedirs(options.out, exist_ok=True)
        for name, results in made.items():
            head = {"title": results.pop("title"), "date": options.date, "commit": options.commit,
                    "machine": options.machine, "method": options.method}
            path = os.path.join(options.out, f"{name}.json")
            bench_file.write(path, {**head, **results})
            print(path)
    except (OSError, ValueError, KeyError) as error:
        complain(error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
"""usage: rooms.py [SOURCE_DIR]

Prints what breaks the rules of rooms (folders with sources), by the quoted includes; exit 1 if anything does:
no folder with more than 25 files, no cycle between folders, no include of a room on a higher floor, no include across
the borders of NEVER.
"""
import collections
import pathlib
import re
import sys

MAX_FILES = 25  # a folder; CMakeLists.txt and documents are not counted

# From the ground up: a room includes itself and rooms before it.
FLOORS = """
core/base/checksum core/base core/grid core/raster core/raster/filtered core/job
core/mesh/scene core/mesh core/mesh/place core/mesh/parts core/mesh/views core/mesh/health
core/shaders/texture core/shaders/interface core/shaders/fragment core/shaders/vertex core/shaders
core/load/base core/load/stl core/load/ply core/load/off core/load/obj core/load/decode
core/load/threemf core/load/gltf/document core/load/gltf/geometry core/load/gltf core/load
core/pipeline/plan core/pipeline/stages
core/host_mesh core/cpu/base core/cpu/rows core/cpu/shading core/cpu
core/pipeline
core/cuda/device core/cuda/primitives core/cuda/plan core/cuda/run core/cuda/vertex core/cuda/traversal
core/cuda/occupancy core/cuda/coverage core/cuda/shading core/cuda/scatter core/cuda/a_buffer
core/cuda/sparse core/cuda/fill core/cuda/targets core/cuda/batch core/cuda
core/encode/preview core/encode core/encode/formats core/encode/viewer core/encode/drawn core/encode/read
core/request_text core/command_line core
proto/wire
client/cpp/reply client/cpp client/cpp/example client/python/core
client/cli/options client/cli/engine client/cli/batch client/cli/bench client/cli/compare
client/cli/completion client/cli/commands client/cli
server/observe server/access server/options server/isolate server/meshes
server/schedule server/jobs server/export server/run server/results server/reply server/state server/calls
server/web/http server/web/download server/web server
""".split()

# What no file below the first folder includes of the second.
NEVER = [("core/shaders", "core/load"), ("core/pipeline", "core/load"), ("core/cpu", "core/load"),
         ("core/cuda", "core/load"), ("core/cuda", "core/cpu"), ("core/host_mesh", "core/cpu"),
         ("core/encode", "core/load"), ("core/encode", "core/cpu"), ("core/encode", "core/cuda"),
         ("client", "core/cpu"), ("client", "core/cuda"), ("server", "core/cpu"), ("server", "core/cuda"),
         ("proto", "core/cpu"), ("proto", "core/cuda"), ("server", "client")]

# Where a quoted include is looked up, after the folder of the file itself.
ROOTS = {"core": ["core"], "proto": ["proto", "core"], "server": ["server", "proto", "core"],
         "client": ["client/cli", "client/cpp", "proto", "core"],
         "tests": ["tests", "server", "client/cli", "client/cpp", "proto", "core"]}
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
SOURCES = {".h", ".cpp", ".cu", ".cuh"}


def within(path, folder):
    return path == folder or path.startswith(folder + "/")


def list_files(top):
    found = []
    for area in ROOTS:
        for path in sorted((top / area).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                found.append(path.relative_to(top).as_posix())
    return found


def room_of(path):
    return path.rpartition("/")[0]


def find_includes(top, sources):
    """Pairs of a source and a source that it includes; what is not of this repository is left out."""
    known = set(sources)
    for source in sources:
        folders = [room_of(source)] + ROOTS[source.split("/")[0]]
        for name in INCLUDE.findall((top / source).read_text(encoding="utf-8")):
            for folder in folders:
                if f"{folder}/{name}" in known:
                    yield source, f"{folder}/{name}"
                    break


def find_cycle(arrows):
    """The rooms of one cycle in order, or nothing."""
    done, path = set(), []

    def visit(room):
        if room in path:
            return path[path.index(room):]
        if room in done:
            return None
        path.append(room)
        for other in sorted(arrows[room]):
            if cycle := visit(other):
                return cycle
        path.pop()
        done.add(room)
        return None

    for room in sorted(arrows):
        if cycle := visit(room):
            return cycle
    return None


def find_faults(top, floors=None, never=None):
    """The faults of the tree at `top`, one line each. What is not given is this repository's."""
    floors = FLOORS if floors is None else floors
    never = NEVER if never is None else never
    faults = []
    files = list_files(top)
    counts = collections.Counter(
        room_of(f) for f in files if not f.endswith(".md") and not f.endswith("CMakeLists.txt"))
    for folder, count in sorted(counts.items()):
        if count > MAX_FILES:
            faults.append(f"{folder}: {count} files, at most {MAX_FILES}")

    sources = [f for f in files if pathlib.PurePath(f).suffix in SOURCES]
    floor = {room: i for i, room in enumerate(floors)}
    for room in sorted({room_of(f) for f in sources} - set(floors)):
        if not within(room, "tests"):
            faults.append(f"{room}: not in the list of floors in rooms.py")
    arrows = collections.defaultdict(set)
    for source, target in find_includes(top, sources):
        a, b = room_of(source), room_of(target)
        if a == b:
            continue
        faults += [f"{source}: includes {target}, which {x} must not" for x, y in never
                   if within(source, x) and within(target, y)]
        arrows[a].add(b)
        if floor.get(a, len(floors)) < floor.get(b, len(floors)):
            faults.append(f"{source}: includes {target}, which stands above it")
    if cycle := find_cycle(arrows):
        faults.append("a cycle of rooms: " + " -> ".join(cycle + cycle[:1]))
    return faults


def main():
    here = pathlib.Path(__file__).resolve()
    top = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else here.parents[2]
    faults = find_faults(top)
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

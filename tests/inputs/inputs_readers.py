#!/usr/bin/env python3
"""usage: inputs_readers.py VOXELPIPE WORK_DIR

Mesh files as independent readers see them: three.js for STL, PLY, OBJ and 3MF, meshio for OFF. Each file and the
triangles that the other reader makes of it, as a GLB, must give the same fragments: every triangle by its id. Files:
shapes that this test writes; STL files of the npm package @jscad/openjscad; and both again by three.js's own writers.
Exit 77 with the reason where Node.js, npm or its registry is missing.
"""
import json
import math
import os
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import zipfile

import numpy

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "support"))
from glb import write_glb  # noqa: E402

SAMPLES = "@jscad/openjscad@1.6.1"
SAMPLE_FILES = ["frog-OwenCollins.stl", "3d_sculpture-VernonBussler.stl", "platonics/origv07/dualdodeca_union.stl"]
RESOLUTION = "40"
COLOR_TOLERANCE = 0.0025  # three.js rounds the linear colours of binary and ASCII PLY to 8 bits


def skip(reason):
    print(f"skipped: {reason}")
    sys.exit(77)


def install(work):
    """The packages of package.json, and the samples; kept between runs."""
    for program in ("node", "npm"):
        if shutil.which(program) is None:
            skip(f"{program} is not installed")
    for name in ("package.json", "package-lock.json", "three_meshes.mjs"):
        shutil.copy(HERE / name, work / name)
    command = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--silent"]
    try:
        if not (work / "node_modules/three").is_dir():
            subprocess.run(command, cwd=work, timeout=180, check=True)
        if not (work / "package").is_dir():
            packed = subprocess.run(
                ["npm", "pack", "--silent", SAMPLES], cwd=work, timeout=60, check=True, capture_output=True, text=True
            )
            shutil.unpack_archive(work / packed.stdout.split()[-1], work)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
        skip("npm cannot install the packages")


def torus(rings, segments):
    """Positions of two decimals, and triangles."""
    positions, triangles = [], []
    for i in range(rings):
        for j in range(segments):
            a, b = 2 * math.pi * i / rings, 2 * math.pi * j / segments
            radius = 1 + 0.4 * math.cos(b)
            point = (radius * math.cos(a), radius * math.sin(a), 0.4 * math.sin(b))
            positions.append([round(value, 2) for value in point])
            one, two = (i + 1) % rings * segments, (j + 1) % segments
            here, right, up, both = i * segments + j, one + j, i * segments + two, one + two
            triangles += [[here, right, both], [here, both, up]]
    return positions, triangles


def write_stl(path, positions, triangles):
    with open(path, "wb") as file:
        file.write(b"solid, although it is binary".ljust(80) + struct.pack("<I", len(triangles)))
        for triangle in triangles:
            file.write(struct.pack("<12fH", 0, 0, 0, *(v for i in triangle for v in positions[i]), 0))


def write_obj(path, positions, triangles, random_numbers):
    """With colours, two materials, groups, texture coordinates and negative indices."""
    lines = ["# made by a test", "mtllib missing.mtl"]
    for p in positions:
        color = [random_numbers.randrange(256) / 255 for _ in range(3)]
        lines.append("v " + " ".join(map(str, p + [round(c, 6) for c in color])))
    lines += ["vt 0 0", "vt 1 0.5"]
    for i, triangle in enumerate(triangles):
        if i % 50 == 0:
            lines += [f"g part{i}", f"usemtl {'ab'[i // 50 % 2]}"]
        corners = [str(v + 1) if i % 3 else str(v - len(positions)) for v in triangle]
        lines.append("f " + " ".join(c + ("/1" if i % 2 else "") for c in corners))
    path.write_text("\n".join(lines))


def text_line(values):
    return " ".join(map(str, values)).encode() + b"\n"


def write_ply(path, positions, triangles, encoding, random_numbers):
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(encoding)
    header = (
        f"ply\nformat {encoding} 1.0\ncomment made by a test\nelement vertex {len(positions)}\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    data = []
    for p in positions:
        color = [random_numbers.randrange(256) for _ in range(3)]
        data.append(struct.pack(order + "3f3B", *p, *color) if order else text_line(p + color))
    for t in triangles:
        data.append(struct.pack(order + "B3i", 3, *t) if order else text_line([3] + t))
    path.write_bytes(header.encode() + b"".join(data))


def write_3mf(path, positions, triangles):
    """Two items, one of them a component that is turned and moved."""
    vertices = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*p) for p in positions)
    faces = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*t) for t in triangles)
    model = (
        '<?xml version="1.0" encoding="UTF-8"?><model unit="meter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1" type="model">'
        f"<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object>"
        '<object id="2" type="model"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 4 0 0"/>'
        '</components></object></resources><build><item objectid="1"/>'
        '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 4 0.5"/></build></model>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr(
            "[Content_Types].xml",
            '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
            '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>',
        )
        package.writestr(
            "_rels/.rels",
            '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
            '<Relationship Id="rel0" Target="/3D/3dmodel.model" '
            'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
        )
        package.writestr("3D/3dmodel.model", model)


def write_off(path, positions, triangles):
    rows = [" ".join(map(str, p)) for p in positions] + [" ".join(map(str, [3] + t)) for t in triangles]
    path.write_text(f"OFF\n{len(positions)} {len(triangles)} 0\n" + "\n".join(rows) + "\n")


def fragments(voxelpipe, path):
    """Triangles, and the hash of all fragments with the ids of their triangles."""
    command = [voxelpipe, "voxelize", path, "--resolution", RESOLUTION, "--result", "buckets", "--json"]
    command += ["--target", "u32:replace:shader=triangle_id", "--progress", "none"]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
    summary = json.loads(printed)
    return summary["triangles"], summary["dims"], summary["hash"]


def color_of(voxelpipe, path, work):
    """The colour of each covered voxel, of the triangle with the largest id there."""
    out = work / "colors.npz"
    command = [voxelpipe, "voxelize", path, "--resolution", RESOLUTION, "--result", "sparse", "-o", out]
    command += ["--target", "f32x3:replace:shader=color", "--progress", "none"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    with numpy.load(out) as arrays:
        return arrays["target0"]


def colored_ply(path, corners, colors):
    """A mesh whose corners have these linear colours, written as the sRGB that PLY has."""
    srgb = numpy.where(colors <= 0.0031308, colors * 12.92, 1.055 * numpy.maximum(colors, 1e-9) ** (1 / 2.4) - 0.055)
    lines = [" ".join(map(repr, [*map(float, p), *map(float, c)])) for p, c in zip(corners, srgb)]
    faces = [f"3 {i} {i + 1} {i + 2}" for i in range(0, len(corners), 3)]
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "red", "green", "blue"))
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(lines)}\n{properties}element face {len(faces)}\n"
        "property list uchar uint vertex_indices\nend_header\n" + "\n".join(lines + faces) + "\n"
    )


def main():
    voxelpipe, work = sys.argv[1], pathlib.Path(sys.argv[2])
    work.mkdir(parents=True, exist_ok=True)
    install(work)
    files = work / "files"
    shutil.rmtree(files, ignore_errors=True)
    files.mkdir()
    numbers = random.Random(7)
    positions, triangles = torus(24, 16)
    write_stl(files / "torus.stl", positions, triangles)
    write_obj(files / "torus.obj", positions, triangles, numbers)
    for encoding in ("ascii", "binary_little_endian", "binary_big_endian"):
        write_ply(files / f"torus-{encoding}.ply", positions, triangles, encoding, numbers)
    write_3mf(files / "torus.3mf", positions, triangles)
    write_off(files / "torus.off", positions, triangles)
    for sample in SAMPLE_FILES:
        name = files / pathlib.PurePath(sample).name.lower()
        shutil.copy(work / "package/examples" / sample, name)
        subprocess.run(["node", "three_meshes.mjs", "write", name, files], cwd=work, check=True)

    of_three = sorted(path for path in files.iterdir() if path.suffix in (".stl", ".ply", ".obj", ".3mf"))
    subprocess.run(["node", "three_meshes.mjs", "read", *of_three], cwd=work, check=True)
    assert len(of_three) >= 6 + 6 * len(SAMPLE_FILES), of_three
    faults, colored = [], 0
    for path in of_three:
        data = path.with_name(path.name + ".three").read_bytes()
        count, has_colors = struct.unpack_from("<2I", data)
        corners = numpy.frombuffer(data, "<f4", 3 * count, 8).reshape(-1, 3)
        other = path.with_name(path.name + ".glb")
        write_glb(other, corners, numpy.arange(count).reshape(-1, 3))
        ours, theirs = fragments(voxelpipe, path), fragments(voxelpipe, other)
        print(f"{path.name}: {ours[0]} triangles, {'equal' if ours == theirs else f'not as in three.js: {theirs}'}")
        if ours != theirs or ours[0] == 0:
            faults.append(path.name)
        if has_colors and path.suffix != ".stl":  # colours in attribute bytes are not read
            colored += 1
            colors = numpy.frombuffer(data, "<f4", 3 * count, 8 + 12 * count).reshape(-1, 3)
            reference = path.with_name(path.name + ".colors.ply")
            colored_ply(reference, corners, colors)
            difference = numpy.abs(color_of(voxelpipe, path, work) - color_of(voxelpipe, reference, work)).max()
            print(f"{path.name}: colours differ by at most {difference:.2g}")
            if difference > COLOR_TOLERANCE:
                faults.append(f"{path.name} (colours)")
    assert colored >= 4, colored
    try:
        import meshio
    except ImportError:
        print("torus.off: not compared, Python has no module meshio")
    else:
        mesh = meshio.read(files / "torus.off")
        write_glb(files / "torus.off.glb", mesh.points, mesh.cells_dict["triangle"])
        equal = fragments(voxelpipe, files / "torus.off") == fragments(voxelpipe, files / "torus.off.glb")
        print(f"torus.off: {'equal' if equal else 'not as in meshio'}")
        if not equal:
            faults.append("torus.off")
    if fragments(voxelpipe, files / "torus.off") != fragments(voxelpipe, files / "torus.stl"):
        faults.append("torus.off beside torus.stl")
    print(f"{len(of_three)} files; at fault: {', '.join(faults) or 'none'}")
    return 1 if faults else 0


if __name__ == "__main__":
    os.environ.pop("NODE_OPTIONS", None)
    sys.exit(main())

"""Measures `voxelpipe voxelize` in-process on generated meshes and prints one table.

usage: run.py --voxelpipe build/bin/voxelpipe [--meshes DIR] [--repeat N] [--resolution N ...] [--coverage C ...]
              [--mesh FILE ...] [--threads N] [--json OUT]

Every number is a median over --repeat runs of the pipeline on the loaded mesh (mesh in memory to result in memory),
as the CLI reports it; nothing is scaled or extrapolated. --mesh adds files of your own.
"""

import argparse
import json
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))


def torus_knot(segments, sides, p=2, q=3, tube=0.35):
    """A closed tube along a (p,q) torus knot: segments * sides * 2 triangles of similar size."""
    import numpy

    t = numpy.arange(segments) * (2 * numpy.pi / segments)

    def curve(t):
        r = numpy.cos(q * t) + 2
        return numpy.stack([r * numpy.cos(p * t), r * numpy.sin(p * t), -numpy.sin(q * t)], axis=-1)

    center = curve(t)
    tangent = curve(t + 1e-4) - curve(t - 1e-4)
    tangent /= numpy.linalg.norm(tangent, axis=1, keepdims=True)
    bend = curve(t + 1e-4) + curve(t - 1e-4)
    normal = numpy.cross(tangent, bend)
    normal /= numpy.linalg.norm(normal, axis=1, keepdims=True)
    binormal = numpy.cross(tangent, normal)
    angle = (numpy.arange(sides) * (2 * numpy.pi / sides))[None, :, None]
    ring = numpy.cos(angle) * normal[:, None, :] + numpy.sin(angle) * binormal[:, None, :]
    positions = (center[:, None, :] + tube * ring).reshape(-1, 3)

    i, j = numpy.meshgrid(numpy.arange(segments), numpy.arange(sides), indexing="ij")
    a = i * sides + j
    b = ((i + 1) % segments) * sides + j
    c = ((i + 1) % segments) * sides + (j + 1) % sides
    d = i * sides + (j + 1) % sides
    triangles = numpy.concatenate([numpy.stack([a, b, c], -1).reshape(-1, 3), numpy.stack([a, c, d], -1).reshape(-1, 3)])
    return positions, triangles


GENERATED = {"knot_10k": (250, 20), "knot_100k": (1000, 50), "knot_1m": (4000, 125)}


def generate(directory):
    """Runs in a process of its own: a program inherits the peak memory of the process that starts it, so the one that
    measures has to stay small."""
    import glb

    os.makedirs(directory, exist_ok=True)
    for name, (segments, sides) in GENERATED.items():
        path = os.path.join(directory, name + ".glb")
        if not os.path.exists(path):
            glb.write_glb(path + ".part", *torus_knot(segments, sides))
            os.replace(path + ".part", path)


def generated_meshes(directory):
    subprocess.run([sys.executable, os.path.abspath(__file__), "--generate", directory], check=True)
    return [os.path.join(directory, name + ".glb") for name in GENERATED]


def measure(options, mesh, resolution, coverage):
    command = [options.voxelpipe, "voxelize", mesh, "--resolution", str(resolution), "--coverage", coverage]
    command += ["--repeat", str(options.repeat), "--json"]
    if options.threads:
        command += ["--threads", str(options.threads)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"bench: {' '.join(command)} ended with exit code {done.returncode}")
    return json.loads(done.stdout)


def main():
    if sys.argv[1:2] == ["--generate"]:
        return generate(sys.argv[2])
    parser = argparse.ArgumentParser()
    parser.add_argument("--voxelpipe", required=True)
    parser.add_argument("--meshes", default="build/bench", help="where the generated meshes go")
    parser.add_argument("--mesh", action="append", default=[])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--resolution", type=int, nargs="+", default=[128, 256, 512])
    parser.add_argument("--coverage", nargs="+", default=["conservative", "thin"])
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--json", help="also write every result to this file")
    options = parser.parse_args()

    print(f"{os.cpu_count()} cores, {options.repeat} runs each (medians), target bit:or, backend and SIMD as reported")
    columns = "{:<18} {:>10} {:>5} {:<13} {:>12} {:>10} {:>10} {:>9} {:>9}  {}"
    print(columns.format("mesh", "triangles", "res", "coverage", "occupied", "ms", "cpu ms", "Mtri/s", "peak MiB", "backend"))
    results = []
    for mesh in generated_meshes(options.meshes) + options.mesh:
        for resolution in options.resolution:
            for coverage in options.coverage:
                run = measure(options, mesh, resolution, coverage)
                results.append({"mesh": mesh, "resolution": resolution, "coverage": coverage, **run})
                print(columns.format(
                    os.path.splitext(os.path.basename(mesh))[0], f"{run['triangles']:,}", resolution, coverage,
                    f"{run['occupied']:,}", f"{run['voxelize_ms']:.1f}", f"{run['voxelize_cpu_ms']:.1f}",
                    f"{run['triangles'] / max(run['voxelize_ms'], 1e-9) / 1e3:.2f}",
                    f"{run['peak_bytes'] / 2**20:.0f}", f"{run['backend']} {run['simd']}"), flush=True)
    if options.json:
        with open(options.json, "w") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()

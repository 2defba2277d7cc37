#!/usr/bin/env python3
"""A rotating part for a lattice Boltzmann solver: solid bits and wall velocities of each time step.

usage: rotating_part.py MESH [--axis x|y|z] [--turns-a-second F] [--steps N] [--steps-a-second F] [--resolution N]

The mesh is sent once; a step sends its pose alone. All steps have the same grid, which the part never leaves. A voxel
is solid if its centre is inside of the part (coverage "none", fill "parity"), the rule of such solvers.
"""
import argparse
import pathlib
from typing import Iterator

import numpy
import numpy.typing

import voxelpipe

Matrix = numpy.typing.NDArray[numpy.float64]


def turn(axis: int, angle: float, center: Matrix) -> Matrix:
    """4x4: a turn of `angle` radians about the axis (0, 1, 2: x, y, z) through `center`."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix = numpy.eye(4)
    matrix[[a, b], [a, b]] = numpy.cos(angle)
    matrix[a, b], matrix[b, a] = -numpy.sin(angle), numpy.sin(angle)
    matrix[:3, 3] = center - matrix[:3, :3] @ center
    return matrix


def grid_around(box: Matrix, resolution: int) -> voxelpipe.GridPlace:
    """A cube of voxels that holds the box (2x3, its lowest and highest corner) in every pose about its centre."""
    radius = float(numpy.linalg.norm(box[1] - box[0])) / 2
    size = 2 * radius / resolution
    x, y, z = (float(value) for value in box.mean(axis=0) - radius)
    return voxelpipe.GridPlace((resolution,) * 3, (x, y, z), (size,) * 3)


def steps(
    client: voxelpipe.Client, mesh: pathlib.Path, axis: int, turns: float, count: int, rate: float, resolution: int
) -> Iterator[voxelpipe.VoxelGrid]:
    """The grids of `count` time steps of 1 / rate seconds; turns: a second."""
    handle = client.upload(mesh)
    box = numpy.array([handle.stored.mesh.min, handle.stored.mesh.max])
    place = grid_around(box, resolution)
    center = box.mean(axis=0)
    for step in range(count):
        spin = numpy.zeros(3)
        spin[axis] = 2 * numpy.pi * turns  # radians a second: velocity = spin x (p - center)
        pose = voxelpipe.Shader(
            "transform",
            {"matrix": turn(axis, spin[axis] * step / rate, center), "angular_velocity": spin, "center": center},
        )
        yield client.voxelize(
            handle,
            like=place,
            vertex_shader=pose,
            coverage="none",
            fill="parity",
            solid="occupancy:bit",
            velocity="velocity:f32",
        )


def main() -> None:
    """Parses the command line; where the solver would run, it prints what a step hands over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=pathlib.Path)
    parser.add_argument("--axis", choices="xyz", default="y")
    parser.add_argument("--turns-a-second", type=float, default=1.0)
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--steps-a-second", type=float, default=32.0)
    parser.add_argument("--resolution", type=int, default=64)
    given = parser.parse_args()
    before = None
    for step, grid in enumerate(
        steps(
            voxelpipe.default_client(),
            given.mesh,
            "xyz".index(given.axis),
            given.turns_a_second,
            given.steps,
            given.steps_a_second,
            given.resolution,
        )
    ):
        solid, velocity = grid["solid"], grid["velocity"]  # (nz, ny, nx) bool; (nz, ny, nx, 3) float32, units a second
        changed = 0 if before is None else int((solid != before).sum())  # cells to initialise, or to drop
        speed = float(numpy.linalg.norm(velocity[solid], axis=-1).max(initial=0))
        print(f"step {step}: {int(solid.sum())} solid, {changed} changed, at most {speed:.4g} units a second")
        before = solid


if __name__ == "__main__":
    main()

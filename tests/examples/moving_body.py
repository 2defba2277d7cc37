#!/usr/bin/env python3
"""moving_body.py VOXELPIPE [--server HOST:PORT]: a rigid body moves through the grid of a fluid simulation.

Each step is one request: the body's pose and motion go to the vertex shader, its surface comes back as bits and the
velocity of that surface, averaged in each voxel, as three floats: the boundary condition of the fluid's next step.
The motivating case of J. Pantaleoni, "VoxelPipe: A Programmable Pipeline for 3D Voxelization", HPG 2011.

Then the values are checked: where there is surface, the velocity is v + w x (p - c), p the mean of the surface's
points in the voxel; elsewhere it is 0. With --fill parity the inside moves too, as its voxels' centres do.
"""
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
import glb  # noqa: E402

# The fluid's grid: given, the same in every step, whatever the body does.
DIMS, ORIGIN, VOXEL = (64, 40, 36), np.array([-1.6, -1.0, -0.9]), 0.05
# The body's motion: metres and radians a second.
VELOCITY, SPIN = np.array([1.5, -0.25, 0.5]), np.array([0.5, 3.0, -1.0])
QUANTUM = 2.0**-20  # of `average`, see --target


def ellipsoid(rings=24, sectors=40, radii=(0.5, 0.3, 0.2)):
    """Closed, so that its surface has no holes: positions (n, 3) about the origin, triangles (m, 3)."""
    theta = np.linspace(0, np.pi, rings + 1)[1:-1, None]
    phi = np.linspace(0, 2 * np.pi, sectors, endpoint=False)[None, :]
    ring = np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)), -1)
    points = np.concatenate([ring.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]]) * radii
    north, south = len(points) - 2, len(points) - 1
    faces = []
    for s in range(sectors):
        t = (s + 1) % sectors
        faces.append([north, t, s])
        faces.append([south, s + (rings - 2) * sectors, t + (rings - 2) * sectors])
        for r in range(rings - 2):
            a, b = r * sectors, (r + 1) * sectors
            faces += [[a + s, a + t, b + s], [a + t, b + t, b + s]]
    return points, np.array(faces)


def pose(time):
    """The body's centre and its 4x4 matrix, mesh to world, `time` seconds after the start."""
    angle = np.linalg.norm(SPIN) * time
    x, y, z = SPIN / np.linalg.norm(SPIN)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross  # Rodrigues
    matrix[:3, 3] = [-0.7, 0.2, -0.3] + VELOCITY * time
    return matrix[:3, 3], matrix


def numbers(values, separator):
    return separator.join(repr(float(v)) for v in np.ravel(values))


def voxelize(program, mesh, time, out, targets, more=()):
    """Voxelizes the body as it is at `time` into the fluid's grid: one array (nz, ny, nx[, 3]) for each target."""
    center, matrix = pose(time)
    motion = (f"transform:matrix={numbers(matrix, '/')},linear_velocity={numbers(VELOCITY, '/')},"
              f"angular_velocity={numbers(SPIN, '/')},center={numbers(center, '/')}")
    command = [program, "voxelize", mesh, "--dims", ",".join(map(str, DIMS)), f"--origin={numbers(ORIGIN, ',')}",
               "--voxel-size", str(VOXEL), "--vertex-shader", motion, "--json", "-o", out, *more]
    for target in targets:
        command += ["--target", target]
    summary = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    stem = out[:-len(".npy")]
    return summary, [np.load(f"{stem}.{i}.npy") for i in range(len(targets))]


def check(surface, velocity, position, center):
    solid = surface != 0
    assert solid.any() and surface.shape == DIMS[::-1] and velocity.shape == (*DIMS[::-1], 3)
    assert not velocity[~solid].any(), "the fluid away from the body must not move"
    # The mean of v + w x (p - c) over a voxel's fragments is that of the mean point.
    expected = VELOCITY + np.cross(SPIN, position[solid].astype(np.float64) - center)
    # Each sum is of values rounded to the quantum; those and their mean are floats.
    arm = np.linalg.norm(SPIN)
    tolerance = QUANTUM * (1 + arm) + 4 * np.finfo(np.float32).eps * (np.abs(velocity).max() + 2 * arm)
    error = np.abs(velocity[solid] - expected).max()
    assert error <= tolerance, (error, tolerance)
    # The points lie in their voxels, or next to them where a triangle only touches the voxel.
    k, j, i = np.nonzero(solid)
    middle = ORIGIN + (np.stack([i, j, k], -1) + 0.5) * VOXEL
    assert np.abs(position[solid] - middle).max() <= 1.5 * VOXEL
    return error


def check_inside(surface, velocity, filled, inner, center):
    solid = surface != 0
    inside = (filled != 0) & ~solid
    assert inside.any() and np.array_equal(inner[solid], velocity[solid]) and not inner[filled == 0].any()
    k, j, i = np.nonzero(inside)
    middle = ORIGIN + (np.stack([i, j, k], -1) + 0.5) * VOXEL
    expected = VELOCITY + np.cross(SPIN, middle - center)
    assert np.abs(inner[inside] - expected).max() <= np.finfo(np.float32).eps * np.abs(expected).max()


def main():
    program, more = sys.argv[1], sys.argv[2:]
    fluid = np.zeros((*DIMS[::-1], 3), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        mesh = os.path.join(folder, "body.glb")
        glb.write_glb(mesh, *ellipsoid())
        before = None
        for step in range(4):
            time = 0.2 * step
            summary, (surface, velocity) = voxelize(program, mesh, time, os.path.join(folder, "step.npy"),
                                                    ["bit:or", "f32x3:average:shader=velocity"], more)
            # What a solver does with it: the fluid at the body's surface moves as the surface does.
            solid = surface != 0
            fluid[solid] = velocity[solid]

            position = voxelize(program, mesh, time, os.path.join(folder, "check.npy"),
                                ["bit:or", "f32x3:average:shader=position"], more)[1][1]
            error = check(surface, velocity, position, pose(time)[0])
            assert np.count_nonzero(solid) == summary["occupied"]
            _, (filled, inner) = voxelize(program, mesh, time, os.path.join(folder, "solid.npy"),
                                          ["bit:or", "f32x3:average:shader=velocity"], ["--fill", "parity", *more])
            check_inside(surface, velocity, filled, inner, pose(time)[0])
            assert before is None or not np.array_equal(before, surface), "the body moves"
            before = surface
            speed = np.linalg.norm(velocity[solid], axis=-1)
            print(f"t = {time:.1f} s: {solid.sum()} voxels of surface, {speed.min():.2f} to {speed.max():.2f} m/s, "
                  f"off by {error:.1e} m/s at most, {summary['voxelize_ms']:.1f} ms")


if __name__ == "__main__":
    main()

"""The recipes for parts in README.md as they stand, in this process and by a server, on files made by code."""
from __future__ import annotations

import gzip
import os
import pathlib
import re
from typing import Any, Iterator

import numpy
import pytest

import voxelpipe
from voxelpipe import LocalServer, VoxelGrid
from voxelpipe._calls import core_module

from ..shapes import Array
from .scenes import Body, ball, box, rod, write_scene

README = pathlib.Path(__file__).resolve().parents[2] / "README.md"


def recipe(title: str) -> str:
    """The block of code that follows the paragraph with this title."""
    section = README.read_text("utf-8").split("\n## Recipes for parts\n")[1].split("\n## ")[0]
    found = re.search(rf"^\*\*{re.escape(title)}.*?^```py\n(.*?)^```", section, re.M | re.S)
    assert found, title
    return found[1]


def run(code: str) -> dict[str, Any]:
    """Runs a recipe; the variables that it leaves."""
    variables: dict[str, Any] = {"voxelpipe": voxelpipe, "numpy": numpy}
    exec(code, variables)  # pylint: disable=exec-used
    return variables


@pytest.fixture(params=["in process", "server"], autouse=True)
def way(request: pytest.FixtureRequest, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Where the requests run; the current folder is empty."""
    monkeypatch.chdir(tmp_path)
    if request.param == "server":
        server: LocalServer = request.getfixturevalue("server")
        monkeypatch.setenv("VOXELPIPE_SERVER", server.server)
    elif core_module.available():
        monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)
    else:
        pytest.skip("voxelpipe_core is not installed")
    yield request.param


def centers(grid: VoxelGrid) -> Array:
    """World positions of the centres of all voxels, (nz, ny, nx, 3)."""
    k, j, i = numpy.indices(grid.place.shape)
    return grid.world(numpy.stack([i, j, k], axis=-1))


# A ball and a rod within a box that is solid there too.
ASSEMBLY = [
    Body("housing", "plastic", box((0, 0, 0), (0.06, 0.04, 0.04))),
    Body("core", "copper", ball((0.0193, 0.0211, 0.0207), 0.0125)),
    Body("pin", "steel", rod((0.038, 0.008, 0.009), (0.052, 0.034, 0.031), 0.004)),
]


@pytest.mark.parametrize("size", ["0.001", "0.0005"])
def test_an_assembly_of_three_materials(size: str) -> None:
    pathlib.Path("assembly.glb").write_bytes(write_scene(ASSEMBLY))
    code = recipe("An assembly of three materials")
    assert code.count("voxel_size=0.001,") == 1
    if not core_module.available():  # which writes such files
        code = re.sub(r"^r\.save\(.materials\.seg\.nrrd.*\n", "", code, flags=re.M)
    left = run(code.replace("voxel_size=0.001,", f"voxel_size={size},"))
    grid, h = left["r"], float(size)
    assert grid.voxel_size == (h, h, h) and grid.dims == tuple(round(side / h) for side in (0.06, 0.04, 0.04))
    plastic, copper, steel = ASSEMBLY
    inner = copper.volume + steel.volume
    assert [part.name for part in grid.parts] == ["plastic", "copper", "steel"]
    exact = {"copper": (copper.volume, copper.area), "steel": (steel.volume, steel.area)}
    exact["plastic"] = (plastic.volume - inner, sum(body.area for body in ASSEMBLY))
    for label, name in enumerate(("copper", "steel", "plastic"), 1):
        part, (volume, area) = grid.parts[name], exact[name]
        cells = numpy.count_nonzero(grid.array == label)
        assert part.label == label and part.voxels == cells and part.open_edges == part.odd_columns == 0
        assert abs(cells * h**3 - volume) <= 0.05 * h * area, name
    assert not grid.warnings and grid.summary.occupied == grid.place.voxels == numpy.count_nonzero(grid.array)
    inside = centers(grid)
    assert (grid.array[numpy.linalg.norm(inside - (0.0193, 0.0211, 0.0207), axis=-1) < 0.012] == 1).all()
    assert set(numpy.unique(left["conductivity"])) == {400, 16, 0.2}
    loaded = voxelpipe.load_result("materials.npz")
    assert loaded.parts == grid.parts and numpy.array_equal(loaded.array, grid.array) and loaded.place == grid.place
    if not core_module.available():
        return
    header, _, voxels = pathlib.Path("materials.seg.nrrd").read_bytes().partition(b"\n\n")
    for label, name in enumerate(("copper", "steel", "plastic"), 1):
        number = re.search(rf"^Segment(\d+)_Name:={name}$", header.decode(), re.M)
        assert number and f"Segment{number[1]}_LabelValue:={label}\n" in header.decode()
    assert gzip.decompress(voxels) == grid.array.tobytes()


def car(wheels: int = 2, window: bool = True) -> list[Body]:
    """A body with a window in it, and balls as wheels."""
    bodies = [Body("body", "paint", box((0, 0, 0), (4, 1.5, 1.5)))]
    bodies += [Body("window front", "glass", box((1, 1, 0.25), (1.5, 2, 1.25)))] * window
    wheel = [Body("wheel left", "rubber", ball((1, 0, -0.5), 0.4)), Body("wheel right", "rubber", ball((3, 0, 2), 0.4))]
    return bodies + wheel[:wheels]


def test_one_part_of_a_file() -> None:
    pathlib.Path("car.glb").write_bytes(write_scene(car()))
    left = run(recipe("One part of a file"))
    assert left["names"] == ["body", "window front", "wheel left", "wheel right"]
    (wheel,) = (body for body in car() if body.name == "wheel left")
    alone = voxelpipe.voxelize(write_scene([wheel]), resolution=64, fill="parity", parts="node")
    assert left["wheel"] == alone and alone.parts is not None and alone.parts.name == ["wheel left"]
    assert alone.summary.occupied * numpy.prod(alone.voxel_size) == pytest.approx(wheel.volume, rel=0.1)
    assert left["body"].parts.name == ["body", "window front"]
    assert numpy.allclose(left["body"].bounds[1], (4, 2, 1.5), atol=1 / 16), "the grid fits what is left"


ROTOR = [Body("bar", "m", box((-0.5, -0.51, -0.11), (0.5, 0.51, 0.13)))]
PADDLE = [Body("bar", "m", box((-0.41, -0.3, -0.12), (0.41, 0.3, 0.1)))]


def test_two_bodies_that_turn_against_each_other() -> None:
    for name, bodies in {"rotor": ROTOR, "paddle": PADDLE}.items():
        pathlib.Path(f"{name}.glb").write_bytes(write_scene(bodies))
    left = run(recipe("Two bodies that turn against each other in a box of fluid."))
    assert left["walls"].shape == (numpy.count_nonzero(left["r"].label), 3)
    for name in ("rotor", "paddle"):
        os.unlink(f"{name}.glb")  # loaded and sent before
    seen = set()
    for seconds in (0.0, 0.1, 0.37, 2.0):
        grid = left["frame"](seconds)
        assert not grid.warnings and grid.parts.voxels.tolist() == [int((grid.label == n).sum()) for n in (1, 2)]
        points = centers(grid)
        assert not grid.velocity[grid.label == 0].any()
        for n, (bodies, spin, place) in enumerate(zip((ROTOR, PADDLE), (3.0, -6.0), (-0.6, 0.6)), 1):
            relative = points - (place, 0, 0)
            speed = numpy.cross((0.0, spin, 0.0), relative)
            body = grid.label == n
            assert numpy.allclose(grid.velocity[body], speed[body], rtol=1e-6, atol=1e-6)
            c, s = numpy.cos(spin * seconds), numpy.sin(spin * seconds)
            own = relative @ numpy.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # turned back
            corners = bodies[0].corners.reshape(-1, 3).astype(numpy.float64)
            depth = numpy.minimum(own - corners.min(axis=0), corners.max(axis=0) - own).min(axis=-1)
            assert body[depth > 1e-6].all() and not body[depth < -1e-6].any()
        seen.add(grid.sha256)
    assert len(seen) == 4


def test_a_training_set_with_semantic_labels() -> None:
    os.mkdir("cars")
    cars = {"a": car(), "b": car(wheels=0), "c": car(wheels=1, window=False)}
    for name, bodies in cars.items():
        pathlib.Path("cars", f"{name}.glb").write_bytes(write_scene(bodies))
    left = run(recipe("A training set with semantic labels"))
    with numpy.load("cars.npz") as arrays:
        assert arrays["names"].tolist() == ["a", "b", "c"]
        cubes = arrays["labels"]
    assert cubes.shape == (3, 48, 48, 48) and cubes.dtype == numpy.uint8
    assert [numpy.unique(cube).tolist() for cube in cubes] == [[0, 1, 2, 3], [0, 1, 3], [0, 1, 2]]
    grid = voxelpipe.voxelize("cars/a.glb", resolution=48, fit="cube", label="label:u8", **OPTIONS)
    assert numpy.array_equal(grid.label, cubes[0])
    assert left["labels"] == OPTIONS["part_label"] and not grid.warnings
    points = centers(grid)
    assert (grid.label[numpy.linalg.norm(points - (1, 0, -0.5), axis=-1) < 0.3] == 2).all(), "a wheel is full"
    window = ((points > (1, 1, 0.25)) & (points < (1.5, 2, 1.25))).all(axis=-1)
    assert (grid.label[window] == 3).all(), "a later part owns where it overlaps"


OPTIONS: dict[str, Any] = {"parts": "node", "part_label": {"*": 1, "wheel*": 2, "window*": 3}, "fill": "nonzero"}

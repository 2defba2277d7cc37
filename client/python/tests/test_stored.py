"""Results of arrays and of .npz files."""
from __future__ import annotations

import contextlib
import pathlib
import subprocess
import tracemalloc
import zipfile
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import Client, VoxelGrid
from voxelpipe._calls import core_module

from . import shapes

TARGETS: dict[str, Any] = {
    "color": "base_color:srgb8",
    "normal": "normal:f32",
    "half": "uv:f16",
    "id": "triangle_id:u32",
}


def same_values(one: VoxelGrid, other: VoxelGrid) -> bool:
    """True if kind, place and all arrays are the same."""
    assert one.kind == other.kind and one.place == other.place and one.layout == other.layout
    assert {*one.stored} == {*other.stored} and {*one.lists} == {*other.lists}
    stored = all(numpy.array_equal(one[name], other[name]) for name in one.stored)
    return stored and all(numpy.array_equal(one.lists[name], other.lists[name]) for name in one.lists)


@pytest.mark.parametrize("layout", ["interleaved", "planar"])
@pytest.mark.parametrize("kind", ["dense", "sparse", "buckets"])
def test_an_npz_gives_its_result_back(
    client: Client, ball: shapes.Triangles, tmp_path: pathlib.Path, kind: Any, layout: Any
) -> None:
    grid = client.voxelize(ball, resolution=20, result=kind, layout=layout, **TARGETS)
    grid.save(tmp_path / "a.npz")
    loaded = voxelpipe.load_result(tmp_path / "a.npz")
    assert same_values(loaded, grid)
    assert loaded.summary.occupied == grid.summary.occupied
    assert [target.format for target in loaded.targets] == [target.format for target in grid.targets]
    loaded.save(tmp_path / "b.npz")
    with numpy.load(tmp_path / "a.npz") as one, numpy.load(tmp_path / "b.npz") as other:
        assert all(numpy.array_equal(one[name], other[name]) for name in [*one.files, *other.files])


@pytest.mark.parametrize("kind", ["dense", "sparse", "buckets"])
def test_a_compressed_npz_is_smaller_and_gives_the_same(
    client: Client, ball: shapes.Triangles, tmp_path: pathlib.Path, kind: Any
) -> None:
    grid = client.voxelize(ball, resolution=40, result=kind, **TARGETS)
    plain, small = tmp_path / "plain.npz", tmp_path / "small.npz"
    grid.save(plain)
    grid.save(small, compress=True)
    assert small.stat().st_size < 0.7 * plain.stat().st_size
    assert same_values(voxelpipe.load_result(small), grid)
    with numpy.load(plain) as one, numpy.load(small) as other:
        assert one.files == other.files and all(numpy.array_equal(one[name], other[name]) for name in one.files)
    for name in ("a.npy", "a.raw", "a.png", "a.vti"):
        with pytest.raises(ValueError, match="compress is an option of .npz"):
            grid.save(tmp_path / name, compress=True)
    assert {*tmp_path.iterdir()} == {plain, small}


def test_an_empty_sparse_result(client: Client, tmp_path: pathlib.Path) -> None:
    grid = client.voxelize(shapes.cube(), dims=(4, 4, 4), origin=(9, 9, 9), voxel_size=1, result="sparse")
    grid.save(tmp_path / "a.npz")
    assert same_values(voxelpipe.load_result(tmp_path / "a.npz"), grid)


def test_an_npz_of_the_command_line(cli: str, ball: shapes.Triangles, tmp_path: pathlib.Path) -> None:
    mesh = tmp_path / "ball.glb"
    mesh.write_bytes(bytes(voxelpipe.load_mesh(ball).data))
    for kind in ("dense", "sparse", "buckets"):
        path = tmp_path / f"{kind}.npz"
        options = ["--resolution", "19", "--result", kind, "--target", "normal:f32", "-o", str(path)]
        told = subprocess.run([cli, "voxelize", str(mesh), *options], check=True, capture_output=True)
        assert told.returncode == 0 and voxelpipe.load_result(path).kind == kind


@pytest.mark.parametrize(
    "changes, why",
    [
        ({"dims": None}, "it lacks 'dims'"),
        ({"target0": None}, "it has 0 targets"),
        ({f"t{i}": numpy.zeros((2, 2, 2), "u1") for i in range(8)}, "it has 9 targets"),
        ({"target0": numpy.zeros((2, 2, 3), "u1")}, "'target0' has the shape"),
        ({"target0": numpy.zeros((2, 2, 2), "f8")}, "'target0' is an array of float64"),
        ({"target0": numpy.zeros((2, 2, 2, 5), "u1")}, "'target0' has the shape"),
        ({"dims": numpy.array([2, 2, 0])}, ""),
        ({"voxel_size": numpy.array([1.0, 0, 1])}, ""),
        ({"dims": numpy.array([2.0, 2, 2])}, "'dims' is an array of float64"),
        ({"origin": numpy.zeros(3, "c16")}, "'origin' is an array of complex128"),
        ({"index_to_world": numpy.eye(4)}, "'index_to_world' is not that"),
        ({"ijk": numpy.array([[0, 0, 0.5]]), "target0": numpy.zeros(1, "f4")}, "'ijk' is an array of float64"),
        ({"ijk": numpy.array([[0, 0, 2]]), "target0": numpy.zeros(1, "f4")}, "outside of the grid"),
        ({"ijk": numpy.array([[0, 0, 1], [0, 0, 1]]), "target0": numpy.zeros(2, "f4")}, "names a voxel twice"),
        ({"ijk": numpy.array([[0, 0, 1]]), "target0": numpy.zeros(2, "f4")}, "'target0' has the shape"),
        (
            {
                "ijk": numpy.array([[0, 0, 1]]),
                "offsets": numpy.array([0, 9]),
                "triangle": numpy.array([1]),
                "target0": numpy.zeros(1, "f4"),
            },
            "its offsets do not ascend",
        ),
        ({"ijk": numpy.array([[0, 0, 1]]), "offsets": numpy.array([0, 1])}, "it lacks 'triangle'"),
        ({"target0": numpy.array([None])}, "object"),
    ],
)
def test_other_archives_are_refused(tmp_path: pathlib.Path, changes: dict[str, Any], why: str) -> None:
    right = {
        "dims": numpy.array([2, 2, 2]),
        "origin": numpy.zeros(3),
        "voxel_size": numpy.ones(3),
        "target0": numpy.ones((2, 2, 2), "u1"),
    }
    numpy.savez(tmp_path / "right.npz", **right)
    assert voxelpipe.load_result(tmp_path / "right.npz").mask.all()
    arrays = {name: array for name, array in (right | changes).items() if array is not None}
    numpy.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=f"a.npz: no .npz of a result: .*{why}"):
        voxelpipe.load_result(tmp_path / "a.npz")


def test_other_files_are_refused(tmp_path: pathlib.Path) -> None:
    (tmp_path / "text.npz").write_text("no archive")
    numpy.save(tmp_path / "one.npy", numpy.zeros(3))
    with zipfile.ZipFile(tmp_path / "zip.npz", "w") as archive:
        archive.writestr("dims.npy", b"nothing")
    with zipfile.ZipFile(tmp_path / "other.npz", "w") as archive:
        archive.writestr("readme.txt", b"nothing")
    (tmp_path / "empty.npz").write_bytes(b"")
    for name in ("text.npz", "one.npy", "zip.npz", "other.npz", "empty.npz"):
        with pytest.raises(ValueError, match=f"{name}: no .npz of a result"):
            voxelpipe.load_result(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        voxelpipe.load_result(tmp_path / "none.npz")


def test_a_grid_of_ones_own_arrays(tmp_path: pathlib.Path) -> None:
    k, j, i = numpy.indices((6, 5, 4))
    solid = (i + j + k) % 3 == 0
    heat = numpy.where(solid, i * 10.0, 0).astype("f4")
    grid = voxelpipe.make_grid({"solid": solid, "heat": heat}, voxel_size=(1, 2, 0.5), origin=(7, 8, 9))
    assert grid.dims == (4, 5, 6) and grid.origin_corner == (7, 8, 9) and grid.summary.occupied == solid.sum()
    assert numpy.array_equal(grid.mask, solid) and numpy.array_equal(grid.heat, heat)
    assert numpy.array_equal(grid.world((0, 0, 0)), (7.5, 9, 9.25))
    grid.save(tmp_path / "a.npz")
    assert same_values(voxelpipe.load_result(tmp_path / "a.npz"), grid)
    assert voxelpipe.make_grid({"color": numpy.ones((6, 5, 4, 3), "u1")}, like=grid).place == grid.place
    if core_module.available():
        for extension in (".vti", ".ply", ".vox", ".nrrd"):
            one = voxelpipe.make_grid({"solid": solid}, like=grid)
            one.save(tmp_path / f"a{extension}")
            assert (tmp_path / f"a{extension}").stat().st_size > 100


@pytest.mark.parametrize(
    "arrays, why",
    [
        ({}, "there is none"),
        ({"a": numpy.zeros(3)}, "'a' has the shape"),
        ({"": numpy.zeros((2, 2, 2), "u1")}, "'' is no name of a target"),
        ({5: numpy.zeros((2, 2, 2), "u1")}, "5 is no name of a target"),
        ({"a": numpy.zeros((1, 1, 1))}, "'a' is an array of float64"),
        ({"a": numpy.zeros((2, 2, 2), "u1"), "b": numpy.zeros((2, 2, 1), "u1")}, "'b' has the shape"),
        ({"a": numpy.zeros((2, 2, 2, 5), "u1")}, "'a' has the shape"),
        ({"a b": numpy.zeros((2, 2, 2), "u1")}, "'a b'"),
    ],
)
def test_arrays_that_are_no_grid_are_named(arrays: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        voxelpipe.make_grid(arrays)


def test_a_u8_array_of_ones_own_stays_u8() -> None:
    assert voxelpipe.make_grid({"a": numpy.ones((2, 2, 2), "u1")}).targets[0].format == "u8"


def test_damaged_archives_are_value_errors(client: Client, ball: shapes.Triangles, tmp_path: pathlib.Path) -> None:
    client.voxelize(ball, resolution=8, result="sparse", v="normal:f32").save(tmp_path / "a.npz")
    right = (tmp_path / "a.npz").read_bytes()
    draw = numpy.random.default_rng(7)
    for _ in range(300):
        wrong = bytearray(right)
        for place in draw.integers(0, len(wrong), 4):
            wrong[place] = int(draw.integers(0, 256))
        (tmp_path / "b.npz").write_bytes(wrong)
        with contextlib.suppress(ValueError):
            voxelpipe.load_result(tmp_path / "b.npz")


def test_a_bomb_is_refused_by_its_header(tmp_path: pathlib.Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in {"dims": [2, 2, 2], "origin": [0.0] * 3, "voxel_size": [1.0] * 3}.items():
            with archive.open(f"{name}.npy", "w") as entry:
                numpy.save(entry, numpy.array(array))
        with archive.open("target0.npy", "w") as entry:
            numpy.save(entry, numpy.zeros((1 << 26), "u1"))
    tracemalloc.start()
    with pytest.raises(ValueError, match="'target0' has the shape"):
        voxelpipe.load_result(tmp_path / "a.npz")
    assert tracemalloc.get_traced_memory()[1] < 1 << 22
    tracemalloc.stop()


def test_a_layout_that_the_shapes_do_not_tell_is_given(client: Client, tmp_path: pathlib.Path) -> None:
    place: dict[str, Any] = {"dims": (3, 3, 3), "origin": (0, 0, 0), "voxel_size": 1.0}
    grid = client.voxelize(shapes.cube(), layout="planar", p="position:f32", **place)
    grid.save(tmp_path / "a.npz")
    assert same_values(voxelpipe.load_result(tmp_path / "a.npz", layout="planar"), grid)


def test_wrong_arguments_are_named() -> None:
    array = numpy.zeros((2, 2, 2), "u1")
    with pytest.raises(TypeError, match="a dict of arrays"):
        voxelpipe.make_grid(array)  # type: ignore[arg-type]
    grid = voxelpipe.make_grid({"a": array})
    with pytest.raises(ValueError, match="leave out voxel_size"):
        voxelpipe.make_grid({"a": array}, like=grid, voxel_size=2)
    with pytest.raises(TypeError, match="like: 5"):
        voxelpipe.make_grid({"a": array}, like=5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="voxel_size"):
        voxelpipe.make_grid({"a": array}, voxel_size=(1, 2))

"""Results of a real server: their arrays, place, bytes and files."""
from __future__ import annotations

import hashlib
import json
import pathlib
import pickle
import subprocess
from typing import Any, Callable

import numpy
import pytest

import voxelpipe
from voxelpipe import Client, Shader, Target, VoxelGrid
from voxelpipe._mesh.glb import write_glb
from voxelpipe._mesh.forms import MeshFile

from . import shapes

TARGETS: dict[str, Any] = {
    "color": "constant:u8x4:value=128/64/255/255",
    "normal": "normal:f32",
    "ids": "triangle_id:u32",
}


@pytest.mark.parametrize("result", ["dense", "sparse"])
def test_a_missing_target_is_an_error_that_lists_the_targets(client: Client, result: Any) -> None:
    grid = client.voxelize(shapes.cube(), resolution=4, result=result, ids="triangle_id:u32")
    sought: list[Callable[[], Any]] = [lambda: grid["colour"], lambda: grid.dense("colour")]
    for look in sought:
        with pytest.raises(KeyError, match="no 'colour'; its targets are: mask, ids"):
            look()


def test_arrays_are_writable_contiguous_and_owned(client: Client, ball: shapes.Triangles) -> None:
    grid = client.voxelize(ball, resolution=20, **TARGETS)
    nx, ny, nz = grid.dims
    assert grid.mask.shape == (nz, ny, nx) and grid.mask.dtype == numpy.bool_
    assert grid.color.shape == (nz, ny, nx, 4) and grid.color.dtype == numpy.uint8
    assert grid.normal.shape == (nz, ny, nx, 3) and grid.normal.dtype == numpy.float32
    assert grid.ids.shape == (nz, ny, nx) and grid.ids.dtype == numpy.uint32
    for array in grid.stored.values():
        assert array.flags.c_contiguous and array.flags.writeable
    assert grid.mask.sum() == grid.summary.occupied > 0
    assert (grid.color[grid.mask] == [128, 64, 255, 255]).all() and not grid.color[~grid.mask].any()
    assert grid["color"] is grid.color and "color" in dir(grid)
    with pytest.raises(AttributeError, match="mask, color, normal, ids"):
        grid.colour


def test_values_lie_where_the_place_says(client: Client, ball: shapes.Triangles) -> None:
    grid = client.voxelize(ball, resolution=40, normal="normal:f32")
    ijk, values = grid.sparse()
    centers = grid.world(ijk)
    assert numpy.abs(numpy.linalg.norm(centers, axis=1) - 1).max() < 1.2 * max(grid.voxel_size)
    outwards = centers / numpy.linalg.norm(centers, axis=1, keepdims=True)
    assert (outwards * values["normal"]).sum(axis=1).min() > 0.95
    assert numpy.array_equal(grid.index(centers), ijk)
    assert numpy.allclose(grid.index_to_world @ [*ijk[5], 1], [*centers[5], 1])
    assert numpy.allclose(grid.world((0, 0, 0), at="corner"), grid.origin_corner)
    assert numpy.allclose(grid.world((0, 0, 0)), grid.origin_center)
    assert numpy.allclose(grid.world(grid.dims, at="corner"), grid.bounds[1])
    assert grid.place.inside(ijk).all() and not grid.place.inside(grid.dims)


@pytest.mark.parametrize("layout", ["interleaved", "planar"])
@pytest.mark.parametrize("resolution", [7, 8, 33])
def test_sparse_and_dense_agree(client: Client, ball: shapes.Triangles, layout: str, resolution: int) -> None:
    options: dict[str, Any] = {"resolution": resolution, "layout": layout, "fill": "parity", "normal": "normal:f32"}
    dense = client.voxelize(ball, **options)
    sparse = client.voxelize(ball, result="sparse", **options)
    assert numpy.array_equal(dense.mask, sparse.mask)
    assert numpy.array_equal(dense.dense("normal"), sparse.dense("normal"))
    assert dense.dense("normal").shape == (*dense.place.shape, 3)
    order = numpy.lexsort(sparse.occupied().T)
    assert numpy.array_equal(sparse.occupied()[order], dense.occupied())
    assert numpy.array_equal(sparse.sparse().values["normal"][order], dense.sparse().values["normal"])


def test_buckets_hold_each_fragment(client: Client, ball: shapes.Triangles) -> None:
    grid = client.voxelize(ball, resolution=12, result="buckets", targets=["triangle_id:u32", "normal:f32", "bit"])
    buckets = grid.buckets
    assert numpy.array_equal(buckets.values["target0"], buckets.triangle)
    assert buckets.values["target1"].shape == (len(buckets.triangle), 3)
    assert buckets.values["target2"].all() and buckets.values["target2"].dtype == numpy.bool_
    assert buckets.counts.sum() == len(buckets.triangle) == grid.summary.fragments
    i, j, k = buckets.ijk[3]
    one = buckets.fragments(int(i), int(j), int(k))
    assert one["triangle"].tolist() == buckets.triangle[buckets.offset[3] : buckets.offset[4]].tolist()
    assert len(buckets.fragments(6, 6, 6)["triangle"]) == 0
    dense = client.voxelize(ball, resolution=12)
    assert numpy.array_equal(grid.mask, dense.mask)
    with pytest.raises(ValueError, match="buckets"):
        grid.sparse()
    with pytest.raises(IndexError):
        buckets.fragments(0, 0, 12)


def test_packed_bits_are_the_same_bits(client: Client, ball: shapes.Triangles) -> None:
    for result in ("dense", "sparse", "buckets"):
        packed = client.voxelize(ball, resolution=19, packed_bits=True, result=result)  # type: ignore[arg-type]
        plain = client.voxelize(ball, resolution=19, result=result)  # type: ignore[arg-type]
        assert packed.stored["target0"].dtype == numpy.uint8 and packed.stored["target0"].ndim == 1
        assert numpy.array_equal(packed.array, plain.array)
        assert packed == plain and packed.sha256 == plain.sha256
    dense = client.voxelize(ball, resolution=19)
    assert numpy.array_equal(numpy.unpackbits(dense.packed(), count=19**3, bitorder="little"), dense.array.ravel())


@pytest.mark.parametrize("resolution", [16, 200])
@pytest.mark.parametrize("result", ["dense", "sparse", "buckets"])
def test_the_hash_is_the_servers(client: Client, ball: shapes.Triangles, resolution: int, result: str) -> None:
    options: dict[str, Any] = {
        "resolution": resolution,
        "targets": ["bit", "normal:f16"],
        "result": result,
        "content_hash": True,
    }
    grid = client.voxelize(ball, **options)
    assert grid.sha256 == grid.summary.content_sha256


def test_zstd_gives_the_same_bytes(client: Client, ball: shapes.Triangles) -> None:
    pytest.importorskip("zstandard")
    plain = client.voxelize(ball, resolution=150, targets=["normal:f32"])
    packed = client.voxelize(ball, resolution=150, targets=["normal:f32"], compression="zstd")
    assert packed == plain and packed.summary.sent_bytes < plain.summary.sent_bytes == plain.nbytes


def test_equality_and_pickles(client: Client, ball: shapes.Triangles) -> None:
    grid = client.voxelize(ball, resolution=16, normal="normal:f32")
    again = client.voxelize(ball, resolution=16, normal="normal:f32")
    assert grid == again and grid != client.voxelize(ball, resolution=17, normal="normal:f32")
    restored: VoxelGrid = pickle.loads(pickle.dumps(grid))
    assert restored == grid and restored.summary == grid.summary and restored.targets == grid.targets
    again.normal[0, 0, 0, 0] = 5
    assert grid != again
    with pytest.raises(TypeError):
        hash(grid)
    assert "16 x 16 x 16" in repr(grid)


def test_the_same_bytes_as_the_command_line(
    client: Client, cli: str, ball: shapes.Triangles, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / "ball.glb"
    path.write_bytes(write_glb(voxelpipe.Mesh(*ball)))
    targets = ["bit:or:shader=occupancy", "u8:replace:shader=base_color,encoding=srgb", "f32x3:replace:shader=normal"]
    arguments = [argument for target in targets for argument in ("--target", target)]
    command = [cli, "voxelize", str(path), "--resolution", "50", "--fill", "parity", "--json", *arguments]
    ran = subprocess.run([*command, "-o", str(tmp_path / "cli.npz")], check=True, capture_output=True, text=True)
    printed = json.loads(ran.stdout)
    grid = client.voxelize(path, resolution=50, fill="parity", targets=targets)
    assert grid.sha256 == printed["hash"]
    assert list(grid.dims) == printed["dims"] and list(grid.origin_corner) == printed["origin"]
    grid.save(tmp_path / "python.npz")
    with numpy.load(tmp_path / "cli.npz") as theirs, numpy.load(tmp_path / "python.npz") as ours:
        assert sorted(theirs.files) == sorted(ours.files)
        for name in theirs.files:
            assert theirs[name].dtype == ours[name].dtype, name
            assert numpy.array_equal(theirs[name], ours[name]), name


def test_files(client: Client, ball: shapes.Triangles, tmp_path: pathlib.Path) -> None:
    grid = client.voxelize(ball, resolution=20)
    grid.save(tmp_path / "a.npy")
    assert numpy.array_equal(numpy.load(tmp_path / "a.npy"), grid.array)
    grid.save(tmp_path / "a.raw")
    assert hashlib.sha256((tmp_path / "a.raw").read_bytes()).hexdigest() == grid.sha256
    assert json.loads((tmp_path / "a.raw.json").read_text())["hash"] == grid.sha256
    grid.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    for name in ("a.txt", "a"):
        with pytest.raises((ValueError, voxelpipe.MissingPackage), match="extension"):
            grid.save(tmp_path / name)
    with pytest.raises(ValueError, match="npz"):
        client.voxelize(ball, resolution=8, normal="normal:f32").save(tmp_path / "b.npy")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npy", "a.png", "a.raw", "a.raw.json"]


def test_like_gives_the_same_grid(client: Client, ball: shapes.Triangles) -> None:
    grid = client.voxelize(ball, resolution=24, padding=2)
    other = client.voxelize(shapes.cube(), like=grid)
    assert other.place == grid.place
    # The cube from 0 to 1: its corner lies at the centre of the ball.
    assert other.world(other.occupied()).min() >= -grid.voxel_size[0]


def test_exact_inside_of_a_cube(client: Client) -> None:
    grid = client.voxelize(
        shapes.cube(), voxel_size=0.125, dims=(16, 16, 16), origin=(-0.5, -0.5, -0.5), coverage="none", fill="parity"
    )
    assert grid.mask.sum() == 512
    assert grid.occupied().min() == 4 and grid.occupied().max() == 11


def test_parameters_and_warnings(client: Client) -> None:
    move = Shader("transform", {"matrix": [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]})
    grid = client.voxelize(
        shapes.cube(), resolution=4, vertex_shader=move, targets=Target("f32", 3, shader=Shader("position"))
    )
    assert grid.origin_corner == (5.0, 0.0, 0.0)
    empty = client.voxelize((numpy.zeros((0, 3)), numpy.zeros((0, 3), int)), resolution=4)
    assert empty.dims == (1, 1, 1) and [warning.code for warning in empty.warnings] == ["no_triangles"]
    with pytest.raises(voxelpipe.InvalidRequest):
        client.voxelize((numpy.zeros((0, 3)), numpy.zeros((0, 3), int)), resolution=4, strict=True)


def test_a_mesh_file_object_is_kept_as_it_is() -> None:
    file = MeshFile(memoryview(b"abc"))
    from voxelpipe._mesh.forms import load_mesh

    assert load_mesh(file) is file

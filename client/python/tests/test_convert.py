"""Results as objects of other libraries, and pictures. Libraries that are not installed are skipped."""
from __future__ import annotations

import importlib.util
import io
import pathlib
import sys
import types
import webbrowser
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import Client, VoxelGrid
from voxelpipe._export import convert, picture, save

from . import shapes


@pytest.fixture()
def grid(client: Client, ball: shapes.Triangles) -> VoxelGrid:
    """4 targets on a grid whose axes differ in size and place."""
    targets: dict[str, Any] = {
        "color": "constant:u8x4:value=200/100/50/255",
        "normal": "normal:f32",
        "ids": "triangle_id:u32",
    }
    return client.voxelize(
        ball, voxel_size=(0.1, 0.2, 0.25), dims=(20, 10, 8), origin=(-1, -1, -1), vertex_shader=None, **targets
    )


def test_numpy_and_dlpack_share_the_memory(grid: VoxelGrid) -> None:
    assert numpy.asarray(grid) is grid.mask or numpy.shares_memory(numpy.asarray(grid), grid.mask)
    taken = numpy.from_dlpack(grid)
    assert grid.__dlpack__(max_version=(1, 0), dl_device=(1, 0), copy=False)  # as consumers of DLPack 1 ask
    with pytest.raises(BufferError, match="not on the device"):
        grid.__dlpack__(dl_device=(2, 0))
    assert taken.dtype == numpy.uint8 and numpy.shares_memory(taken, grid.mask)


@pytest.mark.parametrize("versions", [False, True])
def test_dlpack_hands_the_version_on_where_numpy_takes_one(
    grid: VoxelGrid, monkeypatch: pytest.MonkeyPatch, versions: bool
) -> None:
    asked: list[Any] = []

    class OfNumpy21:
        def __dlpack__(self, *, stream: Any, max_version: Any = "none") -> str:
            if max_version != "none" and not versions:
                raise TypeError("__dlpack__() got an unexpected keyword argument 'max_version'")
            asked.append((stream, max_version))
            return "a capsule"

    monkeypatch.setattr(convert, "for_dlpack", lambda _: OfNumpy21())
    assert grid.__dlpack__(max_version=(1, 1)) == "a capsule"
    assert asked == [(None, (1, 1) if versions else "none")]


def test_torch(grid: VoxelGrid) -> None:
    torch = pytest.importorskip("torch")
    normal = grid.to_torch("normal")
    normal[0, 0, 0, 0] = 7
    assert grid.normal[0, 0, 0, 0] == 7 and tuple(normal.shape) == grid.normal.shape
    assert grid.to_torch().dtype == torch.bool
    widened, bits = grid.to_torch("ids"), grid.to_torch("ids", unsigned="bits")
    assert widened.dtype == torch.int64 and bits.dtype == torch.int32
    assert numpy.array_equal(widened.numpy(), grid.ids) and numpy.array_equal(bits.numpy().view("u4"), grid.ids)
    assert torch.from_dlpack(grid).sum() == grid.mask.sum()


def test_xarray(grid: VoxelGrid) -> None:
    pytest.importorskip("xarray")
    dataset = grid.to_xarray()
    assert dataset["mask"].dims == ("z", "y", "x") and dataset["normal"].shape == (8, 10, 20, 3)
    i, j, k = grid.occupied()[7]
    x, y, z = grid.world((i, j, k))
    assert bool(dataset["mask"].sel(x=x, y=y, z=z, method="nearest"))
    assert dataset["x"][i] == pytest.approx(x)


def test_vtk(grid: VoxelGrid) -> None:
    pytest.importorskip("vtkmodules")
    image = grid.to_vtk()
    i, j, k = (int(axis) for axis in grid.occupied()[7])
    cell = i + 20 * (j + 10 * k)
    bounds = image.GetCell(cell).GetBounds()
    assert numpy.allclose(bounds[0::2], grid.world((i, j, k), at="corner"))
    assert image.GetCellData().GetArray("mask").GetTuple1(cell) == 1
    assert image.GetCellData().GetArray("color").GetTuple4(cell) == (200, 100, 50, 255)


def test_scipy(client: Client, ball: shapes.Triangles) -> None:
    pytest.importorskip("scipy")
    buckets = client.voxelize(ball, resolution=10, result="buckets").buckets
    matrix = buckets.to_scipy()
    assert matrix.shape[0] == len(buckets.voxel) and matrix.nnz == len(buckets.triangle)
    assert matrix[3].indices.tolist() == buckets.triangle[buckets.offset[3] : buckets.offset[4]].tolist()


def test_napari_places_the_centre(grid: VoxelGrid) -> None:
    layer = grid.to_napari("color")
    assert layer["scale"] == [0.25, 0.2, 0.1] and numpy.allclose(layer["translate"], grid.origin_center[::-1])
    assert layer["rgb"] and layer["data"].shape == (8, 10, 20, 4)
    assert grid.to_napari("normal")["data"].shape == (3, 8, 10, 20)


def test_trimesh_gets_x_first_and_the_centre(grid: VoxelGrid, monkeypatch: pytest.MonkeyPatch) -> None:
    made: Any = types.SimpleNamespace(VoxelGrid=lambda matrix, transform: (matrix, transform))
    monkeypatch.setitem(sys.modules, "trimesh", types.ModuleType("trimesh"))
    monkeypatch.setitem(sys.modules, "trimesh.voxel", made)
    matrix, transform = grid.to_trimesh()
    i, j, k = grid.occupied()[7]
    assert matrix.shape == (20, 10, 8) and matrix[i, j, k]
    assert numpy.allclose(transform @ (i, j, k, 1), (*grid.world((i, j, k)), 1))


def test_open3d_gets_centres_and_colors(grid: VoxelGrid, monkeypatch: pytest.MonkeyPatch) -> None:
    made: Any = types.ModuleType("open3d")
    made.geometry = types.SimpleNamespace(PointCloud=lambda points: types.SimpleNamespace(points=points))
    made.utility = types.SimpleNamespace(Vector3dVector=numpy.asarray)
    monkeypatch.setitem(sys.modules, "open3d", made)
    cloud = grid.to_open3d("color")
    assert numpy.allclose(cloud.points, grid.world(grid.occupied()))
    assert numpy.allclose(cloud.colors, numpy.array([[200, 100, 50]]) / 255)


def test_pyvista_wraps_the_image_of_vtk(grid: VoxelGrid, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("vtkmodules")
    made: Any = types.SimpleNamespace(wrap=lambda image: image)
    monkeypatch.setitem(sys.modules, "pyvista", made)
    assert grid.to_pyvista().GetDimensions() == (21, 11, 9)


@pytest.mark.parametrize("name", ["trimesh", "open3d"])
def test_a_missing_library_is_named(grid: VoxelGrid, name: str) -> None:
    if importlib.util.find_spec(name):
        pytest.skip(f"{name} is installed")
    with pytest.raises(voxelpipe.MissingPackage, match=f"pip install {name}") as caught:
        getattr(grid, f"to_{name}")()
    assert caught.value.package == name and isinstance(caught.value, ImportError)


def test_sparse_results_are_made_dense_first(client: Client, ball: shapes.Triangles) -> None:
    sparse = client.voxelize(ball, resolution=10, result="sparse")
    with pytest.raises(ValueError, match="dense"):
        sparse.to_vtk()
    assert convert.for_dlpack(sparse.dense()).sum() == sparse.summary.occupied


def test_pictures_show_the_voxels(grid: VoxelGrid, client: Client, ball: shapes.Triangles) -> None:
    image = pytest.importorskip("PIL.Image")
    pixels = numpy.asarray(image.open(io.BytesIO(picture.png(grid))))
    assert pixels.ndim == 3 and pixels.shape[2] == 3
    lit = (pixels != pixels[0, 0]).any(axis=2)
    assert 0.3 < lit.mean() < 0.9
    assert "20 x 10 x 8" in grid._repr_html_()
    for other in (
        client.voxelize(ball, resolution=400, result="sparse"),
        client.voxelize(ball, resolution=20, result="buckets"),
    ):
        assert image.open(io.BytesIO(other._repr_png_())).size[0] > 900
    plain = client.voxelize(ball, resolution=20, targets="position:f32")
    assert len(plain._repr_png_()) > 100


def test_show_opens_a_page(grid: VoxelGrid, monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(save, "has_viewer", lambda grid: False)  # with one: test_save.py
    grid.show()
    page = pathlib.Path(opened[0].removeprefix("file://")).read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>") and grid._repr_html_() in page

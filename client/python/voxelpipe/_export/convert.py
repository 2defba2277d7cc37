"""Results as objects of other libraries, which are imported when they are needed."""
from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy
import numpy.typing

from ..errors import MissingPackage

if TYPE_CHECKING:
    from ..grid import VoxelGrid

Array = numpy.typing.NDArray[Any]

_WIDER = {"uint16": numpy.int32, "uint32": numpy.int64}
_SAME_BITS = {"uint16": numpy.int16, "uint32": numpy.int32}


def needed(module: str, package: str, what: str) -> Any:
    """An imported module. Errors: MissingPackage."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackage(f"{what} needs the package {package}: pip install {package}", package=package) from error


def _dense(grid: "VoxelGrid", what: str) -> None:
    if grid.kind != "dense":
        raise ValueError(f"{what} takes dense results; this one is {grid.kind} (see dense())")


def for_dlpack(array: Array) -> Array:
    """The array, with bits as uint8: DLPack before 1.0 has no bool. Shares its memory."""
    return array.view(numpy.uint8) if array.dtype == numpy.bool_ else array


def to_torch(array: Array, unsigned: str) -> Any:
    """See VoxelGrid.to_torch."""
    if unsigned not in ("widen", "bits"):
        raise ValueError(f"unsigned: '{unsigned}' is neither widen nor bits")
    torch = needed("torch", "torch", "to_torch")
    name = array.dtype.name
    if name in _WIDER:
        array = array.astype(_WIDER[name]) if unsigned == "widen" else array.view(_SAME_BITS[name])
    return torch.from_numpy(array)


def to_xarray(grid: "VoxelGrid") -> Any:
    """See VoxelGrid.to_xarray."""
    _dense(grid, "to_xarray")
    xarray = needed("xarray", "xarray", "to_xarray")
    coordinates = {}
    for axis, name in enumerate("xyz"):
        centers = grid.origin_center[axis] + numpy.arange(grid.dims[axis]) * grid.voxel_size[axis]
        axis_attributes = {"long_name": f"{name} of voxel centres", "units": "world units (glTF: m)"}
        coordinates[name] = (name, centers, axis_attributes)
    variables = {}
    for target in grid.targets:
        array = grid.dense(target.name)
        dims = ("z", "y", "x") if array.ndim == 3 else ("z", "y", "x", f"{target.name}_component")
        shader = target.shader.name if target.shader else "occupancy"
        variables[target.name] = (dims, array, {"format": target.format, "shader": shader})
    attributes = {
        "origin_corner": list(grid.origin_corner),
        "voxel_size": list(grid.voxel_size),
        "dims_xyz": list(grid.dims),
        "backend": grid.summary.backend,
    }
    return xarray.Dataset(variables, coordinates, attributes)


def to_trimesh(grid: "VoxelGrid") -> Any:
    """See VoxelGrid.to_trimesh. trimesh indexes x, y, z and places the centre of voxel (0, 0, 0)."""
    voxel = needed("trimesh.voxel", "trimesh", "to_trimesh")
    return voxel.VoxelGrid(numpy.ascontiguousarray(grid.mask.transpose(2, 1, 0)), transform=grid.index_to_world)


def to_open3d(grid: "VoxelGrid", color: str) -> Any:
    """See VoxelGrid.to_open3d."""
    open3d = needed("open3d", "open3d", "to_open3d")
    ijk, values = grid.sparse()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(grid.world(ijk)))
    if color:
        colors = values[color][:, :3]
        scale = numpy.iinfo(colors.dtype).max if colors.dtype.kind == "u" else 1.0
        cloud.colors = open3d.utility.Vector3dVector(numpy.clip(colors / scale, 0.0, 1.0).astype(numpy.float64))
    return cloud


def to_vtk(grid: "VoxelGrid") -> Any:
    """See VoxelGrid.to_vtk. VTK's origin is the corner, as cells are voxels; its cells too run x fastest."""
    _dense(grid, "to_vtk")
    model = needed("vtkmodules.vtkCommonDataModel", "vtk", "to_vtk")
    support = needed("vtkmodules.util.numpy_support", "vtk", "to_vtk")
    image = model.vtkImageData()
    image.SetDimensions(*(axis + 1 for axis in grid.dims))
    image.SetOrigin(*grid.origin_corner)
    image.SetSpacing(*grid.voxel_size)
    for target in grid.targets:
        array = for_dlpack(grid.dense(target.name))
        flat = numpy.ascontiguousarray(array).reshape(grid.place.voxels, -1)
        if flat.dtype == numpy.float16:  # VTK has no half floats
            flat = flat.astype(numpy.float32)
        data = support.numpy_to_vtk(flat if flat.shape[1] > 1 else flat[:, 0], deep=True)
        data.SetName(target.name)
        image.GetCellData().AddArray(data)
    image.GetCellData().SetActiveScalars(grid.targets[0].name)
    return image


def to_pyvista(grid: "VoxelGrid") -> Any:
    """See VoxelGrid.to_pyvista."""
    return needed("pyvista", "pyvista", "to_pyvista").wrap(to_vtk(grid))


def to_napari(grid: "VoxelGrid", name: str) -> dict[str, Any]:
    """See VoxelGrid.to_napari. napari places the centre of the first voxel."""
    name = name or grid.targets[0].name
    array = grid.dense(name)
    colors = array.ndim == 4 and array.dtype == numpy.uint8 and array.shape[-1] in (3, 4)
    scale = list(reversed(grid.voxel_size))
    translate = list(reversed(grid.origin_center))
    extra: dict[str, Any] = {"rgb": True} if colors else {}
    if array.ndim == 4 and not colors:
        array = numpy.moveaxis(array, -1, 0)
        extra["channel_axis"] = 0
    return {"data": array, "name": name, "scale": scale, "translate": translate, **extra}

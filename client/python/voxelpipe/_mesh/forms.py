"""Every form of a mesh that callers may give, as the bytes of one file."""
from __future__ import annotations

import dataclasses
import functools
import hashlib
import mmap
import os
import pathlib
from typing import IO, Any, Sequence, Union, get_args

import numpy

from .._proto.voxelpipe.v1 import types_pb2 as types
from ..errors import InvalidMesh
from ..names import LengthUnit, MeshFormat
from . import gltf_files, obj_files
from .colors import linear_colors
from .content import format_of
from .glb import Mesh, as_numpy, checked_positions, write_glb
from .polygons import Faces, write_ply

# A path, the bytes of a file, a binary file object, Mesh, (vertices, faces), or an object of another library.
MeshLike = Union[str, "os.PathLike[str]", bytes, bytearray, memoryview, IO[bytes], Mesh, Sequence[Any], Any]

# As they stand in the names of stored meshes.
_FORMATS: dict[int, str] = {
    types.MESH_FORMAT_GLB: "glb",
    types.MESH_FORMAT_GLTF: "gltf",
    types.MESH_FORMAT_DRACO: "drc",
    types.MESH_FORMAT_STL: "stl",
    types.MESH_FORMAT_PLY: "ply",
    types.MESH_FORMAT_OFF: "off",
    types.MESH_FORMAT_OBJ: "obj",
    types.MESH_FORMAT_3MF: "3mf",
}
_UNITS = {
    "": types.LENGTH_UNIT_UNSPECIFIED,
    "mm": types.LENGTH_UNIT_MILLIMETRE,
    "cm": types.LENGTH_UNIT_CENTIMETRE,
    "m": types.LENGTH_UNIT_METRE,
    "in": types.LENGTH_UNIT_INCH,
}
_MAPPED_BYTES = 4 << 20  # larger files are not copied into memory


@dataclasses.dataclass(frozen=True)
class MeshFile:
    """The bytes of a self-contained mesh file.

    format: a MeshFormat, if its content does not show one. name: for messages, empty if it has none. unit: of its
    positions, empty if none is given. loaded: the mesh in this process and its stored_name(), of a client without a
    server: it stays loaded as long as the file is used.
    """

    data: memoryview
    format: int = types.MESH_FORMAT_UNSPECIFIED
    name: str = ""
    unit: str = ""
    loaded: tuple[str, Any] | None = dataclasses.field(default=None, init=False, repr=False, compare=False)

    def keep(self, name: str, loaded: Any) -> None:
        """Sets `loaded`."""
        object.__setattr__(self, "loaded", (name, loaded))

    def sha256(self) -> str:
        """That of the bytes, in hexadecimal."""
        if isinstance(self.data.obj, bytes):  # which cannot change
            return self._sha256
        return hashlib.sha256(self.data).hexdigest()

    @functools.cached_property
    def _sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    def stored_name(self) -> str:
        """Its name on a server that keeps it: the same bytes with another unit or format are another mesh."""
        given = [self.unit, _FORMATS.get(self.format, "")]
        return "".join(["meshes/", self.sha256(), *(f"-{part}" for part in given if part)])

    @property
    def unit_code(self) -> int:
        """The LengthUnit of the message."""
        return _UNITS[self.unit]


def load_mesh(
    mesh: MeshLike,
    *,
    format: MeshFormat = "auto",
    unit: LengthUnit | None = None,
    allow_outside: bool = False,
) -> MeshFile:
    """The file of a mesh in any form; give it in place of the mesh, as often as you like.

    mesh: see voxelize(). format: of bytes and files; detected by default. unit: of the positions of a file whose format
    has none (stl, ply, off, obj, draco), which are scaled to metres; None: they are taken as they are. allow_outside: a
    glTF or OBJ file may name files outside of its folder. Errors: InvalidMesh, OSError for a file that cannot be read,
    TypeError, ValueError.
    """
    file = _load(mesh, _format_code(format), allow_outside)
    if unit is None:
        return file
    if unit not in _UNITS or not unit:
        raise ValueError(f"unit: '{unit}' is none of mm, cm, m, in")
    if file.unit and file.unit != unit:
        raise ValueError(f"unit: the mesh was loaded with the unit {file.unit}")
    return dataclasses.replace(file, unit=unit)


def _load(mesh: MeshLike, code: int, allow_outside: bool) -> MeshFile:
    if isinstance(mesh, MeshFile):
        return mesh
    if isinstance(mesh, (str, os.PathLike)):
        return _of_path(pathlib.Path(mesh), code, allow_outside)
    if isinstance(mesh, (bytes, bytearray, memoryview)):
        return MeshFile(memoryview(mesh).cast("B"), code)
    if isinstance(mesh, Mesh):
        return _of_arrays(mesh)
    read = getattr(mesh, "read", None)
    if callable(read) and not hasattr(mesh, "points") and not hasattr(mesh, "vertices"):
        data = read()
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise TypeError("the file object gives text; open it in binary mode, open(path, 'rb')")
        content, name = memoryview(data).cast("B"), str(getattr(mesh, "name", ""))
        return MeshFile(content, code or format_of(pathlib.Path(name), content), name)
    arrays = arrays_of(mesh)
    return arrays if isinstance(arrays, MeshFile) else _of_arrays(arrays)


def _format_code(format: MeshFormat) -> int:
    if format not in get_args(MeshFormat):
        raise ValueError(f"format: '{format}' is none of {', '.join(get_args(MeshFormat))}")
    name = "UNSPECIFIED" if format == "auto" else format.upper()
    return int(types.MeshFormat.Value(f"MESH_FORMAT_{name}"))


def _of_path(path: pathlib.Path, code: int, allow_outside: bool) -> MeshFile:
    with open(path, "rb") as file:
        if os.fstat(file.fileno()).st_size > _MAPPED_BYTES:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        else:
            data = memoryview(file.read())
    if gltf_files.needs_packing(data):
        try:
            return MeshFile(memoryview(gltf_files.pack(data, path, allow_outside)), 0, str(path))
        except InvalidMesh as error:
            raise InvalidMesh(f"{path}: {error.message}", field=error.field) from error
    if code in (types.MESH_FORMAT_UNSPECIFIED, types.MESH_FORMAT_OBJ) and obj_files.needs_packing(data):
        try:
            packed = memoryview(obj_files.pack(data, path, allow_outside))
        except InvalidMesh as error:
            raise InvalidMesh(f"{path}: {error.message}", field=error.field) from error
        return MeshFile(packed, code or format_of(path.with_suffix(".obj"), packed), str(path))
    return MeshFile(data, code or format_of(path, data), str(path))


def _of_arrays(mesh: Mesh) -> MeshFile:
    return MeshFile(memoryview(write_glb(mesh)))


def arrays_of(mesh: Any) -> Mesh | MeshFile:
    """The arrays of an object: (vertices, faces), trimesh, Open3D, meshio, VTK, PyVista, or anything with `vertices`
    and `faces`; a file if it has faces of more than three corners. Errors: InvalidMesh; TypeError naming the type.
    """
    if isinstance(mesh, (tuple, list)) and any(isinstance(part, (str, bytes, os.PathLike)) for part in mesh):
        raise TypeError("a list of files is no mesh; voxelize(..., together=True) and voxelize_many() take several")
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2:
        return Mesh(mesh[0], mesh[1])
    if hasattr(mesh, "vertices") and hasattr(mesh, "triangles"):  # Open3D
        colors = mesh.vertex_colors if getattr(mesh, "has_vertex_colors", bool)() else None
        normals = mesh.vertex_normals if getattr(mesh, "has_vertex_normals", bool)() else None
        if colors is not None:  # as displays take them
            colors = linear_colors(as_numpy(colors), srgb_floats=True)
        normals = None if normals is None else as_numpy(normals)
        return Mesh(as_numpy(mesh.vertices), as_numpy(mesh.triangles), normals, colors)
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        visual: Any = getattr(mesh, "visual", None)  # trimesh's
        colors = visual.vertex_colors if getattr(visual, "kind", None) == "vertex" else None
        return Mesh(mesh.vertices, mesh.faces, colors=colors)
    if hasattr(mesh, "points") and hasattr(mesh, "cells_dict"):  # meshio
        return _of_meshio(mesh)
    if hasattr(mesh, "GetPoints") and hasattr(mesh, "GetPolys"):  # VTK, PyVista
        return _of_vtk(mesh)
    kind = f"{type(mesh).__module__}.{type(mesh).__qualname__}"
    raise TypeError(
        f"a {kind} is no mesh; expected a path, bytes, a binary file, (vertices, faces), voxelpipe.Mesh, or an object "
        "of trimesh, Open3D, meshio or VTK"
    )


def _of_meshio(mesh: Any) -> Mesh | MeshFile:
    faces = Faces()
    cells = getattr(mesh, "cells", None)  # blocks in order, of which one kind may have several
    if cells is None:
        cells = mesh.cells_dict.items()
    blocks = [block if isinstance(block, tuple) else (block.type, block.data) for block in cells]
    read = [faces.add_cells(kind, numpy.asarray(data)) for kind, data in blocks]
    if not any(read):
        kinds = ", ".join(kind for kind, _ in blocks) or "nothing"
        raise InvalidMesh(f"the meshio mesh has no triangles, quads or polygons, only: {kinds}", field="faces")
    points = as_numpy(mesh.points)
    if points.ndim == 2 and points.shape[1] == 2:
        points = numpy.column_stack([points, numpy.zeros(len(points))])
    return _of_faces(points, faces)


def _of_vtk(mesh: Any) -> Mesh | MeshFile:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    points = mesh.GetPoints()
    vertices = vtk_to_numpy(points.GetData()) if points is not None else numpy.zeros((0, 3))
    faces = Faces()
    if mesh.GetPolys().GetNumberOfCells():
        polygons = mesh.GetPolys()
        counts = numpy.diff(vtk_to_numpy(polygons.GetOffsetsArray()))
        faces.add(counts, vtk_to_numpy(polygons.GetConnectivityArray()))
    if mesh.GetNumberOfStrips():
        strips = mesh.GetStrips()
        faces.add_strips(vtk_to_numpy(strips.GetOffsetsArray()), vtk_to_numpy(strips.GetConnectivityArray()))
    normals, scalars = mesh.GetPointData().GetNormals(), mesh.GetPointData().GetScalars()
    colors = None if scalars is None else vtk_to_numpy(scalars)
    if colors is not None and not (colors.dtype == numpy.uint8 and colors.ndim == 2 and colors.shape[1] in (3, 4)):
        colors = None  # a quantity, not colours
    return _of_faces(vertices, faces, None if normals is None else vtk_to_numpy(normals), colors)


def _of_faces(points: Any, faces: Faces, normals: Any = None, colors: Any = None) -> Mesh | MeshFile:
    counts = faces.all_counts()
    if bool((counts == 3).all()):
        return Mesh(points, faces.all_corners().reshape(-1, 3), normals, colors)
    return MeshFile(memoryview(write_ply(checked_positions(points), faces, normals, colors)))

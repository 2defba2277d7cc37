"""Several meshes on one grid: where each stands, its name, label, priority and motion."""
from __future__ import annotations

import dataclasses
import operator
import os
import pathlib
from typing import Any, Callable, Mapping, Sequence, TypeVar, Union

import numpy
import numpy.typing

from .._proto.voxelpipe.v1 import request_pb2
from .._proto.voxelpipe.v1 import types_pb2 as types
from ..errors import InvalidMesh, InvalidRequest
from .forms import MeshFile, load_mesh
from .glb import Mesh, as_numpy

Floats = numpy.typing.NDArray[numpy.float64]
Numbers = tuple[float, ...]
Vector3 = Union[Sequence[float], numpy.typing.NDArray[Any]]  # x, y, z
_Value = TypeVar("_Value")

MAX_PLACED_MESHES = 65_535
_MAX_LABEL = (1 << 32) - 1
_MIN_PRIORITY, _MAX_PRIORITY = -(1 << 31), (1 << 31) - 1
_VECTORS = ("linear", "angular", "center")
_IDENTITY = numpy.eye(4).reshape(16)
_NO_LIST = (str, bytes, Mapping, set, frozenset)  # although one can iterate over them
_ONE_MESH = (bytearray, memoryview, os.PathLike, Mesh, MeshFile)


@dataclasses.dataclass(frozen=True)
class Motion:
    """The motion of a rigid body: the velocity at p is linear + angular x (p - center).

    linear: world units a second. angular: radians a second about the axis that it points along, right-handed. center:
    a point of that axis, world units.
    """

    linear: Vector3 = (0.0, 0.0, 0.0)
    angular: Vector3 = (0.0, 0.0, 0.0)
    center: Vector3 = (0.0, 0.0, 0.0)


# 16 numbers, row by row, in any form; None: the mesh stays where it is.
TransformLike = Union["numpy.typing.ArrayLike", None]
# None: it does not move. Also any object with such attributes.
MotionLike = Union[Motion, Mapping[str, Vector3], None]


@dataclasses.dataclass(frozen=True)
class Together:
    """The options of several meshes, as they were given: a list each, or None."""

    transforms: Any
    names: Any
    labels: Any
    priorities: Any
    motions: Any

    @staticmethod
    def of(together: Any, **lists: Any) -> "Together | None":
        """None for a call with one mesh. Errors: InvalidRequest for lists without together."""
        if not isinstance(together, bool):
            raise InvalidRequest(f"together: {together!r} is neither True nor False", field="together")
        if together:
            return Together(**lists)
        for name, value in lists.items():
            if value is not None:
                raise InvalidRequest(f"{name}: is for several meshes on one grid; give together=True too", field=name)
        return None


@dataclasses.dataclass(frozen=True)
class Source:
    """A mesh, however often it is placed.

    name: of a mesh that is kept. file: None: it is not here. kept: the caller has stored it. place: for messages.
    """

    name: str
    file: MeshFile | None
    kept: bool
    place: str

    @property
    def named_file(self) -> MeshFile | None:
        """The file under the name by which messages call it."""
        return None if self.file is None else dataclasses.replace(self.file, name=self.place)

    @property
    def loaded(self) -> Any:
        """What its file keeps of a client without a server; None: nothing, or of other bytes."""
        kept = self.file.loaded if self.file is not None else None
        return kept[1] if kept is not None and kept[0] == self.name else None

    def keep(self, loaded: Any) -> None:
        """Sets `loaded`, of a mesh with a file."""
        assert self.file is not None
        self.file.keep(self.name, loaded)


@dataclasses.dataclass(frozen=True)
class PlacedMeshes:
    """The meshes of a request for several. sources: each once; of: that of each mesh. matrices: (n, 16), row by row.

    labels: None: the mesh's number, from 1. motions: None, or linear, angular and center in 9 numbers.
    """

    sources: tuple[Source, ...]
    of: tuple[int, ...]
    matrices: Floats
    names: tuple[str, ...]
    labels: tuple[int | None, ...]
    priorities: tuple[int, ...]
    motions: tuple[Numbers | None, ...]

    def message(self) -> bytes:
        """The PlacedMeshes of the service."""
        message = request_pb2.PlacedMeshes()
        for i, matrix in enumerate(self.matrices.tolist()):
            placed = message.meshes.add(
                mesh=self.sources[self.of[i]].name,
                matrix=matrix,
                name=self.names[i],
                label=self.labels[i],
                priority=self.priorities[i],
            )
            motion = self.motions[i]
            if motion is not None:
                vectors = [types.Vec3(x=x, y=y, z=z) for x, y, z in (motion[:3], motion[3:6], motion[6:])]
                placed.motion.CopyFrom(request_pb2.RigidMotion(**dict(zip(_VECTORS, vectors))))
        encoded: bytes = message.SerializeToString()
        return encoded


def placed_meshes(
    meshes: Any, options: Together, kept: Callable[[Any], tuple[str, MeshFile | None] | None]
) -> PlacedMeshes:
    """The meshes of a list, each loaded once, and what the options say of them.

    kept: the name of a mesh that the caller has stored and its file, if that is here; None of others. Errors:
    InvalidRequest naming the option and the number in its list; those of load_mesh(), with the number of the mesh.
    """
    listed = _listed(meshes)
    count = len(listed)
    matrices = _matrices(options.transforms, count)
    given_names = _each("names", options.names, count, _name)
    labels = _each("labels", options.labels, count, _label)
    priorities = _each("priorities", options.priorities, count, _priority)
    motions = _each("motions", options.motions, count, _motion)
    sources: list[Source] = []
    number_of: dict[str, int] = {}
    read: dict[int, tuple[int, str]] = {}  # objects by their ids, which the list keeps apart
    of, names = [], []
    for i, mesh in enumerate(listed):
        if id(mesh) not in read:
            source = _source(mesh, f"meshes[{i}]", kept)
            number = number_of.setdefault(source.name, len(sources))
            if number == len(sources):
                sources.append(source)
            read[id(mesh)] = number, _own_name(source)
        number, own_name = read[id(mesh)]
        of.append(number)
        names.append(given_names[i] or own_name)
    return PlacedMeshes(
        tuple(sources),
        tuple(of),
        matrices,
        tuple(names),
        tuple(labels),
        tuple(priority or 0 for priority in priorities),
        tuple(motions),
    )


def _listed(meshes: Any) -> list[Any]:
    one = isinstance(meshes, _ONE_MESH + _NO_LIST) or hasattr(meshes, "read")
    if one or not hasattr(meshes, "__iter__"):
        raise _wrong("together", f"puts the meshes of a list on one grid; a {type(meshes).__qualname__} is none")
    listed = list(meshes)
    if not 1 <= len(listed) <= MAX_PLACED_MESHES:
        raise _wrong("together", f"{len(listed)} meshes; 1 to {MAX_PLACED_MESHES} are possible on one grid")
    return listed


def _source(mesh: Any, place: str, kept: Callable[[Any], tuple[str, MeshFile | None] | None]) -> Source:
    known = kept(mesh)
    if known is not None:
        name, file = known
        return Source(name, file, True, file.name if file is not None and file.name else place)
    try:
        file = load_mesh(mesh)
    except InvalidMesh as error:
        if isinstance(mesh, (str, os.PathLike)):  # which it names
            raise
        raise InvalidMesh(f"{place}: {error.message}", field=error.field) from error
    except TypeError as error:
        raise TypeError(f"{place}: {error}") from error
    return Source(file.stored_name(), file, False, file.name or place)


def _own_name(source: Source) -> str:
    """The file's name without its folder; of a mesh without a file's name that of a stored mesh."""
    path = source.file.name if source.file is not None else ""
    return pathlib.PurePath(path).name.encode(errors="replace").decode() or source.name


# ---- the options ----


def _wrong(field: str, why: str) -> InvalidRequest:
    return InvalidRequest(f"{field}: {why}", field=field)


def _list_of(field: str, values: Any, count: int) -> list[Any]:
    """The values of an option; None: so many times None."""
    if values is None:
        return [None] * count
    if isinstance(values, _NO_LIST) or not hasattr(values, "__iter__"):
        raise _wrong(field, f"{values!r} is no list with one for each mesh")
    listed = list(values)
    if len(listed) != count:
        raise _wrong(field, f"{len(listed)} of them for {count} mesh{'es' if count > 1 else ''}")
    return listed


def _each(field: str, values: Any, count: int, read: Callable[[Any, str], _Value]) -> list[_Value | None]:
    listed = _list_of(field, values, count)
    return [None if value is None else read(value, f"{field}[{i}]") for i, value in enumerate(listed)]


def _name(value: Any, field: str) -> str:
    if not isinstance(value, str):
        raise _wrong(field, f"{value!r} is no text")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise _wrong(field, f"{value!r} cannot be written as UTF-8") from None
    return value


def _whole(value: Any, field: str, least: int, most: int) -> int:
    try:
        whole = operator.index(value)
    except TypeError:
        whole = None
    if whole is None or isinstance(value, (bool, numpy.bool_)):
        raise _wrong(field, f"{value!r} is no whole number")
    if not least <= whole <= most:
        raise _wrong(field, f"{whole} is not from {least} to {most}")
    return whole


def _label(value: Any, field: str) -> int:
    return _whole(value, field, 1, _MAX_LABEL)


def _priority(value: Any, field: str) -> int:
    return _whole(value, field, _MIN_PRIORITY, _MAX_PRIORITY)


def _numbers(value: Any) -> Floats | None:
    """None for what is no array of numbers."""
    try:
        array = as_numpy(value)
    except (TypeError, ValueError):  # rows of several lengths
        return None
    return array.astype(numpy.float64) if array.dtype.kind in "fiu" else None


def _motion(value: Any, field: str) -> Numbers:
    if isinstance(value, Mapping):
        for name in value:
            if name not in _VECTORS:
                raise _wrong(field, f"{name!r} is none of {', '.join(_VECTORS)}")
        given = [value.get(name) for name in _VECTORS]
    else:
        given = [getattr(value, name, None) for name in _VECTORS]
        if not any(hasattr(value, name) for name in _VECTORS):
            raise _wrong(field, f"{value!r} is neither a Motion nor a mapping with {', '.join(_VECTORS)}")
    numbers: list[float] = []
    for name, vector in zip(_VECTORS, given):
        three = numpy.zeros(3) if vector is None else _numbers(vector)
        if three is None or three.shape != (3,) or not numpy.isfinite(three).all():
            raise _wrong(f"{field}.{name}", f"{vector!r} are not three numbers: x, y, z")
        numbers += three.tolist()
    return tuple(numbers)


def _matrix(value: Any, field: str) -> Floats:
    matrix = _numbers(value)
    if matrix is None or matrix.shape not in ((4, 4), (16,)):
        has = "no array of numbers" if matrix is None else f"of the shape {matrix.shape}"
        raise _wrong(field, f"it is {has}; expected 4 rows of 4 numbers, or the 16 row by row")
    return matrix.reshape(16)


def _matrices(values: Any, count: int) -> Floats:
    """(n, 16). Errors: InvalidRequest for those that are not affine; singular ones are left to the core."""
    listed = _list_of("transforms", values, count)
    matrices = numpy.empty((count, 16))
    for i, value in enumerate(listed):
        matrices[i] = _IDENTITY if value is None else _matrix(value, f"transforms[{i}]")
    wrong = ~numpy.isfinite(matrices)
    if bool(wrong.any()):
        i, number = (int(index) for index in numpy.argwhere(wrong)[0])
        raise _wrong(f"transforms[{i}]", f"number {number} is {matrices[i, number]}, expected a finite one")
    wrong = (matrices[:, 12:] != (0, 0, 0, 1)).any(axis=1)
    if bool(wrong.any()):
        i = int(wrong.argmax())
        last = " ".join(f"{number:g}" for number in matrices[i, 12:])
        raise _wrong(f"transforms[{i}]", f"the last row is {last}, expected 0 0 0 1: a point p becomes M p")
    return matrices

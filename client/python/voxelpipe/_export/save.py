"""Files of results, in the forms that the command line writes."""
from __future__ import annotations

import json
import math
import os
import pathlib
import warnings
import zipfile
from typing import TYPE_CHECKING, Any

import numpy

from .._calls import core_module, part_arrays
from .._calls.printable import printable
from .._proto.voxelpipe.v1 import request_pb2
from ..report import MeshWarning

if TYPE_CHECKING:
    from ..grid import VoxelGrid

# Written here, with or without voxelpipe_core, so that a file is the same on every machine; an .npz has the targets by
# the names that the caller gave them, which the core does not know.
_OWN = (".npy", ".npz", ".raw", ".png")
_LISTS = ("ijk", "offsets", "triangle")  # of an .npz of any kind
_ORDER = "x fastest: voxel (i, j, k) is n = i + nx*(j + ny*k); bit n is (byte[n/8] >> (n%8)) & 1; little endian"


def save(grid: "VoxelGrid", path: "str | os.PathLike[str]", compress: bool = False) -> None:
    """See VoxelGrid.save."""
    target = pathlib.Path(path)
    kind = _extension(target)
    if compress and kind != ".npz":
        raise ValueError(f"{target}: compress is an option of .npz")
    if kind not in _OWN:
        _save_by_core(grid, target, kind)
        return
    if kind in (".npy", ".raw") and (grid.kind != "dense" or len(grid.targets) != 1):
        raise ValueError(f"{target}: {kind} holds one target of a dense result; .npz holds all")
    if kind == ".raw":
        description = _description(grid, target.name).encode(errors="replace")
        _write(pathlib.Path(f"{target}.json"), lambda file: file.write(description))
    _write(target, lambda file: _fill(grid, kind, file, compress))


def _formats() -> list[dict[str, Any]]:
    """The core's registry of formats; empty without the core."""
    listed: list[dict[str, Any]] = core_module.core.formats() if core_module.available() else []
    return listed


def _extension(path: pathlib.Path) -> str:
    """The longest extension of a format that ends the name, else what follows its last dot; lower case.

    Errors: ValueError if there is none.
    """
    extension = path.suffix.lower()
    if extension in _OWN:  # without a look at the core, which it would load
        return extension
    known = [*_OWN, *(one["extension"] for one in _formats() if one["extension"] not in _OWN)]
    name = path.name.lower()
    extension = max((one for one in known if name.endswith(one) and name != one), key=len, default=extension)
    if not extension:
        raise ValueError(f"{path}: has no extension; expected one of {', '.join(known)}")
    return extension


def _save_by_core(grid: "VoxelGrid", path: pathlib.Path, kind: str) -> None:
    core = core_module.needed(f"{path}: the extension is none of {', '.join(_OWN)}; every other format")
    described = grid._request, grid._header
    name = os.fsencode(path)
    try:
        lost = core.not_kept(*described, name)
        if lost:  # before the file is there: the caller may have made an error of it
            warnings.warn(printable(str(MeshWarning("not_kept", kind, lost))), stacklevel=4)
        core_module.running().write(*described, grid._streamed(), name)
    except core.Failed as failed:
        raise core_module.error_of(failed) from None


def has_viewer(grid: "VoxelGrid") -> bool:
    """True if an .html of this result can be saved here."""
    return any(one["extension"] == ".html" and grid.kind in one["kinds"] for one in _formats())


def _write(path: pathlib.Path, fill: Any) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(part, "wb") as file:
            fill(file)
        os.replace(part, path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise type(error)(error.errno, error.strerror, str(path)) from None  # not the name of its part
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _fill(grid: "VoxelGrid", kind: str, file: Any, compress: bool) -> None:
    if kind == ".npy":
        numpy.save(file, _as_written(grid.array))
    elif kind == ".npz":
        _write_npz(file, _arrays(grid), compress)
    elif kind == ".raw":
        name = grid.targets[0].name
        file.write(grid.packed(name) if grid.targets[0].format == "bit" else grid.stored[name].reshape(-1).data)
    else:
        file.write(grid._repr_png_())


def _write_npz(file: Any, arrays: dict[str, Any], compress: bool) -> None:
    # numpy.savez takes no array of the name "file", and numpy.savez_compressed has level 6, twice as slow
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", method, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                write_array: Any = numpy.lib.format.write_array
                write_array(entry, numpy.asanyarray(array), allow_pickle=False)


def _as_written(array: Any) -> Any:
    return array.view(numpy.uint8) if array.dtype == numpy.bool_ else array


def _arrays(grid: "VoxelGrid") -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    if grid.kind == "sparse":
        arrays["ijk"] = grid.occupied()
    elif grid.kind == "buckets":
        buckets = grid.buckets
        arrays |= {"ijk": buckets.ijk, "offsets": buckets.offset.astype(numpy.int64), "triangle": buckets.triangle}
    place = {
        "dims": numpy.asarray(grid.dims, numpy.int64),
        "origin": numpy.asarray(grid.origin_corner),
        "voxel_size": numpy.asarray(grid.voxel_size),
        "index_to_world": grid.index_to_world,
    }
    for target in grid.targets:
        if target.name in place or target.name in _LISTS or target.name in part_arrays.ELEMENTS:
            raise ValueError(f"the target '{target.name}' has the name of another array of an .npz; rename it")
    parts = {} if grid.parts is None else grid.parts._arrays
    return arrays | {target.name: _as_written(grid[target.name]) for target in grid.targets} | place | parts


def _description(grid: "VoxelGrid", file_name: str) -> str:
    """The text of a .raw.json: that of the command line."""
    target, array = grid.targets[0], grid.stored[grid.targets[0].name]
    bits = target.format == "bit"
    shape = [*reversed(grid.dims)] if bits else list(array.shape)
    components = shape[0 if grid.layout == "planar" else -1] if len(shape) == 4 else 1
    asked = request_pb2.VoxelizeRequest.FromString(grid._request).spec.targets[0]
    blend = "or" if bits else "replace"
    if asked.blend:
        blend = request_pb2.Blend.Name(asked.blend).removeprefix("BLEND_").lower()
    encoding = "linear"
    if asked.encoding:
        encoding = request_pb2.Encoding.Name(asked.encoding).removeprefix("ENCODING_").lower()
    described = {
        "dims": list(grid.dims),
        "origin": list(grid.origin_corner),
        "voxel_size": list(grid.voxel_size),
        "index_to_world": grid.index_to_world.tolist(),
        "layout": grid.layout,
        "order": _ORDER,
        "targets": [
            {
                "file": file_name,
                "format": target.format,
                "components": components,
                "encoding": encoding,
                "blend": blend,
                "shader": asked.shader.name or "occupancy",
                "dtype": "bit" if bits else array.dtype.str,
                "shape": shape,
                "bytes": (math.prod(shape) + 7) // 8 if bits else array.nbytes,
            }
        ],
        "hash": grid.sha256,
        **({} if grid.parts is None else {"parts": grid.parts._columns}),
    }
    return json.dumps(described, indent=1, ensure_ascii=False) + "\n"
